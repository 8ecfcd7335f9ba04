"""softfuse simulate: press on a robot, pull its cables, inflate its chambers: its shape, and what its sensors
read.
"""

import json
import logging
from pathlib import Path
from typing import Annotated

import typer

from softfuse.cli.options import Quiet, out_file
from softfuse.cli.progress import busy
from softfuse.cli.terminal import say
from softfuse.errors import SolveError
from softfuse.io.result_folder import writing
from softfuse.mechanics.solution import read_state
from softfuse.mesh.files import write_mesh
from softfuse.robot.file import load
from softfuse.robot.robot import build_robot
from softfuse.robot.trial import Trial, presses_of, told

log = logging.getLogger(__name__)


def simulate(
    config: Annotated[Path, typer.Argument(help="Configuration of the robot (TOML).")],
    contact: Annotated[
        list[str] | None, typer.Option(help="Name of a contact; once for each --at where there are several.")
    ] = None,
    at: Annotated[
        list[str] | None,
        typer.Option(help="Where it presses: X,Y of its chart or X,Y,Z in mm, or the name of a place."),
    ] = None,
    force: Annotated[
        list[float] | None, typer.Option(help="Total force in N; once for each --at.", min=0.0)
    ] = None,
    depth: Annotated[
        list[float] | None,
        typer.Option(help="How deep it goes in mm, instead of --force; once for each --at.", min=0.0),
    ] = None,
    tangential: Annotated[
        list[str] | None,
        typer.Option(help='U,V: force in N along the tangents of each place, of a model = "force".'),
    ] = None,
    cable: Annotated[
        list[str] | None,
        typer.Option(help='NAME=10mm shortens a cable, NAME=2N pulls it; "10 mm" if there is only one.'),
    ] = None,
    pressure: Annotated[
        list[str] | None, typer.Option(help="NAME=20kPa: gauge pressure of a driven chamber.")
    ] = None,
    json_file: Annotated[Path | None, out_file("--json", help="File for the numbers.")] = None,
    vtu: Annotated[Path | None, out_file(help="File for the deformed mesh (VTU).")] = None,
    start: Annotated[
        Path | None,
        typer.Option(help="Begin with the state in this file, written with --json; default: at rest."),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Press on a robot or drive its actuators, and report its shape and what its sensors read.

    Where no equilibrium is found, the files hold the last one on the way there.
    """
    settings = load(config)
    with busy("meshing", quiet=quiet):
        robot = build_robot(settings)
    pressed = presses_of(contact or [], at or [], force or [], depth or [], tangential or [])
    trial = Trial.of(robot, pressed, cable or [], pressure or [])
    begin = None if start is None else read_state(start, trial.rest)
    with busy("solving", quiet=quiet):
        solution = trial.searched(begin)
    numbers = trial.numbers(solution)
    if json_file is not None:
        with writing(json_file):
            json_file.write_text(json.dumps(numbers, indent=2) + "\n", encoding="utf-8")
    if vtu is not None:
        moved = robot.model.body.displacement(solution.state.z)
        # 1 where all of the load is carried.
        reached = [numbers["reached"]] * len(moved)
        data = {"displacement": moved.__array__(), "reached": reached}
        write_mesh(vtu, robot.mesh.mesh, point_data=data)
    if not solution.success:
        kept = [str(path) for path in (json_file, vtu) if path is not None]
        raise SolveError(trial.failure(solution) + (f" ({', '.join(kept)})" if kept else ""))
    if solution.snapped:
        log.warning("%s", solution.words)
    say(told(numbers), quiet=quiet)
