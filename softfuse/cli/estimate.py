"""softfuse estimate: from a recording of sensors to location, force and shape in every frame."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from softfuse.cli.finger_study import FingerStudy
from softfuse.cli.pad_study import PadStudy
from softfuse.cli.recorded import sensor_columns, sensor_frames
from softfuse.cli.recording_report import EstimateRows, summary, write_report, write_shapes
from softfuse.cli.study import AbstractStudy, ErrorTable, Estimated
from softfuse.cli.terminal import Charts, Quiet, busy, stdout, tracked
from softfuse.config import load
from softfuse.config.build_device import build_device
from softfuse.config.build_mesh import build_mesh
from softfuse.config.build_reduction import with_charts
from softfuse.config.build_tracker import build_tracker
from softfuse.errors import SoftfuseError
from softfuse.hardware.recording import read_recording


def estimate(
    config: Annotated[Path, typer.Argument(help="Configuration of the device (TOML).")],
    recording: Annotated[Path, typer.Argument(help="Recording of its sensors (.csv or .csv.gz).")],
    out: Annotated[Path, typer.Option(help="Folder for estimates.csv, summary.json and report.html.")],
    charts: Charts = None,
    quiet: Quiet = False,
) -> None:
    """Estimate contact location, force and shape in every frame of a recording."""
    settings = load(config)
    frames = read_recording(recording, sensor_columns(settings))
    make_folder(out)
    with busy("meshing", quiet=quiet):
        mesh = build_mesh(settings)
        device = build_device(settings, mesh)
        estimated = Estimated(settings, device, mesh, frames)
        study = study_of(estimated)
    with busy("compiling", quiet=quiet):
        tracker = build_tracker(settings, with_charts(settings, device, charts))
    readings = sensor_frames(settings, frames)
    with (out / "estimates.csv").open("w", newline="") as stream:
        rows = EstimateRows(stream, estimated, study)
        for k, frame in enumerate(tracked(readings, "estimating", total=len(readings), quiet=quiet)):
            now = tracker.update(frame)
            estimated.found.append(now)
            study.see(now, tracker.state)
            rows.write(k)
    write_shapes(out, estimated, study)
    numbers = summary(estimated, study) | {"compile_s": tracker.compile_s}
    (out / "summary.json").write_text(json.dumps(numbers, indent=2) + "\n")
    with busy("writing the report", quiet=quiet):
        write_report(out / "report.html", estimated, study, numbers)
    if not quiet:
        _tell(numbers, study.errors, out)


def study_of(estimated: Estimated) -> AbstractStudy:
    """The study of the device's kind of sensors; raises ConfigError or RecordingError when it cannot be."""
    assert estimated.config.sensors is not None  # sensor_columns has told
    return PadStudy(estimated) if estimated.config.sensors.vented else FingerStudy(estimated)


def make_folder(folder: Path) -> None:
    """Make a folder for results; raises SoftfuseError when that is impossible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SoftfuseError(f"cannot make the folder {folder}: {error.strerror or error}") from error


def _tell(numbers: dict[str, Any], tables: Sequence[ErrorTable], out: Path) -> None:
    lines = [f"{numbers['frames']} frames, {numbers['contact_frames']} with contact"]
    if numbers["latency_ms"]["p50"] is not None:
        lines[0] += f", latency p50 {numbers['latency_ms']['p50']:.0f} ms"
    for errors in tables:
        groups = ", ".join(f"{g} {s.mean:.2f} {errors.unit}" for g, s in errors.groups.items() if s.n)
        lines.append(f"{errors.name}: {groups}")
    lines.append(f"written to {out}")
    stdout.print("\n".join(lines), markup=False, highlight=False, soft_wrap=True)
