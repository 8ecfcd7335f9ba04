"""What `softfuse estimate` writes about a recording of any device: rows, numbers and the report."""

import csv
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from softfuse.cli.joined import Joined
from softfuse.cli.readout import Column
from softfuse.cli.study import AbstractStudy, ErrorTable, Estimated, known
from softfuse.estimation.tracked import Tracked
from softfuse.report import figures
from softfuse.report.page import page, picture, spread_table, table
from softfuse.mesh.files import write_mesh
from softfuse.sensors.status import Status

_TIME, _LATENCY = Column("time_s", 4), Column("latency_ms", 2)


class EstimateRows:
    """estimates.csv, one row a frame, each written when the frame has been seen; unknown numbers are empty
    fields.
    """

    def __init__(self, stream: TextIO, estimated: Estimated, study: AbstractStudy):
        """Write the header."""
        self._stream, self._estimated, self._study = stream, estimated, study
        self._writer = csv.writer(stream)
        self._writer.writerow(
            ["time_s", *(column.name for column in study.readout.columns), "latency_ms", "status"]
        )

    def write(self, frame: int) -> None:
        """Write a frame that has been found and that the study has seen."""
        now, malformed = self._estimated.found[frame], bool(self._estimated.recording.malformed[frame])
        statuses = [str(status) for status in now.statuses if not (malformed and status is Status.ok)]
        self._writer.writerow(
            [
                _TIME.written(now.time_s),
                *(
                    column.written(value)
                    for column, value in zip(
                        self._study.readout.columns, self._study.values(frame), strict=True
                    )
                ),
                _LATENCY.written(1e3 * now.latency_s),
                "; ".join([*(["malformed row"] if malformed else []), *statuses]),
            ]
        )
        # Whoever stops a long run keeps what was found.
        self._stream.flush()


def write_shapes(folder: Path, estimated: Estimated, study: AbstractStudy) -> None:
    """The study's shapes as shape_NN.vtu, with how sure each node is."""
    for k, peak in enumerate(study.peaks):
        displacement = np.asarray(estimated.device.body.displacement(peak.state.z))
        moved = {"displacement": displacement, "displacement_sigma": estimated.shape_sigma_m(peak)}
        write_mesh(folder / f"shape_{k:02d}.vtu", estimated.mesh.mesh, point_data=moved)


def _timed(found: list[Tracked]) -> list[Tracked]:
    """The frames that took an estimate: without anything attached the body rests while nothing touches."""
    return [row for row in found if row.contacts or row.attached.size]


def all_errors(study: AbstractStudy, joined: Joined | None) -> list[ErrorTable]:
    """Errors of single frames, then those of joined ones, if there are such."""
    return [*study.errors, *([] if joined is None else study.joined_errors(joined))]


def summary(estimated: Estimated, study: AbstractStudy, joined: Joined | None) -> dict[str, Any]:
    """The numbers of summary.json: counts, latency [ms], and with truth the errors."""
    found = estimated.found
    latency = 1e3 * np.array([row.latency_s for row in _timed(found)])
    return {
        "device": estimated.config.device.name,
        "recording": str(estimated.recording.path),
        "frames": len(found),
        "contact_frames": sum(row.contacts > 0 for row in found),
        "malformed_rows": int(estimated.recording.malformed.sum()),
        "recording_complete": estimated.recording.complete,
        "nodes": estimated.device.body.n_nodes,
        "dof": estimated.device.body.n,
        "latency_ms": {
            name: float(np.quantile(latency, q)) if latency.size else None
            for name, q in (("p50", 0.5), ("p99", 0.99), ("max", 1.0))
        },
        "statuses": dict(Counter(str(status) for row in found for status in row.statuses).most_common()),
        **{
            errors.key: {
                name: asdict(spread) | {"mean": known(spread.mean), "std": known(spread.std)}
                for name, spread in errors.groups.items()
            }
            for errors in all_errors(study, joined)
        },
        **study.numbers(),
        "joined": joined and joined.numbers(found, estimated.recording.columns.get("true_force_N")),
    }


def write_report(
    path: Path, estimated: Estimated, study: AbstractStudy, joined: Joined | None, numbers: dict[str, Any]
) -> None:
    """Write report.html."""
    sections = [("Recording", _overview(numbers))]
    tables = all_errors(study, joined)
    sections += [(errors.title, spread_table(errors.unit, errors.groups)) for errors in tables]
    sections += study.sections()
    if joined is not None:
        sections.append(("Joined frames", joined.section(numbers["joined"])))
    timed = _timed(estimated.found)
    if timed:
        latency = np.array([1e3 * row.latency_s for row in timed])
        caption = "Every frame." if len(timed) == len(estimated.found) else "Frames with contact."
        sections.append(("Latency", picture(figures.latencies(latency), caption)))
    path.write_text(page(f"{numbers['device']}: {estimated.recording.path.name}", sections), encoding="utf-8")


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
