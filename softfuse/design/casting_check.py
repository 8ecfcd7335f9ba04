"""Whether the solids of a casting are what can be made: closed, of the expected shape, clear of each other.

With V corners, E edges and F triangles, a solid with S closed surfaces has

    handles = S − (V − E + F) / 2

in all: 0 for a ball or a bowl, 1 for each hole that leads right through. manifold3d tells from a solid's
triangles that each edge belongs to two of them; trimesh tells it once more from what is written to a file.
"""

from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

from softfuse.design.casting import Casting, outline_solid
from softfuse.design.casting_files import RESOLUTION, named_solids, solid_shell
from softfuse.design.mould import Mould
from softfuse.errors import MeshError

if TYPE_CHECKING:
    from manifold3d import Manifold

_VOLUME = 1e-5
"""Part of its volume by which a solid may differ between two programs, or from the block it is cut from."""


@dataclass(frozen=True)
class SolidCheck:
    """A line of the table for a report: the solid's name, volume in mm³, handles (its genus, see above),
    closed surfaces, triangles in its file, and whether these are watertight.
    """

    name: str
    volume_mm3: float
    genus: int
    surfaces: int
    triangles: int
    watertight: bool


def checked_solids(casting: Casting, mould: Mould | None = None) -> tuple[SolidCheck, ...]:
    """The table of all solids that `write_casting` writes.

    Raises MeshError where one is not watertight, has no volume, or holes or surfaces that it should not have,
    where body with ports and cores do not fill the block, or where two that lie in the mould together overlap
    by more than what is rounded.
    """
    solids = named_solids(casting, mould)
    table = tuple(_line(name, solid) for name, solid in solids.items())
    outline = outline_solid(casting.outline)
    base, count = _handles(outline), len(casting.cores)
    # The first rod of a cavity joins its surface to the outside, each further one is a handle.
    open_ = base + len(casting.rods) - count
    expected = {"body": (base, 1 + count), "body_with_ports": (open_, 1)}
    if mould is not None:
        expected |= {"mould_lower": (mould.lower_holes, 1), "mould_upper": (mould.upper_holes, 1)}
    for line in table:
        genus, surfaces = expected.get(line.name, (0, 1))
        if not (line.volume_mm3 > 0.0 and line.watertight):
            raise MeshError(f"{line.name} is not a closed solid: give another chord, or thicker walls")
        if (line.genus, line.surfaces) != (genus, surfaces):
            raise MeshError(
                f"{line.name} has {line.genus} holes through it and {line.surfaces} surfaces, not "
                f"{genus} and {surfaces}: something in it touches or pierces what it should not"
            )
    _check_filled(outline, casting)
    together = {name: solid for name, solid in solids.items() if name != "body"}
    for (name, first), (other, second) in combinations(together.items(), 2):
        shared = (first ^ second).volume()
        if shared > RESOLUTION * min(first.surface_area(), second.surface_area()):
            raise MeshError(
                f"{name} and {other} overlap by {1e9 * shared:.3g} mm³: leave more room, or move them apart"
            )
    return table


def _line(name: str, solid: "Manifold") -> SolidCheck:
    import trimesh
    from manifold3d import Error

    if solid.status() != Error.NoError:
        raise MeshError(f"{name} is not a closed solid ({solid.status().name}): give another chord")
    shell = solid_shell(solid)
    written = trimesh.Trimesh(shell.nodes, shell.faces, process=False)
    same = abs(written.volume - solid.volume()) <= _VOLUME * abs(solid.volume())
    return SolidCheck(
        name=name,
        volume_mm3=1e9 * solid.volume(),
        genus=_handles(solid),
        surfaces=len(solid.decompose()),
        triangles=len(shell.faces),
        watertight=bool(written.is_watertight and written.is_winding_consistent and same),
    )


def _handles(solid: "Manifold") -> int:
    return solid.genus() + len(solid.decompose()) - 1


def _check_filled(outline: "Manifold", casting: Casting) -> None:
    cast = casting.body_with_ports.volume() + sum((core ^ outline).volume() for core in casting.cores)
    if abs(cast - outline.volume()) > _VOLUME * outline.volume():
        raise MeshError(
            f"body and cores fill {1e9 * cast:.6g} of the {1e9 * outline.volume():.6g} mm³ inside the "
            "outline: two cores overlap"
        )
