"""softfuse estimate: from a recording of sensors to contacts, forces and shape in every frame."""

import json
from pathlib import Path
from typing import Annotated

import typer

from softfuse.cli.options import Charts, Quiet, out_folder
from softfuse.cli.progress import busy, tracked
from softfuse.cli.terminal import say
from softfuse.estimation.stream import follow
from softfuse.estimation.tracker import Tracker
from softfuse.io.result_folder import writing
from softfuse.report.presses import Part, read_sensors, sensor_frames
from softfuse.report.recording_report import (
    EstimateRows,
    SmoothedRecording,
    all_errors,
    summary,
    words,
    write_report,
    write_shapes,
)
from softfuse.report.study import Study
from softfuse.robot.file import load
from softfuse.robot.reduced import with_charts
from softfuse.robot.robot import build_robot


def estimate(
    config: Annotated[Path, typer.Argument(help="Configuration of the robot (TOML).")],
    recording: Annotated[Path, typer.Argument(help="Recording of its sensors (.csv or .csv.gz).")],
    out: Annotated[Path, out_folder("Folder for estimates.csv, smoothed.csv, summary.json and report.html.")],
    charts: Charts = None,
    every: Annotated[
        int, typer.Option(help="Estimate every so many frames only, and samples with truth.", min=1)
    ] = 1,
    quiet: Quiet = False,
) -> None:
    """Estimate contacts, forces and shape in the frames of a recording."""
    settings = load(config)
    whole = read_sensors(settings, recording)
    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
    with busy("meshing", quiet=quiet):
        robot = build_robot(settings)
        part = Part.of(whole, every)
        study = Study(robot, part.recording)
    with busy("compiling", quiet=quiet):
        tracker = Tracker(robot, with_charts(robot, charts))
    frames = tracked(sensor_frames(settings, whole), "estimating", total=len(whole.time_s), quiet=quiet)
    with (out / "estimates.csv").open("w", newline="") as stream:
        rows = EstimateRows(stream, study)
        for now in follow(tracker, zip(frames, part.estimated, strict=True)):
            study.see(now)
            rows.write()
    smoothed = SmoothedRecording.of(tracker, study.found, study.columns)
    if smoothed is not None:
        smoothed.write(out / "smoothed.csv")
    write_shapes(out, study)
    numbers = summary(study, smoothed) | {"compile_s": tracker.compile_s}
    (out / "summary.json").write_text(json.dumps(numbers, indent=2) + "\n")
    with busy("writing the report", quiet=quiet):
        write_report(out / "report.html", study, smoothed, numbers)
    say(*words(numbers, all_errors(study, smoothed)), f"written to {out}", quiet=quiet)
