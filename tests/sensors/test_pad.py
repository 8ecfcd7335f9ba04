"""All sensors of the pad together, on two recorded presses with truth and on damaged versions of them."""

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made_sensors import capacitive_array, d6f_p0001a1, peak_model, touch_detector

from softfuse.hardware.recording import read_recording
from softfuse.sensors.pad import PadSensors, pad_sensor_init, pad_sensor_update

LINES = (-28.0 + 8.0 * np.arange(8)) * 1e-3
FLOW = [f"flow{i}_V" for i in range(4)]
ROWS = [f"row{i}" for i in range(8)]
COLUMNS = [f"col{i}" for i in range(8)]
SENSORS = PadSensors(
    flow=d6f_p0001a1(4),
    array=capacitive_array(),
    peak=peak_model(LINES, LINES, 1.5e-3, 1.0e-3),
    touch=touch_detector(),
)


@pytest.fixture(scope="module")
def recording():
    path = Path(__file__).parents[1] / "data" / "pad_nominal_two_presses.csv.gz"
    return read_recording(path, FLOW + ROWS + COLUMNS)


@eqx.filter_jit
def scan(sensors, frames):
    def step(state, frame):
        return pad_sensor_update(sensors, state, *frame)

    return jax.lax.scan(step, pad_sensor_init(sensors), frames)[1]


def frames_of(recording):
    return [recording.time_s.copy(), *(recording.matrix(names).copy() for names in (FLOW, ROWS, COLUMNS))]


def measure(frames):
    return jax.tree.map(np.asarray, scan(SENSORS, [jnp.asarray(f) for f in frames]))


@pytest.fixture(scope="module")
def measured(recording):
    return measure(frames_of(recording))


def truth(recording):
    held = recording.columns["sample"] > 0
    location = recording.matrix(["true_x_mm", "true_y_mm"]) * 1e-3
    volume = recording.matrix([f"true_dV{i}_mm3" for i in range(4)]) * 1e-9
    return held, location, volume


def test_location_and_volumes_of_the_recorded_presses(recording, measured):
    held, location, volume = truth(recording)
    assert held.sum() == 6
    assert np.all(measured.touching[held]) and np.all(measured.location_valid[held])
    error = np.hypot(*(measured.location_m - location)[held].T)
    assert error.max() < 0.3e-3
    assert np.all(measured.volume_valid[held])
    miss = (measured.volume_change_m3 - volume)[held]
    assert np.abs(miss).mean() < 1.0e-9
    normalised = miss / measured.volume_sigma_m3[held]
    assert np.sqrt(np.mean(normalised**2)) < 1.6
    assert np.abs(normalised).max() < 3.5
    assert measured.location_residual_counts[held].max() < 40.0
    paper = np.hypot(*(measured.weighted_mean_m - location)[held].T)
    assert np.all(error < paper) and paper.max() < 5e-3


def test_each_press_is_one_touch_that_begins_with_the_force(recording, measured):
    pushed = recording.columns["true_force_N"] > 0
    begins = np.flatnonzero(measured.touching[1:] & ~measured.touching[:-1]) + 1
    pushes = np.flatnonzero(pushed[1:] & ~pushed[:-1]) + 1
    assert begins.size == pushes.size == 2
    assert np.all(np.abs(begins - pushes) <= 10)
    assert np.all(measured.touching[pushed])
    assert np.all(measured.near[measured.touching])


def test_scan_and_frame_by_frame_agree_without_retracing(recording, measured):
    traces = []

    @eqx.filter_jit
    def update(sensors, state, *frame):
        traces.append(frame)
        return pad_sensor_update(sensors, state, *frame)

    frames = frames_of(recording)
    frames[1][5] = np.nan
    frames[2][7, 2] = np.nan
    state = pad_sensor_init(SENSORS)
    for i in range(260):
        state, m = update(SENSORS, state, *(jnp.asarray(f[i]) for f in frames))
    assert len(traces) == 1
    assert bool(m.touching)
    np.testing.assert_allclose(m.location_m, measured.location_m[259], atol=2e-6)
    np.testing.assert_allclose(m.volume_change_m3, measured.volume_change_m3[259], atol=0.2e-9)


