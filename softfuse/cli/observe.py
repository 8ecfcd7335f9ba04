"""softfuse observe: how well a robot would tell force and place of a contact, all over where it may be."""

from pathlib import Path
from typing import Annotated

import typer

from softfuse.cli.options import Quiet, out_folder
from softfuse.cli.progress import busy, steps
from softfuse.cli.terminal import say
from softfuse.io.result_folder import writing
from softfuse.report.observability import expected
from softfuse.robot.file import load
from softfuse.robot.robot import build_robot, require_sensors


def observe(
    config: Annotated[Path, typer.Argument(help="Configuration of the robot (TOML).")],
    out: Annotated[Path, out_folder("Folder for observability.csv and report.html.")],
    contact: Annotated[str | None, typer.Option(help="Name of the contact, if there are several.")] = None,
    force: Annotated[float, typer.Option(help="Force of the contact in N.", min=0.01)] = 5.0,
    side: Annotated[int, typer.Option(help="Places in each direction of a flat workspace.", min=2)] = 13,
    place_sigma: Annotated[
        float, typer.Option(help="How well sensors that see contacts know a place, in mm.", min=1e-6)
    ] = 0.2,
    held: Annotated[float, typer.Option(help="For how long the contact has touched, in s.", min=0.01)] = 1.0,
    quiet: Quiet = False,
) -> None:
    """Map the errors of force and place that a robot can be expected to have, before it is built."""
    settings = load(config)
    require_sensors(settings)
    settings.contact(contact)
    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
    with busy("meshing", quiet=quiet):
        robot = build_robot(settings)
    with steps(quiet=quiet) as begin:
        found = expected(
            robot,
            contact,
            force,
            side=side,
            place_sigma_m=1e-3 * place_sigma,
            held_s=held,
            begin=lambda total: begin("pressing", total),
        )
    found.write(out / "observability.csv")
    (out / "report.html").write_text(found.html(place_sigma), encoding="utf-8")
    say(*(f"{name}: {value}" for name, value in found.summary()), f"written to {out}", quiet=quiet)
