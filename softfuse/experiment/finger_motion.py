"""How a virtual finger moves in time: equilibria passed through at constant speeds, held, and left again.

Quasi-static: every frame is an equilibrium, interpolated linearly between those that were computed. Each
push begins at rest with the tips away: sensors take their zeros there and leaks are looked for.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float, Int

from softfuse.experiment.finger_pushes import Pose, Push
from softfuse.experiment.virtual_finger import electrode_index

_ROUNDING = 1e-6
"""Frames by which a sum of durations may be off."""


@dataclass(frozen=True)
class Timing:
    """Frames per second; speeds in m/s of cable and tips; seconds at rest before each push and at the end,
    under the cable before the tips come, and at each depth.
    """

    rate_Hz: float = 100.0
    cable_m_s: float = 5e-3
    tip_m_s: float = 20e-3
    rest_s: float = 5.0
    settle_s: float = 1.5
    hold_s: float = 1.0


@dataclass(frozen=True, eq=False)
class Motion:
    """n frames: time (n,) s; press (n,) from 0; sample (n,): 1, 2 ... in the middle of the hold of the first,
    second ... depth, of the cable in a push without tips, 0 otherwise; electrode (n, c) that each tip faces,
    -1 where there is none; poses with n as leading axis.
    """

    time: Float[np.ndarray, " n"]
    press: Int[np.ndarray, " n"]
    sample: Int[np.ndarray, " n"]
    electrode: Int[np.ndarray, "n c"]
    poses: Pose


class _Timeline:
    """Poses with the times at which they are passed, and the times of samples."""

    def __init__(self, timing: Timing) -> None:
        self._timing = timing
        self._now = 0.0
        self.times: list[float] = []
        self.poses: list[Pose] = []
        self.starts: list[float] = []
        self.samples: list[tuple[float, int]] = []

    def push(self, push: Push, poses: Sequence[Pose]) -> None:
        """Rest, pass through the poses of a push and come back."""
        self.starts.append(self._now)
        self._reach(poses[0])
        self._wait(self._timing.rest_s)
        held = list(push.depths)
        for before, pose in zip(poses[:-1], poses[1:], strict=True):
            self._ramp(before, pose)
            if pose.depth < 0 and pose.cable == push.cable:
                self._wait(self._timing.settle_s, sample=0 if held else 1)
            elif held and pose.depth == held[0]:
                held.pop(0)
                self._wait(self._timing.hold_s, sample=len(push.depths) - len(held))
        for before, pose in zip(poses[:0:-1], poses[-2::-1], strict=True):
            self._ramp(before, pose)

    def end(self) -> None:
        """Rest once more."""
        self._wait(self._timing.rest_s)

    def _reach(self, pose: Pose) -> None:
        self.times.append(self._now)
        self.poses.append(pose)

    def _ramp(self, before: Pose, pose: Pose) -> None:
        cable = abs(float(pose.cable - before.cable)) / self._timing.cable_m_s
        self._now += max(cable, abs(float(pose.depth - before.depth)) / self._timing.tip_m_s)
        self._reach(pose)

    def _wait(self, duration: float, *, sample: int = 0) -> None:
        if sample:
            self.samples.append((self._now + 0.5 * duration, sample))
        self._now += duration
        self._reach(self.poses[-1])


def motion(pushes: Iterable[tuple[Push, Sequence[Pose]]], timing: Timing) -> Motion:
    """The frames of pushes, one after the other, through their poses (see `FingerSolver.poses`)."""
    pushes = list(pushes)
    line = _Timeline(timing)
    for push, poses in pushes:
        line.push(push, poses)
    line.end()
    time = np.arange(int(line.times[-1] * timing.rate_Hz + _ROUNDING) + 1) / timing.rate_Hz
    press = np.searchsorted(line.starts, time + _ROUNDING / timing.rate_Hz, side="right") - 1
    sample = np.zeros(len(time), int)
    for at, number in line.samples:
        sample[int(np.rint(at * timing.rate_Hz))] = number
    faced = np.array([_faced(push, poses[0]) for push, poses in pushes])
    # Tips change places between two pushes at one instant; a tiny later one keeps the times increasing.
    keys = np.array(line.times) + 1e-9 * np.arange(len(line.times))
    frames = {
        field.name: _interpolated(time, keys, np.stack([getattr(pose, field.name) for pose in line.poses]))
        for field in fields(Pose)
    }
    return Motion(time=time, press=press, sample=sample, electrode=faced[press], poses=Pose(**frames))


def _faced(push: Push, pose: Pose) -> Int[np.ndarray, " c"]:
    numbers = np.full(len(pose.force), -1)
    for k, place in enumerate(push.contacts):
        numbers[k] = electrode_index(*place)
    return numbers


def _interpolated(
    time: Float[np.ndarray, " n"], keys: Float[np.ndarray, " m"], values: Float[np.ndarray, "m *s"]
) -> Float[np.ndarray, "n *s"]:
    """Values (m, *s) at increasing times (m,) s, linearly between them at times (n,) s."""
    columns = values.reshape(len(values), -1).T
    frames = np.stack([np.interp(time, keys, column) for column in columns], axis=1)
    return frames.reshape(len(time), *values.shape[1:])
