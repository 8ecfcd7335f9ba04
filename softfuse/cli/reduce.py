"""softfuse reduce: the charts that make a device fast enough for its sensors' rate."""

from pathlib import Path
from typing import Annotated

import typer

from softfuse.body.body import Body
from softfuse.cli.terminal import Quiet, busy, out_folder, stdout, tracked
from softfuse.config import load
from softfuse.config.build_device import build_device
from softfuse.config.build_reduction import Teacher, build_regions, reduction_mark
from softfuse.errors import SoftfuseError
from softfuse.estimation.atlas import AtlasFolder
from softfuse.estimation.reduced_device import reduced_device
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
            device = build_device(settings)
            assert isinstance(device.body, Body)
            teacher = Teacher(settings, device, rest_stiffness(device.body), regions)
        for number in tracked(missing, "reducing", total=len(missing), quiet=quiet):
            chart = teacher.chart(number)
            small = reduced_device(device, teacher.stiffness, chart)
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
