"""The host's time of a device's time, against a simulated line whose true times are known."""

import numpy as np
import pytest

from softfuse.hardware.device_clock import DeviceClock

RATE_HZ = 100
HOST_EPOCH_S = 1.7e9
BOOT_S = 12.3


def exponential(t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Arrivals that a busy host reads late, by 1 ms in the mean."""
    return t + rng.exponential(1e-3, t.size)


def usb_frames(t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Arrivals in bursts every 16 ms, as of an FTDI bridge with its usual latency timer."""
    return np.ceil((t + rng.exponential(0.3e-3, t.size)) / 16e-3) * 16e-3


def stalls(t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Arrivals in USB frames of 1 ms on a host that stalls for 50 ms now and then."""
    frames = np.ceil(t / 1e-3) * 1e-3
    return frames + rng.exponential(0.5e-3, t.size) + 50e-3 * (rng.random(t.size) < 0.02)


class Line:
    """A device with drift on a line with delays; offsets by which its clock is ahead over time."""

    def __init__(self, drift_ppm: float, delays, *, seconds: float = 90.0, seed: int = 1) -> None:
        self.true_s = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
        self.device_us = np.round((self.true_s / (1 + 1e-6 * drift_ppm) + BOOT_S) * 1e6).astype(int)
        arrival = delays(self.true_s, np.random.default_rng(seed))
        # A stream keeps its order.
        self.arrival_s = np.maximum.accumulate(arrival)

    def stamps(self, clock: DeviceClock, which: slice = slice(None)) -> np.ndarray:
        """Stamped times [s], since the host's epoch."""
        pairs = zip(self.device_us[which].tolist(), self.arrival_s[which].tolist(), strict=True)
        return np.array([clock.stamp(us, HOST_EPOCH_S + s) for us, s in pairs]) - HOST_EPOCH_S


def worst(error: np.ndarray, start_s: float) -> float:
    """Largest error from that time on [s]."""
    return float(np.abs(error[int(start_s * RATE_HZ) :]).max())


@pytest.mark.parametrize("drift_ppm", [200.0, -200.0, 0.0, 5000.0])
@pytest.mark.parametrize(
    ("delays", "least_s", "early_s", "error_s"),
    [(exponential, 0.0, 3e-3, 20e-6), (usb_frames, 2e-3, 17e-3, 0.5e-3), (stalls, 1e-3, 3e-3, 0.1e-3)],
)
def test_offset_and_drift_are_found_through_jitter(drift_ppm, delays, least_s, early_s, error_s):
    line, clock = Line(drift_ppm, delays), DeviceClock()
    stamps = line.stamps(clock)
    # Samples at multiples of 10 ms wait at least for 2 ms or 0 ms to the next frame: that is in the offset.
    error = stamps - line.true_s
    assert np.all(np.diff(stamps) > 0)
    # Until the drift is known, a clock that is off by 5000 ppm runs away by 10 ms in 2 s.
    assert worst(error, 0.0) <= early_s + abs(drift_ppm) * 2e-6
    settled = error[10 * RATE_HZ :]
    assert settled.min() >= -error_s and settled.max() <= least_s + error_s
    assert clock.report.drift_ppm == pytest.approx(drift_ppm, abs=5.0)
    # The spacing of samples is that of the device.
    assert np.abs(np.diff(stamps)[10 * RATE_HZ :] * RATE_HZ - 1).max() < 0.02


def test_the_report_tells_offset_and_jitter():
    line, clock = Line(200.0, exponential), DeviceClock()
    line.stamps(clock)
    expected = HOST_EPOCH_S + line.true_s[-1] - line.device_us[-1] * 1e-6
    assert clock.report.offset_s == pytest.approx(expected, abs=20e-6)
    # Exponential delays are below 3 times their mean in 95 %.
    assert clock.report.jitter_s == pytest.approx(3e-3, rel=0.3)
    assert (clock.report.jumps, clock.report.restarts) == (0, 0)


def test_stamps_never_go_back_on_any_line():
    rng = np.random.default_rng(3)
    for _ in range(20):
        clock = DeviceClock()
        device_us = np.cumsum(rng.integers(0, 30_000, 500))
        arrival_s = np.maximum.accumulate(device_us * 1e-6 + rng.exponential(rng.choice([1e-3, 1.0]), 500))
        stamps = [clock.stamp(int(us), s) for us, s in zip(device_us, arrival_s, strict=True)]
        steps = np.diff(stamps)
        assert np.all(steps >= 0) and np.all((steps > 0) | (np.diff(device_us) == 0))


def test_a_backlog_at_the_start_is_worked_off():
    line, clock = Line(50.0, exponential, seconds=20), DeviceClock()
    # The kernel had kept what came during the first 0.6 s.
    line.arrival_s[:60] = line.arrival_s[60]
    error = line.stamps(clock) - line.true_s
    assert error[0] == pytest.approx(0.6, abs=5e-3)
    assert worst(error, 4.0) < 1e-3


def test_a_stalled_host_stamps_its_backlog_right():
    line, clock = Line(200.0, exponential), DeviceClock()
    stalled = slice(40 * RATE_HZ, 50 * RATE_HZ)
    line.arrival_s[stalled] = line.arrival_s[50 * RATE_HZ]
    error = line.stamps(clock) - line.true_s
    assert worst(error, 10.0) < 20e-6 and clock.report.jumps == 0


@pytest.mark.parametrize(
    ("jump_s", "worst_s", "back_s"), [(30.0, 30.0, 1.0), (0.5, 0.5, 3.0), (-3.0, 3.1, 7.0)]
)
def test_a_clock_that_jumps_or_stands_still_is_followed(jump_s, worst_s, back_s):
    line, clock = Line(200.0, exponential), DeviceClock()
    line.device_us[40 * RATE_HZ :] += int(jump_s * 1e6)
    if jump_s < 0.0:
        # A clock that stood still has not gone back: the device slept and took no samples.
        keep = np.r_[: 40 * RATE_HZ, 43 * RATE_HZ + 1 : line.true_s.size]
        line.device_us, line.arrival_s, line.true_s = (
            line.device_us[keep], line.arrival_s[keep], line.true_s[keep]
        )  # fmt: skip
    stamps = line.stamps(clock)
    error = np.abs(stamps - line.true_s)
    assert np.all(np.diff(stamps) > 0) and clock.report.jumps == 1
    assert error.max() <= worst_s
    assert error[line.true_s > 40 + 3 + back_s].max() < 2e-3
    assert clock.report.drift_ppm == pytest.approx(200.0, abs=5.0)


def test_a_long_gap_does_not_lose_the_drift():
    line, clock = Line(200.0, exponential, seconds=300), DeviceClock()
    keep = np.r_[: 60 * RATE_HZ, 260 * RATE_HZ : 300 * RATE_HZ]
    line.device_us, line.arrival_s, line.true_s = (
        line.device_us[keep],
        line.arrival_s[keep],
        line.true_s[keep],
    )
    error = line.stamps(clock) - line.true_s
    assert worst(error, 60.0) < 3e-3 and worst(error, 75.0) < 20e-6


def test_a_drift_that_changes_is_followed():
    line, clock = Line(200.0, exponential, seconds=200), DeviceClock()
    # From 80 s on it is 230 ppm, as after a change of temperature.
    line.device_us = line.device_us - np.maximum(line.true_s - 80, 0) * 30
    error = line.stamps(clock) - line.true_s
    assert clock.report.drift_ppm == pytest.approx(230.0, abs=2.0)
    assert worst(error, 20.0) < 2e-3 and worst(error, 145.0) < 20e-6


def test_a_restart_while_the_clock_is_ahead_does_not_go_back():
    clock = DeviceClock()
    # Samples that come at once are stamped apart, the later ones after their arrival.
    stamps = [clock.stamp(us, 10.0) for us in (1_000_000, 1_190_000, 1_380_000, 1_570_000)]
    stamps.append(clock.stamp(5_000, 10.1))
    assert stamps[3] > 10.1 and np.all(np.diff(stamps) > 0)


@pytest.mark.parametrize("said", [True, False])
def test_a_restart_begins_anew_and_stays_monotone(said):
    before, after = Line(200.0, exponential, seconds=20), Line(-100.0, exponential, seconds=20, seed=2)
    clock = DeviceClock()
    first = before.stamps(clock)
    after.arrival_s += 25.0
    if said:
        after.device_us += 100_000_000
        clock.restart()
    second = after.stamps(clock)
    assert np.all(np.diff(np.r_[first, second]) > 0)
    assert worst(second - after.true_s - 25.0, 10.0) < 20e-6
    assert clock.report.restarts == 1 and clock.report.drift_ppm == pytest.approx(-100.0, abs=5.0)


def test_a_clock_that_was_never_set_has_no_jitter():
    assert DeviceClock().report.jitter_s == 0.0
