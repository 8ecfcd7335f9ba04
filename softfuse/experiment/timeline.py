"""Episodes in time: a virtual robot passes through its equilibria, rests in some and goes back.

All ways are passed as s(τ) = τ² (3 − 2τ) of the elapsed share τ of their time, so that no flow jumps. In
between equilibria values are monotone cubics of the actuators' way, of the gap in air, and of force and depth
together (Fritsch and Carlson, SIAM J. Numer. Anal. 17 (1980) 238). Each episode begins with a rest: sensors
take their zeros there, and leaks are looked for. From one episode to the next, what touches goes over to the
next place.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.interpolate import PchipInterpolator

from softfuse.experiment.pose_cache import Arrays


@dataclass(frozen=True)
class Timing:
    """Rows per second; seconds at rest, of the actuators' way and of the hold after it, of going over to the
    next place, of holding a force, and in which forces rise to the largest of an episode, and fall from it;
    speed through the air in m/s.
    """

    rate_Hz: float = 100.0
    rest_s: float = 3.0
    drive_s: float = 2.0
    settle_s: float = 1.5
    travel_s: float = 1.0
    hold_s: float = 1.0
    press_s: float = 2.5
    release_s: float = 3.0
    air_m_s: float = 20e-3


@dataclass(frozen=True, eq=False)
class Frames:
    """n rows: time (n,) s; number of the episode (n,); sample (n,): 1, 2 ... at one row in the middle of the
    hold of the first, second ... force, of the actuators' hold where nothing touches, else 0; and the values
    of the equilibria, see `RobotSolver.poses`, with n as leading axis.
    """

    time_s: Float[np.ndarray, " n"]
    episode: Int[np.ndarray, " n"]
    sample: Int[np.ndarray, " n"]
    values: Arrays


class _Rows:
    """The rows so far, with the values of each; a way leads through some equilibria in a row, whose values it
    gives (m, q) as far along it as each is (m,).
    """

    def __init__(self, rate_Hz: float) -> None:
        self._rate = rate_Hz
        self.values: list[np.ndarray] = []
        self.episode: list[np.ndarray] = []
        self.sample: list[np.ndarray] = []

    def _add(self, values: np.ndarray, episode: int, sample: int) -> None:
        count = len(values)
        self.values.append(values)
        self.episode.append(np.full(count, episode))
        self.sample.append(np.where(np.arange(count) == count // 2, sample, 0))

    def stay(
        self, way: PchipInterpolator, along: float, seconds: float, episode: int, *, sample: int = 0
    ) -> None:
        count = max(2, round(seconds * self._rate))
        self._add(np.repeat(way(np.array([along])), count, axis=0), episode, sample)

    def go(self, way: PchipInterpolator, start: float, end: float, seconds: float, episode: int) -> None:
        count = max(2, round(seconds * self._rate))
        share = np.arange(count) / count
        self._add(way(start + (end - start) * share**2 * (3.0 - 2.0 * share)), episode, 0)


def frames(passed: Sequence[Arrays], timing: Timing = Timing()) -> Frames:
    """The rows of episodes one after the other, through their equilibria; the last leads to the first."""
    rows = _Rows(timing.rate_Hz)
    tables = [_table(each) for each in passed]
    for k, (poses, table) in enumerate(zip(passed, tables, strict=True)):
        _episode(rows, poses, table, k, timing)
        following = tables[(k + 1) % len(tables)]
        over = PchipInterpolator(np.array([0.0, 1.0]), np.stack([table[0], following[0]]))
        rows.go(over, 0.0, 1.0, timing.travel_s, k)
    values = np.concatenate(rows.values)
    return Frames(
        np.arange(len(values)) / timing.rate_Hz,
        np.concatenate(rows.episode),
        np.concatenate(rows.sample),
        _untabled(values, passed[0]),
    )


def _episode(rows: _Rows, poses: Arrays, table: np.ndarray, number: int, timing: Timing) -> None:
    """Rest, drive, come near, press and hold, and all the way back."""
    gap, total = poses["gap"].min(axis=1, initial=np.inf), poses["force"].sum(axis=1)
    pressed = (total > 0) | (gap < 0)
    near = ~pressed & (gap < gap[0])
    driven = int(np.sum(~pressed & ~near)) - 1
    ends = driven, driven + int(near.sum())
    on_way = table[: driven + 1] if driven else np.repeat(table[:1], 2, axis=0)
    drive = PchipInterpolator(np.linspace(0.0, 1.0, len(on_way)), on_way)
    rows.stay(drive, 0.0, timing.rest_s, number)
    if driven:
        rows.go(drive, 0.0, 1.0, timing.drive_s, number)
        rows.stay(drive, 1.0, timing.settle_s, number, sample=0 if pressed.any() else 1)
    if pressed.any():
        air = PchipInterpolator(-gap[ends[0] : ends[1] + 1], table[ends[0] : ends[1] + 1])
        push = PchipInterpolator(_along(total[ends[1] :], -gap[ends[1] :]), table[ends[1] :])
        far, at = -gap[0], 0.0
        rows.go(air, far, 0.0, -far / timing.air_m_s, number)
        held = push.x[poses["held"][ends[1] :] > 0]
        for level, here in enumerate(held, start=1):
            rows.go(push, at, here, timing.press_s * (here - at), number)
            rows.stay(push, here, timing.hold_s, number, sample=level)
            at = here
        rows.go(push, at, 0.0, timing.release_s, number)
        rows.go(air, 0.0, far, -far / timing.air_m_s, number)
    if driven:
        rows.go(drive, 1.0, 0.0, timing.drive_s, number)


def _along(force: Float[np.ndarray, " m"], depth: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
    """From 0 to 1 as a force and a depth increase together, one of which always does."""
    steps = sum(np.diff(each) / np.ptp(each) for each in (force, depth) if np.ptp(each) > 0)
    along = np.concatenate([[0.0], np.cumsum(np.maximum(steps, 1e-6))])
    return along / along[-1]


def _table(poses: Arrays) -> Float[np.ndarray, "m q"]:
    """All values of each equilibrium in a row."""
    return np.concatenate([poses[name].reshape(len(poses[name]), -1) for name in sorted(poses)], axis=1)


def _untabled(table: Float[np.ndarray, "n q"], like: Arrays) -> Arrays:
    """The values again by their names and shapes, but for the first axis as those of one."""
    names = sorted(like)
    shapes = [like[name].shape[1:] for name in names]
    cuts = np.cumsum([int(np.prod(shape)) for shape in shapes])[:-1]
    return {
        name: part.reshape(len(table), *shape)
        for name, shape, part in zip(names, shapes, np.split(table, cuts, axis=1), strict=True)
    }
