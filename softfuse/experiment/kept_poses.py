"""Equilibria of virtual bodies, computed once and kept on disk (`pose_cache`)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np

from softfuse.experiment.finger_pushes import FingerSolver, Pose, Push, Steps
from softfuse.experiment.pad_electrodes import AbstractPadElectrodes
from softfuse.experiment.pad_touches import PadTouches, pad_touches
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
) -> PadTouches:
    """What `pad_touches` gives, from the folder if it is there; None: computed and not kept."""
    names = frozenset(field.name for field in fields(PadTouches))

    def compute() -> Mapping[str, np.ndarray]:
        found = pad_touches(settings, electrodes, touches, gaps, solved=solved)
        return {name: getattr(found, name) for name in names}

    digest = settings_digest(settings, electrodes, tuple(touches), tuple(gaps))
    return PadTouches(**kept(folder, f"pad-{digest}", names, compute))


def kept_finger_poses(
    folder: Path | None,
    settings: FingerSettings,
    steps: Steps,
    pushes: Sequence[Push],
    *,
    solved: Callable[[], None] | None = None,
) -> list[tuple[Push, list[Pose]]]:
    """Each push and its poses, from the folder if they are there; None: computed and not kept."""
    parts = [field.name for field in fields(Pose)]
    names = frozenset(f"{part}_{k}" for k in range(len(pushes)) for part in parts)

    def compute() -> Mapping[str, np.ndarray]:
        solver = FingerSolver(virtual_finger(settings), steps)
        arrays: dict[str, np.ndarray] = {}
        for k, push in enumerate(pushes):
            poses = solver.poses(push, solved=solved)
            arrays |= {f"{part}_{k}": np.stack([getattr(pose, part) for pose in poses]) for part in parts}
        return arrays

    arrays = kept(folder, f"finger-{settings_digest(settings, steps, tuple(pushes))}", names, compute)
    found = []
    for k, push in enumerate(pushes):
        count = len(arrays[f"cable_{k}"])
        poses = [Pose(**{part: arrays[f"{part}_{k}"][i] for part in parts}) for i in range(count)]
        found.append((push, poses))
    return found
