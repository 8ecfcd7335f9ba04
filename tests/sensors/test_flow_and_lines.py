"""Flow sensors and crossed lines together, on two recorded presses with truth and on damaged ones."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from suites import PAD, run, scan, suite_of, two_presses

from softfuse.sensors.status import Status

SUITE = suite_of(PAD)
FLOW, LINES = (SUITE.inputs[name] for name in ("flow", "electrodes"))
ROW, COLUMN = LINES.start, LINES.start + 8


@pytest.fixture(scope="module")
def recording():
    return two_presses()


def frames_of(recording):
    return recording.time_s.copy(), recording.matrix(SUITE.channels).copy()


@pytest.fixture(scope="module")
def measured(recording):
    return run(SUITE, *frames_of(recording))


def truth(recording):
    held = recording.columns["sample"] > 0
    location = recording.matrix(["true_x_mm", "true_y_mm"]) * 1e-3
    volume = recording.matrix([f"true_dV{i}_mm3" for i in range(4)]) * 1e-9
    return held, location, volume


def test_location_and_volumes_of_the_recorded_presses(recording, measured):
    held, location, volume = truth(recording)
    assert held.sum() == 6
    lines = measured.details["electrodes"]
    assert np.all(measured.touching[held]) and np.all(measured.pressing[held])
    error = np.hypot(*(lines.location_m - location)[held].T)
    assert error.max() < 0.3e-3
    np.testing.assert_array_equal(measured.location_m[held, 0, :2], lines.location_m[held])
    assert np.all(measured.valid[held])
    miss = (measured.reading - volume)[held]
    assert np.abs(miss).mean() < 1.0e-9
    normalised = miss / measured.sigma[held]
    assert np.sqrt(np.mean(normalised**2)) < 1.6
    assert np.abs(normalised).max() < 3.5
    assert lines.residual_counts[held].max() < 40.0
    paper = np.hypot(*(lines.weighted_mean_m - location)[held].T)
    assert np.all(error < paper) and paper.max() < 5e-3


def test_each_press_is_one_touch_that_begins_with_the_force(recording, measured):
    pushed = recording.columns["true_force_N"] > 0
    touching = measured.touching[:, 0]
    begins = np.flatnonzero(touching[1:] & ~touching[:-1]) + 1
    pushes = np.flatnonzero(pushed[1:] & ~pushed[:-1]) + 1
    assert begins.size == pushes.size == 2
    assert np.all(np.abs(begins - pushes) <= 10)
    assert np.all(touching[pushed])
    assert np.all(measured.details["electrodes"].near[touching])


def test_scan_and_frame_by_frame_agree_without_retracing(recording, measured):
    traces = []

    @eqx.filter_jit
    def update(suite, state, *frame):
        traces.append(frame)
        return suite.update(state, *frame)

    time, raw = frames_of(recording)
    raw[5, FLOW] = np.nan
    raw[7, ROW + 2] = np.nan
    state = SUITE.init()
    for now, frame in zip(time[:260], raw[:260], strict=True):
        state, m = update(SUITE, state, jnp.asarray(now), jnp.asarray(frame))
    assert len(traces) == 1
    assert bool(m.touching[0])
    np.testing.assert_allclose(m.location_m, measured.location_m[259], atol=2e-6)
    np.testing.assert_allclose(m.reading, measured.reading[259], atol=0.2e-9)


@pytest.mark.parametrize(
    "damage",
    ["missing_row", "stuck_column", "deaf_column", "dead_row", "missing_flow", "missing_frames", "time"],
)
def test_damage_is_flagged_and_the_rest_goes_on(recording, damage):
    held, location, volume = truth(recording)
    time, raw = frames_of(recording)
    # Views.
    flow, rows, columns = raw[:, FLOW], raw[:, ROW:COLUMN], raw[:, COLUMN : LINES.stop]
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
        raw[100:104] = np.nan
    else:
        time[[90, 700]] = np.nan
        time[95] = 0.0
    m = run(SUITE, time, raw)
    lines, vents = m.details["electrodes"], m.details["flow"]
    for leaf in jax.tree.leaves((m.reading, m.sigma, m.places, m.details)):
        assert np.all(np.isfinite(leaf))
    assert np.all(m.touching[held])
    error = np.hypot(*(lines.location_m - location)[held].T)
    assert np.all(error[lines.located[held]] < 0.6e-3)
    assert np.mean(lines.located[held]) > 0.6
    other = [0, 2, 3]
    assert np.all(m.valid[held][:, other])
    normalised = (m.reading - volume)[held][:, other] / m.sigma[held][:, other]
    assert np.abs(normalised).max() < 3.5
    flagged = {
        "missing_row": lambda: not lines.valid[:, 3].any(),
        "stuck_column": lambda: not lines.valid[340:, 14].any(),
        "deaf_column": lambda: not lines.valid[held][:3, 13].any(),
        "dead_row": lambda: not lines.valid[:, 4].any(),
        "missing_flow": lambda: vents.missing[:, 1].all() and not m.valid[:, 1].any(),
        "missing_frames": lambda: vents.missing[100:104].all() and not m.valid[100:104].any(),
        "time": lambda: np.flatnonzero(m.flags[Status.bad_time]).tolist() == [90, 95, 700],
    }
    assert flagged[damage]()


@pytest.mark.parametrize("case", ["ahead", "wrapped", "paused"])
def test_a_clock_that_jumps_costs_a_few_frames_and_sigma_counts_the_gap(recording, measured, case):
    held, _, volume = truth(recording)
    second = held & (recording.columns["press"] == 1)
    time, raw = frames_of(recording)
    at = int(np.flatnonzero(second)[0]) - 40  # the second press has begun
    if case == "ahead":
        time[at] += 1000.0
    else:
        time[at:] += 2**32 / 1e6 if case == "paused" else -time[at]
    m = run(SUITE, time, raw)
    lost = [at] if case == "ahead" else [at, at + 1]
    assert np.flatnonzero(m.flags[Status.bad_time]).tolist() == lost
    assert np.flatnonzero(m.flags[Status.clock_anew]).tolist() == ([] if case == "ahead" else [at + 2])
    assert np.all(m.touching[second])
    if case == "paused":
        # Nobody knows what flowed meanwhile.
        assert not m.valid[at + 2 : at + 30].any()
        assert m.sigma[at + 2].min() > 1e3 * measured.sigma[at].max()
        return
    np.testing.assert_array_equal(m.reading[:at], measured.reading[:at])
    assert np.all(m.valid[second])
    normalised = (m.reading - volume)[second] / m.sigma[second]
    assert np.abs(normalised).max() < 3.5
    grown = m.sigma[second] / measured.sigma[second]
    assert grown.min() > 0.99


def test_a_release_that_clips_is_flagged_and_reset_before_the_next_press(recording):
    time, raw = frames_of(recording)
    force = recording.columns["true_force_N"]
    falling = np.zeros(force.size, bool)
    falling[1:] = (np.diff(force) < 0) & (force[1:] > 0) & (recording.columns["press"][1:] == 0)
    raw[falling, FLOW.start + 2] = 0.0
    m = run(SUITE, time, raw)
    after, saturated = np.flatnonzero(falling)[-1], m.details["flow"].saturated
    assert saturated[after, 2] and not m.valid[after, 2]
    assert not saturated[after, [0, 1, 3]].any()
    held, _, volume = truth(recording)
    second = held & (recording.columns["press"] == 1)
    assert np.all(m.valid[second])
    assert np.abs((m.reading - volume)[second] / m.sigma[second]).max() < 3.5


def test_what_is_not_touched_has_no_location_and_says_so(measured):
    lines = measured.details["electrodes"]
    idle = ~lines.near
    assert idle.sum() > 150
    np.testing.assert_array_equal(lines.location_m[idle], 0.0)
    assert not lines.located[idle].any() and np.isnan(measured.location_m[idle]).all()
    assert lines.covariance_m2[idle][:, 0, 0].min() > (15e-3) ** 2


@pytest.mark.slow
def test_volume_can_be_differentiated_through_the_whole_recording_of_a_press(recording):
    time, raw = (jnp.asarray(each[:240]) for each in frames_of(recording))

    def volume(suite):
        return scan(suite, time, raw).reading[-1, 2]

    gradient = eqx.filter_jit(eqx.filter_grad(volume))(SUITE)
    slope, sensitivity = (each.sensors[0].filter.sensitivity_Vs_m3[2] for each in (gradient, SUITE))
    scaled = float(slope * sensitivity / volume(SUITE))
    assert scaled == pytest.approx(-1.0, abs=1e-6)
    for leaf in jax.tree.leaves(gradient):
        assert np.all(np.isfinite(np.asarray(leaf)))
