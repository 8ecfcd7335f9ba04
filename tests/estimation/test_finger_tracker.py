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

from softfuse.estimation.tracked import Frame, Tracked
from softfuse.estimation.tracker import Tracker
from softfuse.mechanics.model import simulate
from softfuse.robot.file import load
from softfuse.robot.robot import build_robot
from softfuse.sensors.status import Status

pytestmark = pytest.mark.slow

ELECTRODE, FORCE, TENSION = 7, 0.25, 1.5
GAS, ELECTRODES, CABLE = slice(0, 6), slice(6, 18), 18
"""Of raw readings, and of the readings those of the gas."""
RATE_HZ, REST_S, PULL_S, WAIT_S, PRESS_S, HOLD_S = 10, 2.5, 1.0, 0.8, 1.0, 1.5


@pytest.fixture(scope="module")
def tracker(linear_finger: Callable[..., Path]) -> Tracker:
    # The readings are this model's own.
    return Tracker(build_robot(load(linear_finger(("\ngain = 0.96", "\ngain = 1.0")))))


Poses = dict[str, np.ndarray]


@pytest.fixture(scope="module")
def poses(tracker: Tracker) -> Poses:
    """Readings (7,) of the model: gauge pressures [Pa] and shortening [m], by the name of the pose."""
    model, electrodes = tracker.robot.model, np.array(list(tracker.robot.settings.places.values()))
    sealed = jnp.full(6, 101325.0)
    places, seen = jnp.asarray(electrodes[[ELECTRODE, 0]]), {"rest": np.zeros(7)}
    state = model.rest_state(places)
    for name, force, tension in (
        ("half pulled", 0.0, TENSION / 2),
        ("pulled", 0.0, TENSION),
        ("half pressed", FORCE / 2, TENSION),
        ("pressed", FORCE, TENSION),
    ):
        # Both ends of the electrode are pressed equally: the contact is in its middle.
        drive = jnp.concatenate([jnp.array([force / 2, force / 2, 0.0, 0.0, tension]), sealed])
        state = simulate(model, places, drive, state).state
        seen[name] = np.asarray(model.reading(state))
    return seen


