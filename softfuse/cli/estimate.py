"""softfuse estimate: from a recording of sensors to location, force and shape in every frame."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from jaxtyping import Bool

from softfuse.cli.finger_study import FingerStudy
from softfuse.cli.joined import Joined
from softfuse.cli.pad_study import PadStudy
from softfuse.cli.recorded import sensor_columns, sensor_frames
from softfuse.cli.recording_report import EstimateRows, all_errors, summary, write_report, write_shapes
from softfuse.cli.study import AbstractStudy, ErrorTable, Estimated
from softfuse.cli.terminal import Charts, Quiet, busy, out_folder, stdout, tracked
from softfuse.config import load
from softfuse.config.build_device import build_device
from softfuse.config.build_mesh import build_mesh
from softfuse.config.build_reduction import with_charts
from softfuse.config.build_tracker import build_tracker
from softfuse.errors import SoftfuseError
from softfuse.estimation.tracked import Frame
from softfuse.estimation.tracker import Tracker
from softfuse.hardware.recording import Recording, read_recording


def estimate(
    config: Annotated[Path, typer.Argument(help="Configuration of the device (TOML).")],
    recording: Annotated[Path, typer.Argument(help="Recording of its sensors (.csv or .csv.gz).")],
    out: Annotated[Path, out_folder("Folder for estimates.csv, joined.csv, summary.json and report.html.")],
    charts: Charts = None,
    every: Annotated[
        int, typer.Option(help="Estimate every so many frames only, and samples with truth.", min=1)
    ] = 1,
    quiet: Quiet = False,
) -> None:
    """Estimate contact location, force and shape in the frames of a recording."""
    settings = load(config)
    whole = read_recording(recording, sensor_columns(settings))
    make_folder(out)
    with busy("meshing", quiet=quiet):
        mesh = build_mesh(settings)
        device = build_device(settings, mesh)
        part = Part.of(whole, every)
        estimated = Estimated(settings, device, mesh, part.recording)
        study = study_of(estimated)
    with busy("compiling", quiet=quiet):
        tracker = build_tracker(settings, with_charts(settings, device, charts))
    frames = tracked(sensor_frames(settings, whole), "estimating", total=len(whole.time_s), quiet=quiet)
    follow(tracker, frames, part, estimated, study, out / "estimates.csv")
    joined = Joined.of(tracker, estimated.found, [cavity.name for cavity in settings.cavities])
    if joined is not None:
        joined.write(out / "joined.csv")
    write_shapes(out, estimated, study)
    numbers = summary(estimated, study, joined) | {"compile_s": tracker.compile_s}
    (out / "summary.json").write_text(json.dumps(numbers, indent=2) + "\n")
    with busy("writing the report", quiet=quiet):
        write_report(out / "report.html", estimated, study, joined, numbers)
    if not quiet:
        _tell(numbers, all_errors(study, joined), out)


@dataclass(frozen=True, eq=False)
class Part:
    """The frames of a recording that are estimated, flagged among all of its n frames, and alone."""

    estimated: Bool[np.ndarray, " n"]
    recording: Recording

    @classmethod
    def of(cls, whole: Recording, every: int) -> "Part":
        """Every so many frames, and the samples with truth."""
        estimated = np.arange(len(whole.time_s)) % every == 0
        if "sample" in whole.columns:
            estimated |= whole.columns["sample"] > 0
        return cls(estimated, whole.rows(np.flatnonzero(estimated)))


def follow(
    tracker: Tracker,
    frames: Iterable[Frame],
    part: Part,
    estimated: Estimated,
    study: AbstractStudy,
    csv: Path,
) -> None:
    """Let the tracker sense all frames and estimate a part of them, and write that down as it is found."""
    with csv.open("w", newline="") as stream:
        rows = EstimateRows(stream, estimated, study)
        for frame, wanted in zip(frames, part.estimated, strict=True):
            if not wanted:
                tracker.sense(frame)
                continue
            estimated.found.append(tracker.update(frame))
            study.see(estimated.found[-1], tracker.state)
            rows.write(len(estimated.found) - 1)


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
