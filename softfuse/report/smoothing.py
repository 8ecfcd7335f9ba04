"""What the frames of a recording say together: smoothed.csv, and its errors beside those of single frames.

Filtered is what the frames up to each say, smoothed what all frames of its touch do.
"""

import csv
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from jaxtyping import Float, Int

from softfuse.estimation.smoothing.smoother import Smoothed, Smoother, smoothed_recording
from softfuse.estimation.tracked import Tracked
from softfuse.estimation.tracker import Tracker
from softfuse.experiment.accuracy import Samples
from softfuse.report.columns import Column, Columns, smoothed_columns, smoothed_values
from softfuse.report.figures import drift_over_time
from softfuse.report.page import picture, table
from softfuse.report.study import ErrorTable, Study, contact_errors

_TIME = Column("time_s", 4)


@dataclass(frozen=True, eq=False)
class SmoothedRecording:
    """Of each frame what those up to it say, `filtered`, and what all frames of its touch do, `smoothed`, of
    a robot with such columns, of whose readings those of some numbers drift.
    """

    filtered: list[Smoothed]
    smoothed: list[Smoothed]
    columns: Columns
    drifting: list[int]

    @classmethod
    def of(cls, tracker: Tracker, found: Sequence[Tracked], columns: Columns) -> Self | None:
        """What the frames that a tracker has found say together; None where no reading drifts."""
        if tracker.drift is None:
            return None
        smoother = Smoother.of(tracker, keep=True)
        drifting = np.flatnonzero(smoother.drifting).tolist()
        return cls(*smoothed_recording(smoother, found), columns, drifting)

    def errors(self, study: Study) -> list[ErrorTable]:
        """Errors against truth of filtered and of smoothed forces; places are those of single frames."""
        at = study.sampled
        samples = study.samples
        if samples is None or not at.size:
            return []
        return [
            contact_errors(_of(samples, frames, at), f"{name}_", f" of {name} frames")[1]
            for name, frames in (("filtered", self.filtered), ("smoothed", self.smoothed))
        ]

    def write(self, path: Path) -> None:
        """smoothed.csv: forces and places of frames, drifts as whole touches say; empty where unknown."""
        slots = self.columns.slots
        columns = [_TIME, *smoothed_columns(slots, "filtered_"), *smoothed_columns(slots, "smoothed_")]
        for name, unit in self._drifting():
            columns += [
                Column(f"{name}_{what}_{unit.suffix}", unit.digits) for what in ("drift", "drift_sigma")
            ]
        with path.open("w", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow([*(each.name for each in columns), "outliers"])
            for now, whole in zip(self.filtered, self.smoothed, strict=True):
                values = [
                    now.time_s,
                    *(v for each in (now, whole) for v in smoothed_values(each, len(slots))),
                ]
                values += self._drifts([whole]).ravel().tolist()
                told = [each.written(value) for each, value in zip(columns, values, strict=True)]
                writer.writerow([*told, "; ".join(self._outliers(now))])

    def numbers(self, found: Sequence[Tracked], true_N: Float[np.ndarray, " n"]) -> dict[str, Any]:
        """Frames with outliers, and where the truth is known the root mean square of the force's error [N]
        over all frames in which there is a force and a single frame tells it.
        """
        numbers: dict[str, Any] = {
            "reading_outliers": sum(bool(each.outlier.any()) for each in self.filtered),
            "place_outliers": sum(bool(each.place_outlier.any()) for each in self.filtered),
        }
        every = (found, self.filtered, self.smoothed)
        force = np.array([[each.force_N for each in frames] for frames in every])
        counted = (np.nan_to_num(true_N) > 0) & np.isfinite(force).all(axis=0)
        if not counted.any():
            return numbers
        rms = np.sqrt(np.mean((force - true_N)[:, counted] ** 2, axis=1))
        names = ("frame_by_frame", "filtered", "smoothed")
        return numbers | {"force_rms_N": dict(zip(names, map(float, rms), strict=True))}

    def section(self, numbers: dict[str, Any]) -> str:
        """HTML of what smoothing makes of forces and drifts."""
        rows = [
            (name.replace("_", " "), str(numbers[name])) for name in ("reading_outliers", "place_outliers")
        ]
        rows += [
            (f"force of all frames, {name.replace('_', ' ')}: off by [N]", f"{value:.3f}")
            for name, value in numbers.get("force_rms_N", {}).items()
        ]
        html = table(("", "value"), rows)
        time_s, drifts = np.array([each.time_s for each in self.smoothed]), self._drifts(self.smoothed)
        for label in dict.fromkeys(unit.label for _, unit in self._drifting()):
            shown = [k for k, (_, unit) in enumerate(self._drifting()) if unit.label == label]
            names = [self._drifting()[k][0] for k in shown]
            drawn = drift_over_time(time_s, drifts[:, shown, 0], drifts[:, shown, 1], names, label)
            html += picture(drawn, "What readings drifted by, as all frames of a touch say; bands: 90 %.")
        return html

    def _drifting(self):
        """Name and unit of each reading that drifts."""
        names = [*self.columns.readings.values()]
        return [(names[k], self.columns.units[k]) for k in self.drifting]

    def _drifts(self, frames: Sequence[Smoothed]) -> Float[np.ndarray, "n d 2"]:
        """Drifts and their standard deviations, in people's units."""
        factor = np.array([unit.factor for _, unit in self._drifting()])
        each = [np.stack([now.drift, now.drift_sigma], axis=1)[self.drifting] for now in frames]
        return np.array(each).reshape(len(frames), len(self.drifting), 2) * factor[:, None]

    def _outliers(self, now: Smoothed) -> list[str]:
        """What was not believed in a frame."""
        names = [name for name, out in zip(self.columns.readings, now.outlier, strict=True) if out]
        return [*names, *(["place"] if now.place_outlier.any() else [])]


def _of(samples: Samples, frames: Sequence[Smoothed], at: Int[np.ndarray, " s"]) -> Samples:
    """Samples with the forces of frames (s,) of theirs."""
    return replace(
        samples,
        force_N=np.array([frames[i].force_N for i in at]),
        force_sigma_N=np.array([frames[i].force_sigma_N for i in at]),
    )