@pytest.mark.parametrize(
    "damage",
    ["missing_row", "stuck_column", "deaf_column", "dead_row", "missing_flow", "missing_frames", "time"],
)
def test_damage_is_flagged_and_the_rest_goes_on(recording, damage):
    held, location, volume = truth(recording)
    time, flow, rows, columns = frames_of(recording)
    if damage == "missing_row":
        rows[:, 3] = np.nan
    elif damage == "stuck_column":
        columns[300:, 6] = columns[300, 6]
    elif damage == "deaf_column":
        columns[:, 5] = columns[:100, 5].mean() + np.round(8.0 * np.sin(np.arange(len(columns)) ** 2))
    elif damage == "dead_row":
        rows[:, 4] = 0.0
    elif damage == "missing_flow":
        flow[:, 1] = np.nan
    elif damage == "missing_frames":
        for column in (flow, rows, columns):
            column[100:104] = np.nan
    else:
        time[[90, 700]] = np.nan
        time[95] = 0.0
    m = measure([time, flow, rows, columns])
    for leaf in jax.tree.leaves(m):
        assert np.all(np.isfinite(leaf))
    assert np.all(m.touching[held])
    error = np.hypot(*(m.location_m - location)[held].T)
    assert np.all(error[m.location_valid[held]] < 0.6e-3)
    assert np.mean(m.location_valid[held]) > 0.6
    other = [0, 2, 3]
    assert np.all(m.volume_valid[held][:, other])
    normalised = (m.volume_change_m3 - volume)[held][:, other] / m.volume_sigma_m3[held][:, other]
    assert np.abs(normalised).max() < 3.5
    flagged = {
        "missing_row": lambda: not m.electrode_valid[:, 3].any(),
        "stuck_column": lambda: not m.electrode_valid[340:, 14].any(),
        "deaf_column": lambda: not m.electrode_valid[held][:3, 13].any(),
        "dead_row": lambda: not m.electrode_valid[:, 4].any(),
        "missing_flow": lambda: m.flow_missing[:, 1].all() and not m.volume_valid[:, 1].any(),
        "missing_frames": lambda: m.flow_missing[100:104].all() and not m.volume_valid[100:104].any(),
        "time": lambda: np.flatnonzero(~m.time_valid).tolist() == [90, 95, 700],
    }
    assert flagged[damage]()


@pytest.mark.parametrize("case", ["ahead", "wrapped", "paused"])
def test_a_clock_that_jumps_costs_a_few_frames_and_sigma_counts_the_gap(recording, measured, case):
    held, _, volume = truth(recording)
    second = held & (recording.columns["press"] == 1)
    frames = frames_of(recording)
    time, n = frames[0], len(frames[0])
    at = int(np.flatnonzero(second)[0]) - 40  # the second press has begun
    if case == "ahead":
        time[at] += 1000.0
    else:
        time[at:] += 2**32 / 1e6 if case == "paused" else -time[at]
    m = measure(frames)
    lost = [at] if case == "ahead" else [at, at + 1]
    assert np.flatnonzero(~m.time_valid).tolist() == lost
    assert np.flatnonzero(m.clock_anew).tolist() == ([] if case == "ahead" else [at + 2])
    assert np.all(m.touching[second])
    if case == "paused":
        # Nobody knows what flowed meanwhile.
        assert not m.volume_valid[at + 2 : at + 30].any()
        assert m.volume_sigma_m3[at + 2].min() > 1e3 * measured.volume_sigma_m3[at].max()
        return
    np.testing.assert_array_equal(m.volume_change_m3[:at], measured.volume_change_m3[:at])
    assert np.all(m.volume_valid[second])
    normalised = (m.volume_change_m3 - volume)[second] / m.volume_sigma_m3[second]
    assert np.abs(normalised).max() < 3.5
    grown = m.volume_sigma_m3[second] / measured.volume_sigma_m3[second]
    assert grown.min() > 0.99 and n == len(m.time_s)


def test_a_release_that_clips_is_flagged_and_reset_before_the_next_press(recording):
    frames = frames_of(recording)
    force = recording.columns["true_force_N"]
    falling = np.zeros(force.size, bool)
    falling[1:] = (np.diff(force) < 0) & (force[1:] > 0) & (recording.columns["press"][1:] == 0)
    frames[1][falling, 2] = 0.0
    m = measure(frames)
    after = np.flatnonzero(falling)[-1]
    assert m.flow_saturated[after, 2] and not m.volume_valid[after, 2]
    assert not m.flow_saturated[after, [0, 1, 3]].any()
    held, _, volume = truth(recording)
    second = held & (recording.columns["press"] == 1)
    assert np.all(m.volume_valid[second])
    assert np.abs((m.volume_change_m3 - volume)[second] / m.volume_sigma_m3[second]).max() < 3.5


def test_an_untouched_pad_has_no_location_and_says_so(measured):
    idle = ~measured.near
    assert idle.sum() > 150
    np.testing.assert_array_equal(measured.location_m[idle], 0.0)
    assert not measured.location_valid[idle].any()
    assert measured.location_covariance_m2[idle][:, 0, 0].min() > (15e-3) ** 2


def test_volume_can_be_differentiated_through_the_whole_recording_of_a_press(recording):
    frames = [jnp.asarray(f[:240]) for f in frames_of(recording)]

    def volume(sensors):
        return scan(sensors, frames).volume_change_m3[-1, 2]

    gradient = eqx.filter_jit(eqx.filter_grad(volume))(SENSORS)
    sensitivity = SENSORS.flow.sensitivity_Vs_m3[2]
    scaled = float(gradient.flow.sensitivity_Vs_m3[2] * sensitivity / volume(SENSORS))
    assert scaled == pytest.approx(-1.0, abs=1e-6)
    for leaf in jax.tree.leaves(gradient):
        assert np.all(np.isfinite(np.asarray(leaf)))
