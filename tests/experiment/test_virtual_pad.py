"""The virtual pad: its mechanics on a coarse mesh, its electrodes' field, and what its channels say."""

import dataclasses

import numpy as np
import pytest

from softfuse.errors import ConfigError
from softfuse.experiment.electrode_electronics import LineElectronics
from softfuse.experiment.flow_electronics import FlowElectronics
from softfuse.experiment.pad_electrodes import LineElectrodes
from softfuse.experiment.pad_electronics import PadElectronics
from softfuse.experiment.pad_programme import PadTiming, pad_programme
from softfuse.experiment.pad_touches import PadBed, PadTouches, pad_touches
from softfuse.experiment.programme import Programme
from softfuse.experiment.virtual_pad import PadErrors, PadSettings, Touch, virtual_pad
from softfuse.mechanics.sparse import SparseLU
from softfuse.mesh.pad import PadGeometry
from softfuse.sensors.crossed.diamond_array import array_points, array_response, line_points
from softfuse.sensors.crossed.field import ArrayField, CrossedLines, FieldSettings, line_panels

MM = 1e-3
DRAWING = PadGeometry(
    size=(0.07, 0.07, 0.018),
    cavity_size=(0.026, 0.026, 0.006),
    cavity_centres=((-0.0165, -0.0165), (-0.0165, 0.0165), (0.0165, -0.0165), (0.0165, 0.0165)),
    cavity_z_bottom=0.006,
)
SETTINGS = PadSettings(
    DRAWING,
    0.2e6,
    surface_size=28e-3,
    base_size=28e-3,
    growth=3.0,
    radius=8e-3,
    rims=(0.7, 1.0),
    sectors=(4, 8),
    errors=PadErrors(0.0, 0.0),
)
"""A coarse mesh, without errors of making."""
PITCH = tuple(8e-3 * (k - 3.5) for k in range(8))
LINES = CrossedLines(PITCH, PITCH, row_depth=1.5e-3, column_depth=1.0e-3)
FIELD = FieldSettings(radius=8e-3, cuts=2, bottom_side=2e-3, around=12)
ELECTRODES = LineElectrodes(LINES, FIELD)
FINE = FieldSettings(radius=10e-3)
GAPS = (0.0, 0.5e-3, 2e-3, 8e-3, 25e-3)
FORCES = (2.0, 6.0)
PLACES = ((15 * MM, 9 * MM), (-15 * MM, 9 * MM), (0.0, 0.0))


@pytest.fixture(scope="module")
def touches() -> PadTouches:
    bed = PadBed(SETTINGS, ELECTRODES, GAPS, plan=SparseLU.plan)
    return pad_touches(bed, [Touch(at, FORCES) for at in PLACES])


@pytest.fixture(scope="module")
def programme(touches: PadTouches) -> Programme:
    flows = tuple(f"flow{k}_V" for k in range(4))
    lines = tuple([f"row{k}" for k in range(8)] + [f"col{k}" for k in range(8)])
    return pad_programme(
        touches, PadTiming(), PadElectronics(FlowElectronics(), LineElectronics()), flows, lines
    )


def test_mirrored_presses_give_mirrored_readings(touches: PadTouches) -> None:
    right, left = touches.volume[0], touches.volume[1]
    np.testing.assert_allclose(left, right[:, [2, 3, 0, 1]], rtol=1e-6, atol=1e-15)
    np.testing.assert_allclose(touches.depth[1], touches.depth[0], rtol=1e-6)
    for here in (touches.pressed, touches.near):
        rows, columns = here[..., :8], here[..., 8:]
        np.testing.assert_allclose(rows[1], rows[0], rtol=1e-6)
        np.testing.assert_allclose(columns[1], columns[0][:, ::-1], rtol=1e-6)


def test_the_middle_squeezes_all_cavities_alike_and_force_goes_with_volume(touches: PadTouches) -> None:
    middle = touches.volume[2]
    np.testing.assert_allclose(middle, np.tile(middle[:, :1], 4), rtol=1e-6, atol=1e-15)
    assert (middle[1:] < 0).all() and (touches.volume[0, 1:, 3] < -30e-9).all()
    assert (np.diff(touches.depth, axis=1) > 0).all()
    # Silicone stiffens, and a little at these forces.
    per_newton = touches.volume[0, 1:, 3] / touches.force[0, 1:]
    assert 0.7 < per_newton[1] / per_newton[0] < 1.3


def test_errors_of_making_shift_cavities_within_their_bounds() -> None:
    made = virtual_pad(dataclasses.replace(SETTINGS, errors=PadErrors(0.3e-3, 0.2e-3, seed=5)))
    for cavity, drawn in zip(made.cavities, DRAWING.centres(), strict=True):
        walls = np.asarray(made.body.rest)[np.unique(cavity.faces)]
        low, high = walls.min(axis=0), walls.max(axis=0)
        assert np.abs(0.5 * (low + high) - drawn).max() <= 0.3e-3 + 1e-9
        assert 1e-6 < np.abs(high - low - DRAWING.cavity_size).max() <= 0.2e-3 + 1e-9


