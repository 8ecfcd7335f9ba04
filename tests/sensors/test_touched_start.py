"""A pad that is switched on while something touches it, with and without a configured baseline."""

from dataclasses import replace
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made_sensors import capacitive_array, d6f_p0001a1, peak_model, touch_detector

from softfuse.hardware.recording import read_recording
from softfuse.sensors.capacitive import array_init, array_signal
from softfuse.sensors.crossed.touched_start import known_baseline
from softfuse.sensors.pad import PadSensors, pad_sensor_init, pad_sensor_update

LINES = (-28.0 + 8.0 * np.arange(8)) * 1e-3
FLOW = [f"flow{i}_V" for i in range(4)]
ROWS = [f"row{i}" for i in range(8)]
COLUMNS = [f"col{i}" for i in range(8)]


def sensors(untouched: np.ndarray | float) -> PadSensors:
    return PadSensors(
        flow=d6f_p0001a1(4),
        array=replace(
            capacitive_array(), untouched_counts=jnp.broadcast_to(jnp.asarray(untouched, float), (16,))
        ),
        peak=peak_model(LINES, LINES, 1.5e-3, 1.0e-3),
        touch=touch_detector(),
    )


@pytest.fixture(scope="module")
def recording():
    path = Path(__file__).parents[1] / "data" / "pad_nominal_two_presses.csv.gz"
    return read_recording(path, FLOW + ROWS + COLUMNS)


@pytest.fixture(scope="module")
def untouched(recording) -> np.ndarray:
    return recording.matrix(ROWS + COLUMNS)[:50].mean(axis=0)


@eqx.filter_jit
def scan(sensors, frames):
    def step(state, frame):
        return pad_sensor_update(sensors, state, *frame)

    return jax.lax.scan(step, pad_sensor_init(sensors), frames)[1]


def measure(made: PadSensors, recording, begin: int):
    frames = [recording.time_s[begin:], *(recording.matrix(names)[begin:] for names in (FLOW, ROWS, COLUMNS))]
    return jax.tree.map(np.asarray, scan(made, [jnp.asarray(each) for each in frames]))


@pytest.fixture(scope="module")
def held(recording) -> int:
    """A frame in which the first press is held."""
    return int(np.flatnonzero(recording.columns["sample"] > 0)[0]) - 5


def test_the_touch_is_there_at_once(recording, untouched, held):
    # As far as a baseline may drift together.
    for drift in (0.0, 40.0):
        found = measure(sensors(untouched - drift), recording, held)
        truth = 1e-3 * recording.matrix(["true_x_mm", "true_y_mm"])[held]
        assert found.touching[0] and found.location_valid[0] and found.electrode_valid[0].all()
        assert np.hypot(*(found.location_m[0] - truth)) < 0.5e-3
        force = recording.columns["true_force_N"][held:]
        released = int(np.flatnonzero(force == 0)[0])
        assert found.touching[: released - 5].all() and not found.touching[released + 40]
        # How much had been squeezed out before is not known.
        assert not found.volume_valid[: released - 5].any()
        assert np.all(np.isfinite(found.volume_sigma_m3)) and found.volume_sigma_m3[0].min() > 1e-6
        # The second press is as if the first had been seen from its beginning.
        second = np.flatnonzero((recording.columns["sample"] > 0) & (recording.columns["press"] == 1)) - held
        assert found.touching[second].all() and found.volume_valid[second].all()


def test_without_a_baseline_the_first_reading_is_taken(recording, held):
    found = measure(sensors(np.inf), recording, held)
    assert not found.touching[:20].any() and np.abs(found.signal_counts[1]).max() < 100.0


def test_a_gain_divides_the_signal(recording, untouched, held):
    gain = np.linspace(0.9, 1.1, 16)
    plain = sensors(untouched)
    made = eqx.tree_at(lambda s: s.array.gain, plain, jnp.asarray(gain))
    one, other = (measure(each, recording, held).signal_counts[0] for each in (plain, made))
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
        return pad_sensor_update(made, state, *frame)

    frames = [recording.time_s, *(recording.matrix(names) for names in (FLOW, ROWS, COLUMNS))]
    for known, begin in ((untouched, held), (untouched, 0), (np.full(16, np.inf), held)):
        state = pad_sensor_init(sensors(known))
        for i in range(begin, begin + 5):
            state, _ = update(sensors(known), state, *(jnp.asarray(each[i]) for each in frames))
    assert len(traces) == 1


def test_derivatives_stay_finite_where_a_reading_is_missing(untouched):
    counts = jnp.asarray(untouched + 100.0).at[3].set(jnp.nan)
    before = known_baseline(sensors(untouched).array, array_init(16))

    def signal(array):
        return jnp.sum(array_signal(array, before, counts).signal_counts)

    gradient = jax.grad(signal, allow_int=True)(sensors(np.inf).array)
    np.testing.assert_allclose(gradient.gain, np.where(np.arange(16) == 3, 0.0, -100.0), rtol=1e-6)


@pytest.mark.parametrize("known", [True, False])
def test_lines_that_are_lost_begin_no_touch(recording, untouched, known: bool) -> None:
    """In the first frame, where all lines have drifted down together, or nothing is known of a baseline."""
    made = sensors(untouched + 2000.0 if known else np.inf)
    frames = [recording.time_s[:30], *(recording.matrix(names)[:30] for names in (FLOW, ROWS, COLUMNS))]
    frames[2][0, 3] = frames[3][0, 2] = np.nan
    found = jax.tree.map(np.asarray, scan(made, [jnp.asarray(each) for each in frames]))
    assert not found.touching.any() and np.isfinite(found.signal_counts).all()
