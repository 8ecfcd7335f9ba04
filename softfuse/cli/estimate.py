"""softfuse estimate: from a recording of sensors to location, force and shape in every frame."""

import csv
import json
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from softfuse.cli.recorded import sensor_columns, sensor_frames
from softfuse.cli.recording_report import Estimated, Peaks, summary, write_report
from softfuse.cli.terminal import Quiet, busy, stdout, tracked
from softfuse.config import load
from softfuse.config.build_device import build_device
from softfuse.config.build_mesh import build_mesh
from softfuse.config.build_tracker import build_tracker
from softfuse.errors import SoftfuseError
from softfuse.estimation.tracker import Tracked
from softfuse.hardware.recording import Recording, read_recording
from softfuse.mesh.files import write_mesh
from softfuse.sensing.status import Status


def estimate(
    config: Annotated[Path, typer.Argument(help="Configuration of the device (TOML).")],
    recording: Annotated[Path, typer.Argument(help="Recording of its sensors (.csv or .csv.gz).")],
    out: Annotated[Path, typer.Option(help="Folder for estimates.csv, summary.json and report.html.")],
    quiet: Quiet = False,
) -> None:
    """Estimate contact location, force and shape in every frame of a recording."""
    settings = load(config)
    frames = read_recording(recording, sensor_columns(settings))
    make_folder(out)
    with busy("meshing", quiet=quiet):
        mesh = build_mesh(settings)
        device = build_device(settings, mesh)
    with busy("compiling", quiet=quiet):
        tracker = build_tracker(settings, device)
    found: list[Tracked] = []
    peaks = Peaks()
    for i, frame in enumerate(
        tracked(sensor_frames(settings, frames), "estimating", total=len(frames.time_s), quiet=quiet)
    ):
        now = tracker.update(frame)
        peaks.see(i, now, tracker.state.z)
        found.append(now)
    estimated = Estimated(settings, device, mesh, frames, found, peaks.kept)
    write_estimates(out / "estimates.csv", frames, found)
    for number, peak in enumerate(peaks.kept):
        displacement = np.asarray(device.body.displacement(peak.z))
        write_mesh(out / f"shape_{number:02d}.vtu", mesh.mesh, point_data={"displacement": displacement})
    numbers = summary(estimated) | {"compile_s": tracker.compile_s}
    (out / "summary.json").write_text(json.dumps(numbers, indent=2) + "\n")
    with busy("writing the report", quiet=quiet):
        write_report(out / "report.html", estimated, numbers)
    if not quiet:
        _tell(numbers, out)


def make_folder(folder: Path) -> None:
    """Make a folder for results; raises SoftfuseError when that is impossible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SoftfuseError(f"cannot make the folder {folder}: {error.strerror or error}") from error


def write_estimates(path: Path, recording: Recording, found: list[Tracked]) -> None:
    """One row a frame in mm, N, mm³ and ms; unknown numbers are empty fields."""
    cavities = len(found[0].reading) if found else 0
    head = ["time_s", "contacts", "x_mm", "y_mm", "force_N", *(f"dV{k}_mm3" for k in range(cavities))]
    with path.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow([*head, "residual", "latency_ms", "status"])
        for row, malformed in zip(found, recording.malformed, strict=True):
            statuses = [str(status) for status in row.statuses if not (malformed and status is Status.ok)]
            writer.writerow(
                [
                    _number(row.time_s, 4),
                    row.contacts,
                    *(_number(1e3 * x, 3) for x in row.centre_m[:2]),
                    _number(row.force_N, 4),
                    *(_number(1e9 * v, 3) for v in row.reading),
                    _number(1e9 * row.residual, 3),
                    _number(1e3 * row.latency_s, 2),
                    "; ".join([*(["malformed row"] if malformed else []), *statuses]),
                ]
            )


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else ""


def _tell(numbers: dict[str, Any], out: Path) -> None:
    lines = [f"{numbers['frames']} frames, {numbers['contact_frames']} with contact"]
    if numbers["latency_ms"]["p50"] is not None:
        lines[0] += f", latency p50 {numbers['latency_ms']['p50']:.0f} ms"
    for name, key, unit in (
        ("location error", "location_error_mm", "mm"),
        ("force error", "force_error_percent", "%"),
    ):
        if key in numbers:
            groups = ", ".join(f"{g} {s['mean']:.2f} {unit}" for g, s in numbers[key].items() if s["n"])
            lines.append(f"{name}: {groups}")
    lines.append(f"written to {out}")
    stdout.print("\n".join(lines), markup=False, highlight=False, soft_wrap=True)
