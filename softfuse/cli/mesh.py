"""softfuse mesh: the mesh of a device, measured and written to a file."""

from pathlib import Path
from typing import Annotated

import jax.numpy as jnp
import typer
from rich.markup import escape
from rich.table import Table

from softfuse.cli.terminal import Quiet, busy, out_file, stdout
from softfuse.config import load
from softfuse.config.build_mesh import DeviceMesh, build_mesh
from softfuse.functional.cavity import Cavity
from softfuse.mesh.files import write_mesh
from softfuse.mesh.quality import MeshQuality, Spread, mesh_quality
from softfuse.mesh.surface import Surface, boundary_faces


def mesh(
    config: Annotated[Path, typer.Argument(help="Configuration of the device (TOML).")],
    out: Annotated[Path, out_file(help="File to write: .vtu, .vtk, .msh or .xdmf; lengths in metres.")],
    quiet: Quiet = False,
) -> None:
    """Build the mesh of a device, write it to a file and report its quality."""
    settings = load(config)
    with busy("meshing", quiet=quiet):
        device = build_mesh(settings)
    write_mesh(out, device.mesh, point_data={"fixed": device.fixed.astype("int32")})
    if not quiet:
        names = [cavity.name for cavity in settings.cavities]
        stdout.print(quality_table(settings.device.name, names, device))
        stdout.print(f"written to {out}", markup=False, highlight=False, soft_wrap=True)


def quality_table(name: str, cavities: list[str], device: DeviceMesh) -> Table:
    """Counts, sizes in mm and mm³, and shapes of the tetrahedra, as people read them."""
    quality = mesh_quality(device.mesh)
    table = Table("", "least", "mean", "most", title=escape(f"Mesh of {name}"), title_justify="left")
    for column in table.columns[1:]:
        column.justify = "right"
    for label, value in _counts(quality, device):
        table.add_row(escape(label), "", value, "")
    for cavity, surface in zip(cavities, device.cavities, strict=True):
        label = f"volume of cavity {cavity} [mm³]"
        table.add_row(escape(label), "", f"{1e9 * _within(surface, device):.1f}", "")
    for label, spread, factor in (
        ("edges [mm]", quality.edge_length, 1e3),
        ("volume of a tetrahedron [mm³]", quality.tet_volume, 1e9),
        ("mean ratio (1 is regular)", quality.mean_ratio, 1.0),
        ("dihedral angle [°]", quality.dihedral_angle, 1.0),
    ):
        table.add_row(escape(label), *_numbers(spread, factor))
    return table


def _within(surface: Surface, device: DeviceMesh) -> float:
    """Volume in m³ that a surface encloses, its edges as curved as they are."""
    return float(Cavity.of(surface.faces)(jnp.asarray(device.mesh.nodes)))


def _counts(quality: MeshQuality, device: DeviceMesh) -> list[tuple[str, str]]:
    kind = "quadratic" if quality.order == 2 else "linear"
    return [
        (f"{kind} tetrahedra", f"{quality.n_tets}"),
        ("nodes", f"{quality.n_nodes}"),
        ("corner nodes", f"{quality.n_corners}"),
        ("held nodes", f"{device.fixed.sum()}"),
        ("materials", f"{len(quality.regions)}"),
        ("volume of the material [mm³]", f"{1e9 * _within(boundary_faces(device.mesh), device):.1f}"),
    ]


def _numbers(spread: Spread, factor: float) -> tuple[str, str, str]:
    least, mean, most = (f"{factor * value:.3g}" for value in (spread.least, spread.mean, spread.most))
    return least, mean, most