def sampled(poses: Poses, passed: list[tuple[float, str]]) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) s and readings (n, 7) on straight lines between the poses that are passed at given times."""
    at, names = zip(*passed, strict=True)
    time = np.arange(int(RATE_HZ * at[-1])) / RATE_HZ
    columns = np.array([poses[name] for name in names]).T
    return time, np.stack([np.interp(time, at, column) for column in columns], axis=1)


def measured(time: np.ndarray, reading: np.ndarray, touched: np.ndarray) -> list[Frame]:
    """What the sensors say of readings (n, 7), noise included, while `ELECTRODE` is touched (n,)."""
    rng = np.random.default_rng(0)
    volts = 5.0 * (0.009 * (101325.0 + reading[:, GAS]) / 1e3 - 0.095) + 2e-4 * rng.normal(
        size=(len(time), 6)
    )
    counts = 5000.0 + 8.0 * rng.normal(size=(len(time), 12))
    counts[touched, ELECTRODE] += 2000.0
    cable_mm = 1e3 * (reading[:, 6:] + 2e-5 * rng.normal(size=(len(time), 1)))
    raw = np.concatenate([volts, np.round(counts), cable_mm], axis=1)
    return [Frame(*each) for each in zip(time.tolist(), raw, strict=True)]


@pytest.fixture(scope="module")
def frames(poses: Poses) -> list[Frame]:
    """Rest, the cable is pulled, something presses on one electrode and stays."""
    names = ("rest", "half pulled", "pulled", "pulled", "half pressed", "pressed")
    spans = (0.0, PULL_S / 2, PULL_S / 2, WAIT_S, PRESS_S / 2, PRESS_S / 2)
    ends = (REST_S + np.cumsum(spans)).tolist()
    time, reading = sampled(poses, [*zip(ends, names, strict=True), (ends[-1] + HOLD_S, "pressed")])
    return measured(time, reading, time >= REST_S + PULL_S + WAIT_S)


Change = Callable[[int, np.ndarray], None]


@pytest.fixture(scope="module")
def run(tracker: Tracker, frames: list[Frame]) -> Callable[..., list[Tracked]]:
    """run(change): all frames anew, each changed in place by change(index, raw)."""

    def go(change: Change = lambda i, raw: None) -> list[Tracked]:
        tracker.reset()
        found = []
        for i, frame in enumerate(frames):
            raw = frame.raw.copy()
            change(i, raw)
            found.append(tracker.update(Frame(frame.time_s, raw)))
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


def test_the_models_error_counts_in_parts_of_the_largest_change(run) -> None:
    """Since rest while only the cable pulls, since the last clear frame while something presses."""
    found = run()
    part, gain = 0.05, 0.01  # in configs/finger.toml, of the sensors
    pulled, last = found[PULLED - 1], found[-1]
    noise = found[int(RATE_HZ * REST_S) - 1].sigma[GAS]
    largest = np.abs(pulled.reading[GAS]).max()
    assert part * largest > 0.5 * noise.max()
    own = np.hypot(noise, gain * pulled.reading[GAS])
    np.testing.assert_allclose(pulled.sigma[GAS], np.hypot(own, part * largest), rtol=0.02)
    largest = np.abs(last.reading[GAS] - pulled.reading[GAS]).max()
    assert part * largest > 0.5 * noise.max()
    own = np.hypot(noise, gain * last.reading[GAS])
    np.testing.assert_allclose(last.sigma[GAS], np.hypot(own, part * largest), rtol=0.02)


def test_what_the_model_misses_of_the_cable_makes_no_force(run, poses: Poses) -> None:
    """A finger that answers its cable with other pressures, by 15 % in every other cavity."""
    more = 5.0 * 0.009 / 1e3 * 0.15 * poses["pulled"][GAS] * np.array([1, 0, -1, 0, 1, 0])

    def misread(i, raw):
        raw[GAS] += more * np.clip((i / RATE_HZ - REST_S) / PULL_S, 0.0, 1.0)

    _right(run(misread)[-1], force=0.15)


def test_a_cable_that_slips_off_the_encoder_is_told_and_the_pressures_go_on(run) -> None:
    def slip(i, raw):
        if i >= PULLED - 5:
            raw[CABLE] = np.nan

    last = run(slip)[-1]
    assert "cable missing" in last.statuses
    _right(last, force=0.2, tension=0.2)


def test_an_electrode_stuck_on_or_off_is_told_and_presses_nothing(run) -> None:
    for value in (65535.0, 0.0, 7000.0):

        def stick(i, raw, value=value):
            raw[ELECTRODES.start + 1] = value

        last = run(stick)[-1]
        assert "electrodes lost" in last.statuses, value
        assert last.contacts == 1
        _right(last)


def test_a_pressure_out_of_range_is_told_and_left_out(run) -> None:
    def clip(i, raw):
        if i >= PULLED:
            raw[3] = 5.0

    last = run(clip)[-1]
    assert "pressure out of range" in last.statuses
    assert np.isnan(last.misfit[3]) and np.isfinite(np.delete(last.misfit, 3)).all()
    _right(last)


def test_a_pressure_without_reading_is_told_and_left_out(run) -> None:
    def lose(i, raw):
        if i >= PULLED:
            raw[0] = np.nan

    last = run(lose)[-1]
    assert "pressure missing" in last.statuses
    _right(last)


def test_a_cavity_that_leaks_is_told_after_a_release_and_left_out(tracker: Tracker, poses: Poses) -> None:
    """Bent for ten seconds, straight again, then pulled and pressed: one cavity loses its gas within 10 s."""
    cavity, loss = 1, 0.1
    ways = ["rest", "half pulled", "pulled", "pulled", "half pulled", "rest", "rest"]
    again = ["half pulled", "pulled", "half pressed", "pressed", "pressed"]
    ends = [REST_S, 3.0, 3.5, 13.5, 14.0, 14.5, 18.5, 19.0, 19.5, 20.0, 20.5, 22.0]
    time, reading = sampled(poses, list(zip(ends, ways + again, strict=True)))
    sealed, kept = reading[:, cavity].copy(), 0.0
    for i in range(1, len(time)):
        # The gas that is left follows the walls, and what is above the atmosphere goes out.
        kept += sealed[i] - sealed[i - 1] - loss * kept / RATE_HZ
        reading[i, cavity] = kept
    tracker.reset()
    found = [tracker.update(frame) for frame in measured(time, reading, time >= 19.6)]
    told = np.array(["pressure leaks" in row.statuses for row in found])
    assert not told[time < 14.5].any() and told[time >= 18.4].all()
    last = found[-1]
    assert np.isnan(last.misfit[cavity]) and np.isfinite(np.delete(last.misfit, cavity)).all()
    _right(last)
