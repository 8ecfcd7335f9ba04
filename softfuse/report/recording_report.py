"""What `softfuse estimate` writes about a recording: rows, numbers, shapes and the page."""

import csv
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from softfuse.estimation.tracked import Tracked
from softfuse.mesh.files import write_mesh
from softfuse.report import figures
from softfuse.report.columns import Column
from softfuse.report.page import page, picture, spread_table, table
from softfuse.report.sections import sections
from softfuse.report.smoothing import SmoothedRecording
from softfuse.report.study import ErrorTable, Study, known_number
from softfuse.sensors.status import Status

_TIME, _LATENCY = Column("time_s", 4), Column("latency_ms", 2)


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
