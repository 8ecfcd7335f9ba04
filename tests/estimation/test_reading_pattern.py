"""Readings point to where presses explain them: by the pattern of small pushes all over a surface."""

from dataclasses import fields, replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.estimation.rest_response import push_response
from softfuse.estimation.unseen_touch import PatternFit, TouchByReadings, TouchSettings, pattern_fit
from softfuse.functional.chart import FlatChart
from softfuse.functional.pressure_cells import uniform
from softfuse.functional.workspace import FlatWorkspace
from softfuse.mechanics.indenters import SurfacePatches
from softfuse.mechanics.model import Model, compliance, simulate
from softfuse.mechanics.prescribed import PrescribedForce
from softfuse.mechanics.volume import VolumePorts

MM = 1e-3
ENDS = np.array([[-16.0, -6.0], [16.0, 6.0]]) * MM


class Pattern(NamedTuple):
    """Places (s, 3, 3) `pitch_m` (2,) apart, and readings per newton there (s, k)."""

    place: np.ndarray
    pitch_m: np.ndarray
    slope: np.ndarray

    def fitted(
        self,
        reading: np.ndarray,
        covariance: np.ndarray,
        valid: np.ndarray,
        misfit: np.ndarray | None = None,
    ) -> PatternFit:
        """How well a press at each place explains readings, and an estimate that left a misfit."""
        return pattern_fit(*self, reading, covariance, valid, misfit=misfit)


@pytest.fixture(scope="module")
def patched(plain_device: Model) -> Model:
    """The small robot, pressed by a patch of 4 mm."""
    (punch,) = plain_device.contacts
    patch = SurfacePatches(punch.surface, uniform(rings=2, angles=6), 4 * MM)
    return replace(plain_device, contacts=(patch,))


def pushed(model: Model, places: np.ndarray, state) -> np.ndarray:
    return np.asarray(push_response(model, jnp.asarray(places), state))


@pytest.fixture(scope="module")
def pattern(patched: Model) -> Pattern:
    places, pitch = FlatWorkspace(FlatChart.along((0, 0, -1)), *ENDS).grid(3)
    return Pattern(places, pitch, pushed(patched, places, patched.rest_state(jnp.asarray(places[:1]))))


def test_the_pattern_is_what_small_forces_do(patched: Model, pattern: Pattern) -> None:
    assert pattern.place.shape == (9, 3, 3) and pattern.slope.shape == (9, 2)
    for place, found in zip(pattern.place, pattern.slope, strict=True):
        wanted = compliance(patched, jnp.asarray(place)[None], jnp.array([1e-6]))[:, 0]
        np.testing.assert_allclose(found, wanted, rtol=1e-6)


def test_the_pattern_is_that_of_the_shape_that_the_robot_has(patched: Model, pattern: Pattern) -> None:
    """A chamber that is driven moves and stiffens the body: pushes do something else then."""
    cavity = patched.readings[0].functional
    ports = VolumePorts.of((cavity,), patched.body)
    driven = PrescribedForce.on(ports, patched.body, jnp.full(1, 1e3))
    model = replace(patched, actuators=(driven,))
    place = jnp.asarray(pattern.place[2])[None]
    drive = model.rest_state(place).drive.at[-1].set(2e4).at[0].set(1e-6)
    state = simulate(model, place, drive).state
    found = pushed(model, np.asarray(place), state)[0]
    np.testing.assert_allclose(found, compliance(model, place, drive)[:, 0], rtol=1e-5)
    assert np.abs(found / pattern.slope[2] - 1).max() > 0.05


def test_patterns_of_all_states_have_one_program(patched: Model, pattern: Pattern) -> None:
    """Live, another one would hold up frames for as long as it takes to compile."""
    traced = []

    class Traced(SurfacePatches):
        def load(self, body, place):
            traced.append(place)
            return super().load(body, place)

    (patch,) = patched.contacts
    model = replace(patched, contacts=(Traced(*(getattr(patch, each.name) for each in fields(patch))),))
    places = jnp.asarray(pattern.place)
    untouched, touched = model.rest_state(()), model.rest_state(places[:2])
    traced.clear()
    found = push_response(model, places, untouched)
    once = len(traced)
    np.testing.assert_array_equal(push_response(model, places, touched), found)
    assert len(traced) == once > 0


