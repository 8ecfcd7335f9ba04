"""Crossed lines that are switched on while something touches them, with and without a configured baseline."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from suites import PAD, run, suite_of, two_presses

from softfuse.sensors.capacitive import array_init, array_signal
from softfuse.sensors.crossed.touch import known_baseline
from softfuse.sensors.suite import SensorSuite

PLAIN = suite_of(PAD)
LINES = PLAIN.inputs["electrodes"]


def sensors(untouched: np.ndarray | float) -> SensorSuite:
    counts = jnp.broadcast_to(jnp.asarray(untouched, float), (16,))
    return eqx.tree_at(lambda s: s.contact_sensors[0].array.untouched_counts, PLAIN, counts)


@pytest.fixture(scope="module")
def recording():
    return two_presses()


@pytest.fixture(scope="module")
def untouched(recording) -> np.ndarray:
    return recording.matrix(PLAIN.channels)[:50, LINES].mean(axis=0)


def measure(made: SensorSuite, recording, begin: int):
    return run(made, recording.time_s[begin:], recording.matrix(PLAIN.channels)[begin:])


@pytest.fixture(scope="module")
def held(recording) -> int:
    """A frame in which the first press is held."""
    return int(np.flatnonzero(recording.columns["sample"] > 0)[0]) - 5


def test_the_touch_is_there_at_once(recording, untouched, held):
    # As far as a baseline may drift together.
    for drift in (0.0, 40.0):
        found = measure(sensors(untouched - drift), recording, held)
        truth = 1e-3 * recording.matrix(["true_x_mm", "true_y_mm"])[held]
        assert found.touching[0, 0] and np.isfinite(found.location_m[0]).all()
        assert found.details["electrodes"].valid[0].all()
        assert np.hypot(*(found.location_m[0, 0, :2] - truth)) < 0.5e-3
        force = recording.columns["true_force_N"][held:]
        released = int(np.flatnonzero(force == 0)[0])
        assert found.touching[: released - 5].all() and not found.touching[released + 40, 0]
        # How much had been squeezed out before is not known.
        assert not found.valid[: released - 5].any()
        assert np.all(np.isfinite(found.sigma)) and found.sigma[0].min() > 1e-6
        # The second press is as if the first had been seen from its beginning.
        second = np.flatnonzero((recording.columns["sample"] > 0) & (recording.columns["press"] == 1)) - held
        assert found.touching[second].all() and found.valid[second].all()


def test_without_a_baseline_the_first_reading_is_taken(recording, held):
    found = measure(sensors(np.inf), recording, held)
    assert not found.touching[:20].any()
    assert np.abs(found.details["electrodes"].signal_counts[1]).max() < 100.0


def test_a_gain_divides_the_signal(recording, untouched, held):
    gain = np.linspace(0.9, 1.1, 16)
    plain = sensors(untouched)
    made = eqx.tree_at(lambda s: s.contact_sensors[0].array.gain, plain, jnp.asarray(gain))
    found = (measure(each, recording, held).details["electrodes"] for each in (plain, made))
    one, other = (each.signal_counts[0] for each in found)
    np.testing.assert_allclose(other, one / gain)


@pytest.mark.parametrize("drift", ["none", "together", "each", "one line", "one layer"])
def test_a_baseline_that_has_drifted_does_no_harm(recording, untouched, drift):
    drifted = {
        "none": 0.0,
        "together": 8000.0,
        "each": np.random.default_rng(1).uniform(-600.0, 600.0, 16),
        "one line": np.where(np.arange(16) == 4, 8000.0, 0.0),
        "one layer": np.where(np.arange(16) < 8, 1000.0 * np.arange(16), 0.0),
    }[drift]
    found, plain = (measure(sensors(each), recording, 0) for each in (untouched - drifted, np.inf))
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(plain), strict=True):
        np.testing.assert_array_equal(one, other)


def test_nothing_is_traced_again(recording, untouched, held):
    traces = []

    @eqx.filter_jit
    def update(made, state, *frame):
        traces.append(frame)
        return made.update(state, *frame)

    frames = recording.time_s, recording.matrix(PLAIN.channels)
    for known, begin in ((untouched, held), (untouched, 0), (np.full(16, np.inf), held)):
        state = sensors(known).init()
        for i in range(begin, begin + 5):
            state, _ = update(sensors(known), state, *(jnp.asarray(each[i]) for each in frames))
    assert len(traces) == 1


def test_derivatives_stay_finite_where_a_reading_is_missing(untouched):
    counts = jnp.asarray(untouched + 100.0).at[3].set(jnp.nan)
    before = known_baseline(sensors(untouched).contact_sensors[0].array, array_init(16))

    def signal(array):
        return jnp.sum(array_signal(array, before, counts).signal_counts)

    gradient = jax.grad(signal, allow_int=True)(sensors(np.inf).contact_sensors[0].array)
    np.testing.assert_allclose(gradient.gain, np.where(np.arange(16) == 3, 0.0, -100.0), rtol=1e-6)


@pytest.mark.parametrize("known", [True, False])
def test_lines_that_are_lost_begin_no_touch(recording, untouched, known: bool) -> None:
    """In the first frame, where all lines have drifted down together, or nothing is known of a baseline."""
    made = sensors(untouched + 2000.0 if known else np.inf)
    raw = recording.matrix(PLAIN.channels)[:30].copy()
    raw[0, LINES.start + np.array([3, 8 + 2])] = np.nan
    found = run(made, recording.time_s[:30], raw)
    assert not found.touching.any() and np.isfinite(found.details["electrodes"].signal_counts).all()
