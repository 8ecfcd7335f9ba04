"""Write the bodies of configs/trunk.toml, configs/dome.toml and configs/pneunet.toml: closed surfaces as STL,
in mm.
"""

from pathlib import Path
from typing import Annotated

import manifold3d
import numpy as np
import trimesh
import typer

FOLDER = Path(__file__).parents[1] / "configs" / "bodies"

Solid = manifold3d.Manifold


def trunk() -> Solid:
    """160 mm along z, radius 18 mm at the base and 10 mm at the tip, three tapered chambers inside."""
    body = Solid.cylinder(160.0, 18.0, 10.0, 12)
    for angle in np.deg2rad([60.0, 180.0, 300.0]):
        across = np.array([np.cos(angle), np.sin(angle)])
        ends = [
            Solid.cylinder(1.0, size, size, 4).translate([*(at * across), z])
            for z, at, size in ((12.0, 8.7, 5.5), (140.0, 5.5, 3.2))
        ]
        body -= Solid.batch_hull(ends)
    return body


def dome() -> Solid:
    """Half a ball of 30 mm radius on z = 0 with walls of 7 mm: a chamber under its top, three around below
    that, 4 mm of wall between them. The wall under the top's chamber is a cone that meets the dome's wall
    between a third and half of its height: there how hard each side is pressed changes most with height.
    """
    above = box((-40.0, -40.0, 0.0), (40.0, 40.0, 40.0))
    body, hollow = Solid.sphere(30.0, 32) ^ above, Solid.sphere(23.0, 24)
    body -= hollow ^ funnel(3.5)
    around = (hollow - funnel(-1.0) - Solid.cylinder(80.0, 11.0, 11.0, 24, True)) ^ above.translate(
        [0.0, 0.0, 3.0]
    )
    apart = Solid.extrude(sector(4.0), 40.0)
    for angle in (0.0, 120.0, 240.0):
        body -= around ^ apart.rotate([0.0, 0.0, angle])
    return body


def funnel(z: float) -> Solid:
    """What is above a cone that opens upwards by 35 degrees from the tip at this height."""
    return Solid.cylinder(42.0, 0.0, 60.0, 24).translate([0.0, 0.0, z])


def sector(gap: float) -> manifold3d.CrossSection:
    """A third of the plane, around the x axis, so far inside its edges that thirds are `gap` apart."""
    tip = np.array([gap / np.sqrt(3.0), 0.0])
    far = 100.0 * np.array([[0.5, -(0.75**0.5)], [2.0, 0.0], [0.5, 0.75**0.5]])
    return manifold3d.CrossSection([np.vstack([tip, tip + far]).tolist()])


def pneunet() -> tuple[Solid, Solid]:
    """A strip of 110 x 18 mm with five bellows on it, without its chamber; and the chamber: five cells and
    the channel that connects them.
    """
    body = box((0, -9, 0), (110, 9, 6)) + box((0, -9, 0), (8, 9, 20)) + box((104, -9, 0), (110, 9, 12))
    chamber = box((10, -2.5, 2.5), (102, 2.5, 4.5))
    for x in 6.0 + 21.0 * np.arange(5):
        body += box((x, -9, 4), (x + 17, 9, 20))
        chamber += box((x + 2.5, -6.5, 4), (x + 14.5, 6.5, 17.5))
    return body, chamber


def box(low: tuple[float, ...] | np.ndarray, high: tuple[float, ...] | np.ndarray) -> Solid:
    """From one corner (3,) to the opposite one."""
    return Solid.cube(np.subtract(high, low).tolist()).translate(np.asarray(low, float).tolist())


def write(path: Path, solid: Solid) -> None:
    """One solid as a binary STL file."""
    mesh = solid.to_mesh()
    trimesh.Trimesh(np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts)).export(path)


def main(folder: Annotated[Path, typer.Argument(help="Folder for the files.")] = FOLDER) -> None:
    """Write all bodies."""
    folder.mkdir(parents=True, exist_ok=True)
    body, chamber = pneunet()
    solids = {"trunk": trunk(), "dome": dome(), "pneunet": body, "pneunet_chamber": chamber}
    for name, solid in solids.items():
        write(folder / f"{name}.stl", solid)


if __name__ == "__main__":
    typer.run(main)
