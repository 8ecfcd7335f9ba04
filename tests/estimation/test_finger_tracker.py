"""The finger through its tracker, healthy and with one part broken: what is said, and that the rest goes on.

The readings are those of the estimator's own coarse model under a cable and a press on one electrode, with
the sensors' noise. How right the estimate is for a finger that is not the model is measured on the virtual
test bed.
"""

from collections.abc import Callable
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.config import load
from softfuse.config.build_device import build_device
from softfuse.config.build_tracker import build_tracker
from softfuse.estimation.device import simulate
from softfuse.estimation.tracker import Frame, Tracked, Tracker
from softfuse.sensing.status import Status

ELECTRODE, FORCE, TENSION = 7, 0.25, 1.5
RATE_HZ, REST_S, PULL_S, WAIT_S, PRESS_S, HOLD_S = 10, 2.5, 1.0, 0.8, 1.0, 1.5


@pytest.fixture(scope="module")
def tracker(linear_finger: Callable[..., Path]) -> Tracker:
    # The readings are this model's own.
    config = load(linear_finger(("\ngain = 0.96", "\ngain = 1.0")))
    return build_tracker(config, build_device(config))


@pytest.fixture(scope="module")
def frames(tracker: Tracker) -> list[Frame]:
    """Rest, the cable is pulled, something presses on one electrode and stays."""
    device = tracker.estimator.device
    sealed = jnp.full(6, 101325.0)
    places, poses = jnp.array([ELECTRODE, 0]), [np.zeros(7)]
    state = device.rest_state(places)
    for force, tension in ((0.0, TENSION / 2), (0.0, TENSION), (FORCE / 2, TENSION), (FORCE, TENSION)):
        # Both ends of the electrode are pressed equally: the contact is in its middle.
        drive = jnp.concatenate([jnp.array([force / 2, force / 2, 0.0, 0.0, tension]), sealed])
        state = simulate(device, places, drive, state).state
        poses.append(np.asarray(device.reading(state)))
    poses.insert(3, poses[2])
    steps = np.array([0, PULL_S / 2, PULL_S / 2, WAIT_S, PRESS_S / 2, PRESS_S / 2])
    ends = REST_S + np.cumsum(steps)
    time = np.arange(int(RATE_HZ * (ends[-1] + HOLD_S))) / RATE_HZ
    reading = np.stack([np.interp(time, ends, column) for column in np.array(poses).T], axis=1)
    rng = np.random.default_rng(0)
    volts = 5.0 * (0.009 * (101325.0 + reading[:, 1:]) / 1e3 - 0.095) + 2e-4 * rng.normal(size=(len(time), 6))
    counts = 5000.0 + 8.0 * rng.normal(size=(len(time), 12))
    counts[time >= REST_S + PULL_S + WAIT_S, ELECTRODE] += 2000.0
    cable = reading[:, :1] + 2e-5 * rng.normal(size=(len(time), 1))
    return [
        Frame(t, (v, np.zeros(0), np.round(c), s))
        for t, v, c, s in zip(time.tolist(), volts, counts, cable, strict=True)
    ]


Change = Callable[[int, list[np.ndarray]], None]


@pytest.fixture(scope="module")
def run(tracker: Tracker, frames: list[Frame]) -> Callable[..., list[Tracked]]:
    """run(change): all frames anew, each changed in place by change(index, readings)."""

    def go(change: Change = lambda i, readings: None) -> list[Tracked]:
        tracker.reset()
        found = []
        for i, frame in enumerate(frames):
            readings = [group.copy() for group in frame.readings]
            change(i, readings)
            found.append(tracker.update(Frame(frame.time_s, tuple(readings))))
        return found

    return go


PULLED = int(RATE_HZ * (REST_S + PULL_S + WAIT_S))


def _right(last: Tracked, *, force: float = 0.1, tension: float = 0.1) -> None:
    assert list(last.contact_force_N[last.touching]) == pytest.approx([FORCE], rel=force)
    assert last.attached[0] == pytest.approx(TENSION, rel=tension)


def test_cable_and_contact_are_found(run) -> None:
    found = run()
    assert all(row.force_N == 0.0 for row in found[: PULLED - 1])
    pulled = found[PULLED - 1]
    assert pulled.attached[0] == pytest.approx(TENSION, rel=0.1)
    assert Status.no_contact in pulled.statuses
    last = found[-1]
    assert last.contacts == 1 and last.statuses == (Status.ok,)
    _right(last)
    np.testing.assert_allclose(last.location_m[last.touching], [[0.075, 0.010, 0.010]])


def test_a_cable_that_slips_off_the_encoder_is_told_and_the_pressures_go_on(run) -> None:
    def slip(i, readings):
        if i >= PULLED - 5:
            readings[3][:] = np.nan

    last = run(slip)[-1]
    assert Status.cable_missing in last.statuses
    _right(last, force=0.2, tension=0.2)


def test_an_electrode_stuck_on_or_off_is_told_and_presses_nothing(run) -> None:
    for value in (65535.0, 0.0, 7000.0):

        def stick(i, readings, value=value):
            readings[2][1] = value

        last = run(stick)[-1]
        assert Status.electrode_lost in last.statuses, value
        assert last.contacts == 1
        _right(last)


def test_a_pressure_out_of_range_is_told_and_left_out(run) -> None:
    def clip(i, readings):
        if i >= PULLED:
            readings[0][3] = 5.0

    last = run(clip)[-1]
    assert Status.pressure_range in last.statuses
    assert np.isnan(last.misfit[1 + 3]) and np.isfinite(np.delete(last.misfit, 1 + 3)).all()
    _right(last)


def test_a_pressure_without_reading_is_told_and_left_out(run) -> None:
    def lose(i, readings):
        if i >= PULLED:
            readings[0][0] = np.nan

    last = run(lose)[-1]
    assert Status.pressure_missing in last.statuses
    _right(last)
