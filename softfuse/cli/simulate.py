"""softfuse simulate: press on a device with a known force and see its shape and volumes."""

import json
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import typer

from softfuse.cli.terminal import Quiet, busy, stdout
from softfuse.config import load
from softfuse.config.build_device import build_device, with_contact_model
from softfuse.config.build_mesh import build_mesh
from softfuse.equilibrium.punch import PunchContact
from softfuse.equilibrium.solution import RESULTS
from softfuse.errors import SoftfuseError, SolveError
from softfuse.estimation.device import Device
from softfuse.estimation.device import simulate as equilibrium_under
from softfuse.mesh.files import write_mesh


class ContactModel(StrEnum):
    """What a contact may be."""

    punch = "punch"
    uniform = "uniform"


def simulate(
    config: Annotated[Path, typer.Argument(help="Configuration of the device (TOML).")],
    at: Annotated[str, typer.Option(help="Centre of the contact, X,Y in mm.")],
    force: Annotated[float, typer.Option(help="Total force in N.", min=0.0)],
    contact: Annotated[
        ContactModel | None,
        typer.Option(help="How the force is spread; default: the config's."),
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="File for the numbers.")] = None,
    vtu: Annotated[Path | None, typer.Option(help="File for the deformed mesh (VTU).")] = None,
    quiet: Quiet = False,
) -> None:
    """Press on a device and report depth and volume changes."""
    location = parse_location(at)
    settings = load(config)
    with busy("meshing", quiet=quiet):
        mesh = build_mesh(settings)
        device = build_device(settings, mesh)
    if contact is not None:
        device = with_contact_model(device, contact.value)
    check_on_body(device, location)
    with busy("solving", quiet=quiet):
        solution = eqx.filter_jit(equilibrium_under)(
            device, jnp.asarray(location)[None], jnp.array([float(force)])
        )
        change = device.reading(solution.state)
    result = result_name(solution.result)
    if result != "converged":
        raise SolveError(f"no equilibrium at {force:g} N: {RESULTS[solution.result]}")
    numbers: dict[str, Any] = {
        "force_N": float(solution.state.drive[0]),
        "depth_mm": 1e3 * float(solution.state.internal[0]),
        "volume_change_mm3": [1e9 * float(v) for v in change],
        "nodes": device.body.n_nodes,
        "dof": device.body.n,
        "newton_iterations": int(solution.stats.newton_iterations),
        "residual_N": float(solution.stats.residual),
        "result": result,
    }
    if json_file is not None:
        json_file.write_text(json.dumps(numbers, indent=2) + "\n")
    if vtu is not None:
        displacement = np.asarray(device.body.displacement(solution.state.z))
        write_mesh(vtu, mesh.mesh, point_data={"displacement": displacement})
    if not quiet:
        volumes = ", ".join(f"{v:.2f}" for v in numbers["volume_change_mm3"])
        stdout.print(
            f"{force:g} N at ({1e3 * location[0]:g}, {1e3 * location[1]:g}) mm: "
            f"depth {numbers['depth_mm']:.4f} mm, volume changes {volumes} mm³ "
            f"({numbers['nodes']} nodes, {numbers['newton_iterations']} iterations)",
            markup=False,
            highlight=False,
            soft_wrap=True,
        )


def parse_location(text: str) -> np.ndarray:
    """X,Y in mm as (x, y, 0) in m; raises SoftfuseError when the text is something else."""
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        raise SoftfuseError(f'--at "{text}" is not a place: give X,Y in mm, such as --at 10,-6') from None
    return 1e-3 * np.array([x, y, 0.0])


def check_on_body(device: Device, location: np.ndarray) -> None:
    """Raise SoftfuseError unless the whole disc stands on the body."""
    if not isinstance(device.contact, PunchContact):
        raise SoftfuseError("this device is pressed at its electrodes, not at any place by a disc")
    disc = device.contact.at(jnp.asarray(location))
    if float(disc.overlap(device.body)) < 1.0:
        points = np.asarray(device.body.rest)[np.unique(disc.surface.faces)]
        low, high = 1e3 * points.min(axis=0), 1e3 * points.max(axis=0)
        raise SoftfuseError(
            f"the contact at ({1e3 * location[0]:g}, {1e3 * location[1]:g}) mm with radius "
            f"{1e3 * float(disc.radius):g} mm overhangs the surface, which spans "
            f"x {low[0]:g} to {high[0]:g} mm and y {low[1]:g} to {high[1]:g} mm: move it inwards"
        )


def result_name(result: RESULTS) -> str:
    """The name of a result code."""
    for name in ("converged", "diverged", "inverted", "step_limit"):
        if bool(result == getattr(RESULTS, name)):
            return name
    raise AssertionError("every result has a name")