def test_a_punch_that_overhangs_and_forces_that_fall_are_refused() -> None:
    bed = PadBed(SETTINGS, ELECTRODES, GAPS)
    with pytest.raises(ConfigError, match="overhangs"):
        pad_touches(bed, [Touch((0.03, 0.0), FORCES)])
    for forces in ((), (0.0,), (2.0, 1.0)):
        with pytest.raises(ConfigError, match="increase"):
            Touch((0.0, 0.0), forces)
    with pytest.raises(ConfigError, match="as many"):
        pad_touches(bed, [Touch((0, 0), (1.0,)), Touch((0, 0), FORCES)])


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
    own = np.array(PITCH)
    points = array_points(line_points(own, own, 0.0005), line_points(own, own, 0.0), 8e-3)
    depth = np.repeat([1.5e-3, 1.0e-3], 8)
    for at in ((13.4e-3, -5.1e-3), (0.0, 0.0), (24e-3, 24e-3)):
        signal = field.lines(at, 0.0) - field.alone
        asked = array_response(points, np.array(at), 10e-3, depth)
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


def test_signals_rise_on_approach_and_fade_with_distance(touches: PadTouches) -> None:
    near = touches.near[0]
    peak = near[:, np.argmax(near[0])]
    assert (np.diff(peak) < 0).all()
    np.testing.assert_array_equal(touches.pressed[:, 0], touches.near[:, 0])


def test_a_programme_presses_holds_and_lets_go(programme: Programme) -> None:
    time_s = np.arange(len(programme.readings)) * programme.step_s
    truth = programme.truth
    force, sample = truth["true_force_N"], truth["sample"]
    held = np.flatnonzero(sample)
    np.testing.assert_allclose(force[held], 3 * FORCES, rtol=1e-12)
    assert sample[held].tolist() == 3 * [1, 2]
    for k in held:
        assert np.ptp(force[k - 40 : k + 40]) == 0.0
    assert force.min() == 0.0 and force.max() == FORCES[-1]
    for press, at in enumerate(PLACES):
        here = (truth["press"] == press) & (force > 0)
        np.testing.assert_allclose(truth["true_x_mm"][here], 1e3 * at[0], atol=1e-9)
        np.testing.assert_allclose(truth["true_y_mm"][here], 1e3 * at[1], atol=1e-9)
    assert (truth["true_depth_mm"][force == 0] <= 0).all() and (truth["true_depth_mm"][held] > 0).all()
    assert time_s[-1] == pytest.approx(programme.period_s - programme.step_s)


def test_flows_integrate_to_the_volumes(programme: Programme) -> None:
    parts = FlowElectronics()
    flow = (programme.readings[:, :4] - parts.zero_V) / parts.sensitivity_Vs_m3
    steps = 0.5 * (flow[1:] + flow[:-1]) * programme.step_s
    volume = -1e9 * np.concatenate([np.zeros((1, 4)), np.cumsum(steps, axis=0)])
    truth = np.stack([programme.truth[f"true_dV{k}_mm3"] for k in range(4)], axis=1)
    np.testing.assert_allclose(volume, truth, atol=0.002 * np.abs(truth).max())
    # Squeezing blows air out, which reads above the zero.
    pressing = np.diff(programme.truth["true_force_N"]) > 0
    right = programme.truth["press"][1:] == 0
    assert (programme.readings[1:, 3][pressing & right] > parts.zero_V - 1e-12).all()


def test_a_programme_loops_seamlessly(programme: Programme) -> None:
    steps = np.abs(np.diff(programme.readings, axis=0, append=programme.readings[:1]))
    rest = steps[:50].max(axis=0)
    assert (steps[-1] <= np.maximum(rest, 1.0)).all()
    x = programme.truth["true_x_mm"]
    assert abs(x[-1] - x[0]) < 0.1
    np.testing.assert_allclose(
        programme.at(np.array([programme.period_s + 1.23])), programme.at(np.array([1.23]))
    )
    far = 1e6 * programme.period_s + 0.5
    np.testing.assert_allclose(programme.at(np.array([far])), programme.at(np.array([0.5])), rtol=1e-6)


def test_between_rows_it_is_interpolated_and_marks_hold() -> None:
    table = Programme(
        0.1, ("a", "b"), np.array([[0.0, 4.0], [1.0, 2.0], [3.0, 0.0]]),
        {"press": np.array([0.0, 0.0, 1.0]), "true_force_N": np.array([0.0, 2.0, 4.0])}, frozenset({"press"}),
    )  # fmt: skip
    times = np.array([0.0, 0.05, 0.1, 0.25, 0.29, 0.3, 0.42])
    values = [[0, 4], [0.5, 3], [1, 2], [1.5, 2], [0.3, 3.6], [0, 4], [1.4, 1.6]]
    np.testing.assert_allclose(table.at(times), values, atol=1e-12)
    truth = table.truth_at(times)
    np.testing.assert_allclose(truth["true_force_N"], [0, 1, 2, 2, 0.4, 0, 2.4], atol=1e-12)
    np.testing.assert_array_equal(truth["press"], [0, 0, 0, 1, 1, 0, 0])
    assert table.only(["b"]).at(times).tolist() == table.at(times)[:, [1]].tolist()
