"""The field of crossed lines near a grounded cylinder, beside the estimator's own model of it."""

import dataclasses

import jax.numpy as jnp
import numpy as np

from softfuse.sensors.crossed.diamond_array import array_points, array_response
from softfuse.sensors.crossed.field import ArrayField, CrossedLines, FieldSettings, line_panels

MM = 1e-3
PITCH = tuple(8e-3 * (k - 3.5) for k in range(8))
LINES = CrossedLines(PITCH, PITCH, row_depth=1.5e-3, column_depth=1.0e-3)
FINE = FieldSettings(radius=10e-3)


def test_panels_tile_the_array_and_every_line() -> None:
    for cuts in (1, 2, 3, 4):
        panels = line_panels(LINES, cuts)
        area = np.bincount(panels.line, panels.side**2)
        np.testing.assert_allclose(area, (64 * MM) ** 2 / 16, rtol=1e-12)
        first = panels.middle[panels.line == 0]
        np.testing.assert_allclose(first.mean(axis=0), [0.0, PITCH[0], -1.5e-3], atol=1e-9)


def test_the_field_converges() -> None:
    coarse = ArrayField(LINES, dataclasses.replace(FINE, cuts=3, bottom_side=2e-3, around=12))
    fine = ArrayField(LINES, FINE)
    at = (13.4e-3, -5.1e-3)
    for gap in (0.0, 2e-3):
        one, other = (field.lines(at, gap) - field.alone for field in (coarse, fine))
        assert np.abs(one - other).max() < 0.05 * other.max()


def test_the_field_peaks_where_the_estimators_own_model_does() -> None:
    """Two independent models of one experiment: charges under a grounded cylinder."""
    field = ArrayField(LINES, FINE)
    own = jnp.array(PITCH)
    points = array_points(own, own, jnp.asarray(0.0005), jnp.asarray(0.0))
    depth = jnp.repeat(jnp.array([1.5e-3, 1.0e-3]), 8)
    for at in ((13.4e-3, -5.1e-3), (0.0, 0.0), (24e-3, 24e-3)):
        signal = field.lines(at, 0.0) - field.alone
        asked = array_response(points, jnp.array(at), jnp.asarray(10e-3), depth)
        for lines in (slice(0, 8), slice(8, 16)):
            model = np.stack([np.asarray(asked[lines]), np.ones(8)], axis=1)
            fitted, *_ = np.linalg.lstsq(model, signal[lines], rcond=None)
            missed = signal[lines] - model @ fitted
            assert np.abs(missed).max() < 0.05 * signal[lines].max()


def test_the_field_is_that_of_the_recorded_pad() -> None:
    """Against the counts of tests/data/pad_nominal_two_presses.csv.gz at first contact, 2000 per pF."""
    recorded = {
        (21.7778e-3, -3.1111e-3): (3010, 2408, 4937, 4325),
        (-3.1111e-3, 3.1111e-3): (2442, 3076, 4976, 3938),
    }
    lines = {(21.7778e-3, -3.1111e-3): (3, 4, 14, 15), (-3.1111e-3, 3.1111e-3): (3, 4, 11, 12)}
    field = ArrayField(LINES, FINE)
    for at, counts in recorded.items():
        signal = 2000e12 * (field.lines(at, 0.0) - field.alone)
        np.testing.assert_allclose(signal[list(lines[at])], counts, rtol=0.1)


def test_signals_fade_with_distance() -> None:
    field = ArrayField(LINES, dataclasses.replace(FINE, cuts=2, bottom_side=2e-3, around=12))
    near = np.array(
        [field.lines((15e-3, 9e-3), gap) - field.alone for gap in (0.0, 0.5e-3, 2e-3, 8e-3, 25e-3)]
    )
    assert (np.diff(near[:, np.argmax(near[0])]) < 0).all()
