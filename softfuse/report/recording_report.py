"""What `softfuse estimate` writes about a recording: rows, numbers, shapes and the page."""

import csv
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Self, TextIO

import numpy as np
from jaxtyping import Float, Int

from softfuse.estimation.smoothing.smoother import Smoothed, Smoother, smoothed_recording
from softfuse.estimation.tracked import Tracked
from softfuse.estimation.tracker import Tracker
from softfuse.experiment.accuracy import Samples
from softfuse.mesh.files import write_mesh
from softfuse.report import figures
from softfuse.report.columns import Column, Columns, smoothed_columns, smoothed_values
from softfuse.report.figures import drift_over_time
from softfuse.report.page import page, picture, spread_table, table
from softfuse.report.sections import sections
from softfuse.report.study import ErrorTable, Study, contact_errors, known_number
from softfuse.sensors.status import Status

_TIME, _LATENCY = Column("time_s", 4), Column("latency_ms", 2)


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


class EstimateRows:
    """estimates.csv, a row a frame, written once the frame is seen; unknown numbers are empty fields."""

    def __init__(self, stream: TextIO, study: Study):
        """Write the header."""
        self._stream, self._study = stream, study
        self._writer = csv.writer(stream)
        names = [column.name for column in study.columns.columns]
        self._writer.writerow(["time_s", *names, "latency_ms", "status"])

    def write(self) -> None:
        """Write the last frame that the study has seen."""
        study, frame = self._study, len(self._study.found) - 1
        now, malformed = study.found[frame], bool(study.recording.malformed[frame])
        statuses = [str(status) for status in now.statuses if not (malformed and status is Status.ok)]
        each = zip(study.columns.columns, study.values(frame), strict=True)
        self._writer.writerow(
            [
                _TIME.written(now.time_s),
                *(column.written(value) for column, value in each),
                _LATENCY.written(1e3 * now.latency_s),
                "; ".join([*(["malformed row"] if malformed else []), *statuses]),
            ]
        )
        # Whoever stops a long run keeps what was found.
        self._stream.flush()


def write_shapes(folder: Path, study: Study) -> None:
    """The study's shapes as shape_NN.vtu, with how sure each node is."""
    for k, peak in enumerate(study.peaks):
        displacement = np.asarray(study.robot.model.body.displacement(peak.estimate.state.z))
        moved = {"displacement": displacement, "displacement_sigma": study.shape_sigma_m(peak)}
        write_mesh(folder / f"shape_{k:02d}.vtu", study.robot.mesh.mesh, point_data=moved)


def _timed(found: list[Tracked]) -> list[Tracked]:
    """The frames that took an estimate: without actuators the body rests while nothing touches."""
    return [row for row in found if row.contacts or row.attached.size]


def all_errors(study: Study, smoothed: SmoothedRecording | None) -> list[ErrorTable]:
    """Errors of single frames, then those of filtered and smoothed ones, if there are such."""
    return [*study.errors, *([] if smoothed is None else smoothed.errors(study))]


def summary(study: Study, smoothed: SmoothedRecording | None) -> dict[str, Any]:
    """The numbers of summary.json: counts, latency [ms], and with truth the errors."""
    found, robot = study.found, study.robot
    latency = 1e3 * np.array([row.latency_s for row in _timed(found)])
    return {
        "robot": robot.name,
        "recording": str(study.recording.path),
        "frames": len(found),
        "contact_frames": sum(row.contacts > 0 for row in found),
        "malformed_rows": int(study.recording.malformed.sum()),
        "recording_complete": study.recording.complete,
        "nodes": robot.model.body.n_nodes,
        "dof": robot.model.body.n,
        "latency_ms": {
            name: float(np.quantile(latency, q)) if latency.size else None
            for name, q in (("p50", 0.5), ("p99", 0.99), ("max", 1.0))
        },
        "statuses": dict(Counter(str(status) for row in found for status in row.statuses).most_common()),
        **{
            errors.key: {
                name: asdict(spread) | {"mean": known_number(spread.mean), "std": known_number(spread.std)}
                for name, spread in errors.groups.items()
            }
            for errors in all_errors(study, smoothed)
        },
        **study.numbers(),
        "smoothing": smoothed and smoothed.numbers(found, study.truth.get("force_N")),
    }


def write_report(
    path: Path, study: Study, smoothed: SmoothedRecording | None, numbers: dict[str, Any]
) -> None:
    """Write report.html."""
    parts = [("Recording", _overview(numbers))]
    tables = all_errors(study, smoothed)
    parts += [(errors.title, spread_table(errors.unit, errors.groups)) for errors in tables]
    parts += sections(study)
    if smoothed is not None:
        parts.append(("Smoothed frames", smoothed.section(numbers["smoothing"])))
    timed = _timed(study.found)
    if timed:
        latency = np.array([1e3 * row.latency_s for row in timed])
        caption = "Every frame." if len(timed) == len(study.found) else "Frames with contact."
        parts.append(("Latency", picture(figures.latencies(latency), caption)))
    path.write_text(page(f"{numbers['robot']}: {study.recording.path.name}", parts), encoding="utf-8")


def words(numbers: dict[str, Any], tables: list[ErrorTable]) -> list[str]:
    """The lines that a terminal shows."""
    lines = [f"{numbers['frames']} frames, {numbers['contact_frames']} with contact"]
    if numbers["latency_ms"]["p50"] is not None:
        lines[0] += f", latency p50 {numbers['latency_ms']['p50']:.0f} ms"
    for errors in tables:
        groups = ", ".join(f"{g} {s.mean:.2f} {errors.unit}" for g, s in errors.groups.items() if s.n)
        lines.append(f"{errors.name}: {groups}")
    return lines


def _overview(numbers: dict[str, Any]) -> str:
    rows = [
        ("frames", str(numbers["frames"])),
        ("frames with contact", str(numbers["contact_frames"])),
        ("rows that could not be read in full", str(numbers["malformed_rows"])),
        ("nodes of the model", str(numbers["nodes"])),
        ("unknowns of the model", str(numbers["dof"])),
    ]
    if numbers["latency_ms"]["p50"] is not None:
        rows += [(f"latency {name} [ms]", f"{v:.1f}") for name, v in numbers["latency_ms"].items()]
    if "samples" in numbers:
        rows.append(("samples with truth", str(numbers["samples"])))
        rows.append(("samples without an estimate", str(numbers["samples_without_estimate"])))
    statuses = [(name, str(count)) for name, count in numbers["statuses"].items()]
    return table(("", "value"), rows) + table(("status", "frames"), statuses)
