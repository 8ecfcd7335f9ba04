"""softfuse simulate: press on a device, pull its cables, and see its shape and what its sensors read."""

import json
import logging
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from softfuse.cli.disc_trial import DiscTrial
from softfuse.cli.electrode_trial import ElectrodeTrial
from softfuse.cli.terminal import Quiet, busy, stdout
from softfuse.cli.trial import AbstractTrial, Asked
from softfuse.config import load
from softfuse.config.build_device import build_device
from softfuse.config.build_mesh import build_mesh
from softfuse.errors import SolveError
from softfuse.estimation.device import simulate as equilibrium_under
from softfuse.mechanics.punch import PunchContact
from softfuse.mechanics.solution import RESULTS, read_state, result_name
from softfuse.mesh.files import write_mesh

log = logging.getLogger(__name__)


class ContactModel(StrEnum):
    """What a contact may be."""

    punch = "punch"
    uniform = "uniform"


def simulate(
    config: Annotated[Path, typer.Argument(help="Configuration of the device (TOML).")],
    at: Annotated[str | None, typer.Option(help="Centre of the contact of a disc, X,Y in mm.")] = None,
    electrode: Annotated[str | None, typer.Option(help="Name of the electrode that is pressed.")] = None,
    force: Annotated[float | None, typer.Option(help="Total force in N.", min=0.0)] = None,
    cable: Annotated[
        list[str] | None,
        typer.Option(help='By how much a cable is shortened ("10 mm") or pulled ("2 N"); once for each.'),
    ] = None,
    contact: Annotated[
        ContactModel | None,
        typer.Option(help="How the force of a disc is spread; default: the config's."),
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="File for the numbers.")] = None,
    vtu: Annotated[Path | None, typer.Option(help="File for the deformed mesh (VTU).")] = None,
    start: Annotated[
        Path | None,
        typer.Option(help="Begin with the state in this file, written with --json; default: at rest."),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Press on a device or pull its cables, and report its shape and what its sensors read.

    Where no equilibrium is found, the files hold the last one on the way there.
    """
    settings = load(config)
    with busy("meshing", quiet=quiet):
        mesh = build_mesh(settings)
        device = build_device(settings, mesh)
    model = None if contact is None else contact.value
    trial = trial_of(Asked(settings, device, mesh, force, at, model, electrode, cable or []))
    begin = None if start is None else read_state(start, trial.device.rest_state(trial.places))
    with busy("solving", quiet=quiet):
        solution = equilibrium_under(trial.device, trial.places, trial.drive, begin)
    reached = float(solution.stats.reached)
    numbers: dict[str, Any] = {
        **trial.numbers(solution.state),
        "nodes": device.body.n_nodes,
        "dof": device.body.n,
        "newton_iterations": int(solution.stats.newton_iterations),
        "residual_N": float(solution.stats.residual),
        "result": result_name(solution.result),
        "reached": reached,
        "state": solution.state.lists(),
    }
    if json_file is not None:
        json_file.write_text(json.dumps(numbers, indent=2) + "\n")
    if vtu is not None:
        displacement = np.asarray(device.body.displacement(solution.state.z))
        # 1 where all of the load is carried.
        status = np.full(len(displacement), reached)
        write_mesh(vtu, mesh.mesh, point_data={"displacement": displacement, "reached": status})
    if not solution.success:
        kept = [str(path) for path in (json_file, vtu) if path is not None]
        where = f" ({', '.join(kept)})" if kept else ""
        raise SolveError(
            f"no equilibrium at {force or 0:g} N: {RESULTS[solution.result]}. The search came "
            f"{100 * reached:.3g} % of the way{where}"
        )
    if bool(solution.result == RESULTS.snapped):
        log.warning("%s", RESULTS[solution.result])
    if not quiet:
        stdout.print(trial.told(numbers), markup=False, highlight=False, soft_wrap=True)


def trial_of(asked: Asked) -> AbstractTrial:
    """What is done to the device's kind of contact; raises SoftfuseError when it cannot be."""
    return DiscTrial(asked) if isinstance(asked.device.contact, PunchContact) else ElectrodeTrial(asked)
