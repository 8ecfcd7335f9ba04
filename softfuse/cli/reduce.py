"""softfuse reduce: the charts that make a robot fast enough for its sensors' rate."""

from pathlib import Path
from typing import Annotated

import typer

from softfuse.cli.options import Quiet, out_folder
from softfuse.cli.progress import busy, tracked
from softfuse.cli.terminal import say
from softfuse.io.result_folder import writing
from softfuse.robot.file import load
from softfuse.robot.reduced import Teacher, build_regions, reduction_mark
from softfuse.robot.robot import build_robot
from softfuse.rom.basis import rest_stiffness
from softfuse.rom.reduced_model import reduced_model
from softfuse.rom.rom_file import AtlasFolder


def reduce(
    config: Annotated[Path, typer.Argument(help="Configuration of the robot (TOML).")],
    out: Annotated[Path, out_folder("Folder for the charts; those that are there already stay.")],
    quiet: Quiet = False,
) -> None:
    """Reduce a robot for real time, a chart for each cell of its workspace or electrode; goes on where it
    stopped.
    """
    settings = load(config)
    regions = build_regions(settings)
    folder = AtlasFolder(out, reduction_mark(settings))
    missing = [number for number in range(len(regions)) if not folder.has(number)]
    if missing:
        with busy("meshing", quiet=quiet):
            robot = build_robot(settings)
            teacher = Teacher(robot, rest_stiffness(robot.model.body.full), regions)
        for number in tracked(missing, "reducing", total=len(missing), quiet=quiet):
            chart = teacher.chart(number)
            small = reduced_model(robot.model, teacher.stiffness, chart, [*settings.places.values()])
            with writing(out):
                folder.write(number, small, chart.basis)
    say(f"{len(regions)} charts in {out}, {len(missing)} of them new", quiet=quiet)
