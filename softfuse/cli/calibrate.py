"""softfuse calibrate: fit a robot to presses of known place and force, with what it is sure of."""

from pathlib import Path
from typing import Annotated

import typer

from softfuse.cli.options import Quiet, out_file
from softfuse.cli.progress import busy, steps
from softfuse.cli.terminal import say
from softfuse.report.calibration import calibrated_robot, check_out, tell
from softfuse.report.presses import read_sensors
from softfuse.robot.file import load
from softfuse.robot.robot import build_robot


def calibrate(
    config: Annotated[Path, typer.Argument(help="Settings of the robot (TOML).")],
    recordings: Annotated[
        list[Path], typer.Argument(help="Recordings with truth columns (.csv or .csv.gz).")
    ],
    out: Annotated[
        Path,
        out_file(help="Settings to write; beside them go a report, .html, and perhaps a file, .npz."),
    ],
    presses: Annotated[
        str | None, typer.Option(help="Values of the column `press` to use, such as 0-4; default: all.")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Fit stiffness, contact, chambers and sensors to presses of known place and force."""
    settings = load(config)
    check_out(out)
    read = [read_sensors(settings, path) for path in recordings]
    with busy("meshing", quiet=quiet):
        robot = build_robot(settings)
    with steps(quiet=quiet) as begin:
        calibrated = calibrated_robot(robot, read, out, presses=presses, seen=begin)
    say(*tell(calibrated), f"written to {out}; report: {out.with_suffix('.html')}", quiet=quiet)