def test_a_search_begins_anew_only_where_readings_say_so_clearly(pattern: Pattern) -> None:
    left, right = pattern.place[1], pattern.place[7]
    reading, valid = 4.0 * pattern.slope[7], np.ones(2, bool)
    sure, unsure = (np.diag((part * np.abs(reading).max() * np.ones(2)) ** 2) for part in (0.001, 10.0))
    found = pattern.fitted(reading, sure, valid).better(left)
    assert found is not None and abs(found[0, 0] - right[0, 0]) < 1e-9
    assert pattern.fitted(reading, sure, valid).better(found) is None
    assert pattern.fitted(reading, unsure, valid).better(left) is None
    # An estimate that explains them stays where it is, however far patterns of small forces are from them.
    explained, unexplained = (pattern.fitted(reading, sure, valid, off * reading) for off in (1e-3, 0.5))
    assert explained.better(left) is None
    np.testing.assert_array_equal(unexplained.better(left), found)
    # A cavity that is not known tells nothing.
    one = pattern.fitted(np.array([np.nan, reading[1]]), sure, np.array([False, True]))
    assert one.better(left) is None


def test_readings_of_no_press_point_nowhere(pattern: Pattern) -> None:
    still = np.array([1e-9, 1e-9])  # both cavities grow
    fit = pattern.fitted(still, np.diag(still**2), np.ones(2, bool))
    assert fit.better(pattern.place[0]) is None
    np.testing.assert_array_equal(fit.force_N, 0.0)


def test_what_else_explains_the_readings_counts(pattern: Pattern) -> None:
    """One cavity tells a force at each place: all are as likely."""
    reading, valid = 4.0 * pattern.slope[7], np.array([False, True])
    fit = pattern.fitted(reading, np.diag(np.full(2, 1e-20)), valid)
    np.testing.assert_allclose(fit.missing, fit.missing[0], atol=1e-9)
    np.testing.assert_allclose(fit.force_N, reading[1] / pattern.slope[:, 1])
    middle = fit.elsewhere(pattern.place[4], 4.0)
    assert middle.share == 0.0 and not middle.place_m2.any()  # all are its neighbours
    corner = fit.elsewhere(pattern.place[0], 4.0)
    far = np.setdiff1d(np.arange(9), [0, 1, 3, 4])
    np.testing.assert_allclose(corner.share, 5 / 9)
    squares = (pattern.place[far, 0, :2] - pattern.place[0, 0, :2]) ** 2
    np.testing.assert_allclose(corner.place_m2, squares.mean(axis=0))
    np.testing.assert_allclose(corner.force_N2, np.mean((fit.force_N[far] - 4.0) ** 2))


def fit_of(pattern: Pattern, reading: np.ndarray, sigma: float = 1e-10) -> PatternFit:
    return pattern.fitted(reading, np.diag(np.full(2, sigma**2)), np.ones(2, bool))


def begins(follows: TouchByReadings, fit: PatternFit) -> bool:
    return follows.begins(lambda: fit, fit.unexplained)


def ends(follows: TouchByReadings, force_N: float, fit: PatternFit) -> bool:
    return follows.ends(force_N, 0.2, lambda: fit, fit.unexplained)


def test_a_touch_begins_and_ends_by_readings_alone(pattern: Pattern) -> None:
    follows, told = TouchByReadings(), fit_of(pattern, 4.0 * pattern.slope[7])
    # Chance says it once, and not three times in a row.
    nothing = fit_of(pattern, np.zeros(2))
    assert not any(begins(follows, fit) for fit in (told, told, nothing, told, told))
    assert begins(follows, told) and follows.touching
    # Where nothing is to be explained, presses all over are not asked for.
    assert TouchByReadings().begins(pytest.fail, nothing.unexplained) is False
    assert not ends(follows, 0.1, nothing) and not ends(follows, 2.0, nothing)
    frames = TouchSettings().off_frames
    # Readings that nothing but a press explains hold it, however unsure its force is.
    assert not any(ends(follows, 0.1, told) for _ in range(2 * frames))
    assert [ends(follows, 0.1, nothing) for _ in range(frames)] == [False] * (frames - 1) + [True]
    assert not follows.touching


def test_a_press_is_told_however_wrong_the_model_may_be_about_presses(pattern: Pattern) -> None:
    """An error in proportion to what a press does limits χ² of the readings; not that of no press."""
    reading = 4.0 * pattern.slope[7]
    wrong = np.diag(np.full(2, 1e-20)) + 0.3**2 * np.outer(reading, reading)
    follows, fit = TouchByReadings(), pattern.fitted(reading, wrong, np.ones(2, bool))
    assert fit.unexplained < 36.0 < (untouched := float(np.sum((reading / 1e-10) ** 2)))
    assert [follows.begins(lambda: fit, untouched) for _ in range(3)] == [False, False, True]
    assert not any(begins(TouchByReadings(), fit) for _ in range(3))


def test_what_no_press_explains_is_no_touch(pattern: Pattern) -> None:
    follows = TouchByReadings()
    swollen = fit_of(pattern, -4.0 * pattern.slope[7])
    assert swollen.unexplained > 36.0
    assert not any(begins(follows, swollen) for _ in range(10))
    # A force that is lost is not known to press on.
    follows.touching = True
    frames = TouchSettings().off_frames
    assert [ends(follows, np.nan, swollen) for _ in range(frames)][-1]
