"""The truth that a recording of a finger may hold; see `experiment.finger_bed` for its columns."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count, takewhile

import numpy as np
from jaxtyping import Bool, Float, Int

from softfuse.experiment.contact_accuracy import NOWHERE
from softfuse.hardware.recording import Recording


@dataclass(frozen=True, eq=False)
class FingerTruth:
    """What is known of n frames; NaN where a field is empty, None where the recording has no such columns.

    `samples` (s,): frames that count; `press` (n,): number of the push; `level` (n,): which depth of it;
    `point_m` (n, p, 3): of the points of the config; `force_N`, `electrode` (n, t): of t contacts, none or
    more, `NOWHERE` without electrode; `cable_m` (n,): largest shortening; `tension_N` (n, b): of b cables;
    `depth_m` (n,): of the tips.
    """

    samples: Int[np.ndarray, " s"]
    press: Int[np.ndarray, " n"]
    level: Int[np.ndarray, " n"]
    point_m: Float[np.ndarray, "n p 3"] | None
    force_N: Float[np.ndarray, "n t"]
    electrode: Int[np.ndarray, "n t"]
    cable_m: Float[np.ndarray, " n"]
    tension_N: Float[np.ndarray, "n b"]
    depth_m: Float[np.ndarray, " n"] | None

    @property
    def without_force(self) -> Bool[np.ndarray, " n"]:
        """Frames (n,) in which nothing is known to press; all of them are unknown without contacts."""
        return np.all(self.force_N == 0, axis=1) & (self.force_N.shape[1] > 0)

    @property
    def without_tip(self) -> Bool[np.ndarray, " n"]:
        """Those of them in which there is nothing that could."""
        return self.without_force & np.all(self.electrode == NOWHERE, axis=1)


def finger_truth(
    recording: Recording, points: Sequence[str], cables: int, electrodes: Sequence[str] = ()
) -> FingerTruth:
    """The truth about the named points and so many cables; an electrode is said by its number or its name.

    Raises RecordingError when it holds some of the points' columns only, or a contact's force without its
    electrode.
    """
    columns, n = recording.columns, len(recording.time_s)
    names = [f"true_{name}_{axis}_mm" for name in points for axis in "xyz"]
    point = None
    if any(name in columns for name in names):
        point = 1e-3 * recording.matrix(names).reshape(n, len(points), 3)
    contacts = list(takewhile(lambda c: f"true_force{c}_N" in columns, count()))
    force = recording.matrix([f"true_force{c}_N" for c in contacts])
    named = [recording.numbered(f"true_contact{c}_electrode", electrodes, unknown=NOWHERE) for c in contacts]
    electrode = np.array(named).reshape(len(contacts), n).T
    missing = np.full(n, np.nan)
    shortening = [columns.get(f"true_cable{_which(k, cables)}_mm", missing) for k in range(cables)]
    tension = [columns.get(f"true_cable{_which(k, cables)}_N", missing) for k in range(cables)]
    level = _whole(columns.get("sample", missing), 0)
    counts = level > 0
    if point is not None:
        counts &= np.isfinite(point).all(axis=(1, 2))
    depth = columns.get("true_depth_mm")
    return FingerTruth(
        samples=np.flatnonzero(counts),
        press=_whole(columns.get("press", missing), 0),
        level=level,
        point_m=point,
        force_N=force,
        electrode=_whole(electrode, NOWHERE),
        cable_m=1e-3 * (np.max(shortening, axis=0) if cables else missing),
        tension_N=np.array(tension).reshape(cables, n).T,
        depth_m=None if depth is None else 1e-3 * depth,
    )


def _which(k: int, cables: int) -> str:
    """The only cable goes without a number."""
    return "" if cables == 1 else str(k)


def _whole(values: np.ndarray, unknown: int) -> np.ndarray:
    return np.where(np.isfinite(values), values, unknown).astype(int)
