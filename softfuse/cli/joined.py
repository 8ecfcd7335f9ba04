"""What the frames of a recording say together: joined.csv, and its errors beside those of single frames."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from jaxtyping import Float, Int

from softfuse.cli.joined_readout import joined_columns, joined_values
from softfuse.cli.readout import Column
from softfuse.estimation.tracked import Tracked
from softfuse.estimation.tracker import Tracker
from softfuse.report import figures
from softfuse.experiment.accuracy import Samples
from softfuse.report.page import picture, table
from softfuse.fusion.fusion import Fused, Fusion, fused_recording

_TIME = Column("time_s", 4)


@dataclass(frozen=True, eq=False)
class Joined:
    """Of each frame what those up to it say, and what all frames of its touch do, of cavities with names
    and so many contacts at once.
    """

    so_far: list[Fused]
    whole: list[Fused]
    cavities: list[str]
    contacts: int

    @classmethod
    def of(cls, tracker: Tracker, found: Sequence[Tracked], cavities: list[str]) -> Self | None:
        """What the frames that a tracker has found say together; None of a device whose frames are not
        joined, see `Fusion.joins`.
        """
        if not Fusion.joins(tracker):
            return None
        return cls(*fused_recording(Fusion.of(tracker, keep=True), found), cavities, len(tracker.adding))

    def samples(self, samples: Samples, at: Int[np.ndarray, " s"]) -> dict[str, Samples]:
        """Forces at the frames (s,) of samples; places are those of single frames."""
        return {
            name: replace(
                samples,
                force_N=np.array([frames[i].force_N for i in at]),
                force_sigma_N=np.array([frames[i].force_sigma_N for i in at]),
            )
            for name, frames in (("joined", self.so_far), ("smoothed", self.whole))
        }

    def write(self, path: Path) -> None:
        """joined.csv: each frame's forces, places and, as all frames of its touch say, drifts; unknown
        numbers are empty fields.
        """
        columns = [_TIME, *joined_columns(self.contacts), *joined_columns(self.contacts, "smoothed_")]
        numbers = range(len(self.cavities))
        columns += [Column(f"drift{k}_{what}", 3) for k in numbers for what in ("mm3", "sigma_mm3")]
        with path.open("w", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow([*(each.name for each in columns), "outliers"])
            for now, whole in zip(self.so_far, self.whole, strict=True):
                values = [now.time_s, *joined_values(now), *joined_values(whole)]
                values += (1e9 * np.stack([whole.drift, whole.drift_sigma], axis=1)).ravel().tolist()
                told = [each.written(value) for each, value in zip(columns, values, strict=True)]
                writer.writerow([*told, "; ".join(self._outliers(now))])

    def numbers(self, found: Sequence[Tracked], true_N: Float[np.ndarray, " n"] | None) -> dict[str, Any]:
        """Frames with outliers, and where the truth is known the root mean square of the force's error [N]
        over all frames in which there is a force and a single frame tells it.
        """
        numbers: dict[str, Any] = {
            "reading_outliers": sum(bool(each.outlier.any()) for each in self.so_far),
            "place_outliers": sum(bool(each.place_outlier.any()) for each in self.so_far),
        }
        if true_N is None:
            return numbers
        force = np.array([[each.force_N for each in frames] for frames in (found, self.so_far, self.whole)])
        counted = (true_N > 0) & np.isfinite(force).all(axis=0)
        if not counted.any():
            return numbers
        rms = np.sqrt(np.mean((force - true_N)[:, counted] ** 2, axis=1))
        names = ("frame_by_frame", "joined", "smoothed")
        return numbers | {"force_rms_N": dict(zip(names, map(float, rms), strict=True))}

    def section(self, numbers: dict[str, Any]) -> str:
        """HTML of what joining makes of forces and drifts."""
        rows = [
            (name.replace("_", " "), str(numbers[name])) for name in ("reading_outliers", "place_outliers")
        ]
        rows += [
            (f"force of all frames, {name.replace('_', ' ')}: off by [N]", f"{value:.3f}")
            for name, value in numbers.get("force_rms_N", {}).items()
        ]
        time_s = np.array([each.time_s for each in self.whole])
        drift, sigma = (
            1e9 * np.array([getattr(each, what) for each in self.whole]).reshape(-1, len(self.cavities))
            for what in ("drift", "drift_sigma")
        )
        drawn = figures.drift_over_time(time_s, drift, sigma, self.cavities)
        caption = "What volumes drifted by, as all frames of a touch say; bands: 90 %."
        return table(("", "value"), rows) + picture(drawn, caption)

    def _outliers(self, now: Fused) -> list[str]:
        """What was not believed in a frame."""
        names = [name for name, out in zip(self.cavities, now.outlier, strict=True) if out]
        return [*names, *(["place"] if now.place_outlier.any() else [])]
