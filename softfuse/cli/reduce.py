"""softfuse reduce: the charts that make a device fast enough for its sensors' rate."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from softfuse.body.body import Body
from softfuse.cli.terminal import Quiet, busy, out_folder, stdout, tracked
from softfuse.errors import SoftfuseError
from softfuse.robot.file import load
from softfuse.robot.reduced import Teacher, build_regions, reduction_mark
from softfuse.robot.robot import build_robot
from softfuse.rom.atlas import AtlasFolder
from softfuse.rom.reduced_model import reduced_model
from softfuse.rom.rest_stiffness import rest_stiffness


def reduce(
    config: Annotated[Path, typer.Argument(help="Configuration of the device (TOML).")],
    out: Annotated[Path, out_folder("Folder for the charts; those that are there already stay.")],
    quiet: Quiet = False,
) -> None:
    """Reduce a device for real time, a chart for each cell of its workspace or electrode; goes on where it
    stopped.
    """
    settings = load(config)
    regions = build_regions(settings)
    folder = AtlasFolder(out, reduction_mark(settings))
    missing = [number for number in range(len(regions)) if not folder.has(number)]
    if missing:
        with busy("meshing", quiet=quiet):
            robot = build_robot(settings)
            assert isinstance(robot.model.body, Body)
            teacher = Teacher(robot, rest_stiffness(robot.model.body), regions)
            places = np.array(list(settings.places.values())).reshape(-1, 3, 3)
        for number in tracked(missing, "reducing", total=len(missing), quiet=quiet):
            chart = teacher.chart(number)
            small = reduced_model(robot.model, teacher.stiffness, chart, places)
            try:
                folder.write(number, small, chart.basis)
            except OSError as error:
                raise SoftfuseError(f"cannot write to {out}: {error.strerror or error}") from error
    if not quiet:
        stdout.print(
            f"{len(regions)} charts in {out}, {len(missing)} of them new",
            markup=False,
            highlight=False,
            soft_wrap=True,
        )
