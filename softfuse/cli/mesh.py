"""softfuse mesh: the mesh of a robot, measured and written to a file."""

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from softfuse.cli.options import Quiet, out_file
from softfuse.cli.progress import busy
from softfuse.cli.terminal import say, stdout
from softfuse.functional.cavity import volume_within
from softfuse.mesh.files import write_mesh
from softfuse.mesh.quality import MeshQuality, Spread, mesh_quality
from softfuse.mesh.surface import boundary_faces
from softfuse.robot.file import load
from softfuse.robot.mesh import RobotMesh, build_mesh


def mesh(
    config: Annotated[Path, typer.Argument(help="Configuration of the robot (TOML).")],
    out: Annotated[Path, out_file(help="File to write: .vtu, .vtk, .msh or .xdmf; lengths in metres.")],
    quiet: Quiet = False,
) -> None:
    """Build the mesh of a robot, write it to a file and report its quality."""
    settings = load(config)
    with busy("meshing", quiet=quiet):
        made = build_mesh(settings)
    write_mesh(out, made.mesh, point_data={"fixed": made.fixed.astype("int32")})
    if not quiet:
        names = [chamber.name for chamber in settings.chambers]
        stdout.print(quality_table(settings.robot.name, names, made))
        say(f"written to {out}")


def quality_table(name: str, chambers: list[str], made: RobotMesh) -> Table:
    """Counts, sizes in mm and mm³, and shapes of the tetrahedra, as people read them."""
    quality = mesh_quality(made.mesh)
    table = Table("", "least", "mean", "most", title=escape(f"Mesh of {name}"), title_justify="left")
    for column in table.columns[1:]:
        column.justify = "right"
    for label, value in _counts(quality, made):
        table.add_row(escape(label), "", value, "")
    for chamber, surface in zip(chambers, made.cavities, strict=True):
        label = f"volume of chamber {chamber} [mm³]"
        table.add_row(escape(label), "", f"{1e9 * volume_within(surface.faces, made.mesh.nodes):.1f}", "")
    for label, spread, factor in (
        ("edges [mm]", quality.edge_length, 1e3),
        ("volume of a tetrahedron [mm³]", quality.tet_volume, 1e9),
        ("mean ratio (1 is regular)", quality.mean_ratio, 1.0),
        ("dihedral angle [°]", quality.dihedral_angle, 1.0),
    ):
        table.add_row(escape(label), *_numbers(spread, factor))
    return table


def _counts(quality: MeshQuality, made: RobotMesh) -> list[tuple[str, str]]:
    kind = "quadratic" if quality.order == 2 else "linear"
    volume = volume_within(boundary_faces(made.mesh).faces, made.mesh.nodes)
    return [
        (f"{kind} tetrahedra", f"{quality.n_tets}"),
        ("nodes", f"{quality.n_nodes}"),
        ("corner nodes", f"{quality.n_corners}"),
        ("held nodes", f"{made.fixed.sum()}"),
        ("materials", f"{len(quality.regions)}"),
        ("volume of the material [mm³]", f"{1e9 * volume:.1f}"),
    ]


def _numbers(spread: Spread, factor: float) -> tuple[str, str, str]:
    least, mean, most = (f"{factor * value:.3g}" for value in (spread.least, spread.mean, spread.most))
    return least, mean, most
