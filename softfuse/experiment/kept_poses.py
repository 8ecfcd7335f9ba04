"""Equilibria of virtual bodies, computed once and kept on disk (`pose_cache`), each touch or push alone."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np

from softfuse.experiment.finger_pushes import FingerSolver, Pose, Push, Steps
from softfuse.experiment.pad_electrodes import AbstractPadElectrodes
from softfuse.experiment.pad_touches import PadBed, PadTouches, check_forces
from softfuse.experiment.pose_cache import kept, settings_digest
from softfuse.experiment.virtual_finger import FingerSettings, virtual_finger
from softfuse.experiment.virtual_pad import PadSettings, Touch


def kept_pad_touches(
    folder: Path | None,
    settings: PadSettings,
    electrodes: AbstractPadElectrodes,
    touches: Sequence[Touch],
    gaps: Sequence[float],
    *,
    solved: Callable[[], None] | None = None,
) -> list[PadTouches]:
    """Touches, which must have as many forces, one by one, from the folder those that are there; None:
    computed and not kept.

    `solved` is called after each equilibrium that is computed.
    """
    check_forces(touches)
    names = frozenset(field.name for field in fields(PadTouches))
    files = [f"pad-{settings_digest(settings, electrodes, touch, tuple(gaps))}" for touch in touches]

    def start() -> Callable[[int], Mapping[str, np.ndarray]]:
        bed = PadBed(settings, electrodes, gaps)

        def compute(k: int) -> Mapping[str, np.ndarray]:
            found = bed.touched(touches[k], solved=solved)
            return {name: getattr(found, name) for name in names}

        return compute

    return [PadTouches(**arrays) for arrays in kept(folder, files, names, start)]


def kept_finger_poses(
    folder: Path | None,
    settings: FingerSettings,
    steps: Steps,
    pushes: Sequence[Push],
    *,
    solved: Callable[[], None] | None = None,
) -> list[tuple[Push, list[Pose]]]:
    """Each push and its poses, from the folder those that are there; None: computed and not kept.

    `solved` is called after each equilibrium that is computed.
    """
    names = frozenset(field.name for field in fields(Pose))
    files = [f"finger-{settings_digest(settings, steps, push)}" for push in pushes]

    def start() -> Callable[[int], Mapping[str, np.ndarray]]:
        solver = FingerSolver(virtual_finger(settings), steps)

        def compute(k: int) -> Mapping[str, np.ndarray]:
            poses = solver.poses(pushes[k], solved=solved)
            return {name: np.stack([getattr(pose, name) for pose in poses]) for name in names}

        return compute

    found = kept(folder, files, names, start)
    return [
        (push, [Pose(**{name: arrays[name][i] for name in names}) for i in range(len(arrays["cable"]))])
        for push, arrays in zip(pushes, found, strict=True)
    ]
