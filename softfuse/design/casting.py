"""The solids of a layout that is to be cast: its body, with ports or without, and a core for each cavity.

A closed cavity is cast around a core, of wax, of a plastic that dissolves or of something soft enough to be
pulled out, which a rod holds in the mould (see `port`, `mould`); what the rod leaves open is the port of the
tube. Without ports the body is what is simulated, and what a printer makes that prints the material itself.

The triangles of a cavity are `facets` within nine tenths of a chord tolerance of its surface; those that lie
in a plane up to the other tenth are joined, which leaves few of them on the flat sides of a box. So with a
tolerance ε and a surface A, a volume is off by less than ε A.

Boolean operations are those of manifold3d, whose results are closed surfaces again. All lengths are in
metres, in the solids too; only files are in millimetres, see `casting_files`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.design.facets import facets
from softfuse.design.port import Port, Rod, box_solid, check_rods, placed
from softfuse.errors import MeshError, SoftfuseError
from softfuse.mesh.block import Block
from softfuse.robot.layout.cavity_shape import CavityShape
from softfuse.robot.layout.layout import AbstractLayout

if TYPE_CHECKING:
    from manifold3d import Manifold

_CURVED = 0.9
"""Part of a tolerance that facets may take; with more for joining them, flat sides become uneven."""

_NOTHING = 1e-9
"""Part of a solid's volume below which it is taken for none."""


@dataclass(frozen=True, eq=False)
class Casting:
    """What a layout is cast as [m]: the body as designed, the body with ports, and a core with its rods for
    each cavity, called `names`; besides, its outline and the rods, within `chord` m.
    """

    outline: Block
    body: "Manifold"
    body_with_ports: "Manifold"
    cores: tuple["Manifold", ...]
    names: tuple[str, ...]
    rods: tuple[Rod, ...]
    chord: float


def casting(
    layout: AbstractLayout,
    theta: Float[Array | np.ndarray, " p"],
    ports: Sequence[Port],
    *,
    beyond: float,
    wall: float,
    chord: float,
    names: Sequence[str] | None = None,
) -> Casting:
    """The solids of a layout with parameters (p,) whose cavities have these ports, at least one each.

    beyond: how far in m the rods reach out of the body; wall: what they keep in m from all else, see
    `check_rods`; chord: tolerance in m of curved surfaces; names: of the cavities, else their numbers. Raises
    SoftfuseError where a cavity has no port or names do not fit, and as `cavity_solids`, `placed` and
    `check_rods` do.
    """
    from manifold3d import Manifold, OpType

    count = len(layout.shapes)
    called = tuple(str(k) for k in range(count)) if names is None else tuple(names)
    if len(called) != count or len(set(called)) != count:
        raise SoftfuseError(f"{count} cavities need as many names that differ, not {list(called)}")
    rods = tuple(placed(layout, theta, port, beyond=beyond) for port in ports)
    without = sorted(set(range(count)) - {rod.cavity for rod in rods})
    if without:
        raise SoftfuseError(
            f"cavity {without[0]} has no port, so nothing would hold its core: add one, see nearest_ports"
        )
    cavities = cavity_solids(layout, theta, chord)
    check_rods(layout, rods, cavities, wall=wall, chord=chord)
    cores = tuple(
        Manifold.batch_boolean([cavity, *(rod.solid(chord) for rod in rods if rod.cavity == k)], OpType.Add)
        for k, cavity in enumerate(cavities)
    )
    return Casting(
        outline=layout.outline,
        body=body_solid(layout.outline, cavities),
        body_with_ports=body_solid(layout.outline, cores),
        cores=cores,
        names=called,
        rods=rods,
        chord=chord,
    )


def outline_solid(outline: Block) -> "Manifold":
    """The block less its notches [m]: the body without cavities.

    Raises MeshError where the block or a notch has no volume, or what is left is not in one piece.
    """
    from manifold3d import Manifold, OpType

    outline.check()
    solid = Manifold.batch_boolean(
        [
            box_solid(outline.low, outline.high),
            *(notch_solid(outline, k) for k in range(len(outline.notches))),
        ],
        OpType.Subtract,
    )
    pieces = len(solid.decompose())
    if pieces != 1:
        raise MeshError(f"the notches leave {pieces} pieces of the block, not one: make them smaller")
    return solid


def notch_solid(outline: Block, notch: int) -> "Manifold":
    """What a notch, numbered from 0, cuts from the block [m]; where it ends at the surface it goes on."""
    low, high = outline.notches[notch]
    size = outline.high - outline.low
    # Faces in one plane are a matter of rounding: what ends at the surface or beyond goes on.
    near = _NOTHING * size
    return box_solid(
        np.where(low <= outline.low + near, outline.low - size, low),
        np.where(high >= outline.high - near, outline.high + size, high),
    )


def cavity_solids(
    layout: AbstractLayout, theta: Float[Array | np.ndarray, " p"], chord: float
) -> tuple["Manifold", ...]:
    """What the cavities enclose with parameters (p,) [m], surfaces within the tolerance `chord` m.

    Raises SoftfuseError where the tolerance is not positive or asks for too many triangles, MeshError
    where a cavity does not exist, meets another one or reaches out of the body.
    """
    if not chord > 0.0:
        raise SoftfuseError(f"a chord tolerance of {chord:g} m is none: give a length such as 20e-6 m")
    parts = zip(layout.shapes, layout.values(jnp.asarray(theta)), strict=True)
    solids = tuple(_cavity_solid(k, shape, values, chord) for k, (shape, values) in enumerate(parts))
    for (j, first), (k, second) in combinations(enumerate(solids), 2):
        if not (first ^ second).is_empty():
            raise MeshError(f"cavity {j} and cavity {k} meet: move them apart, or make them smaller")
    outline = outline_solid(layout.outline)
    for k, solid in enumerate(solids):
        beyond = (solid - outline).volume()
        if beyond > _NOTHING * solid.volume():
            raise MeshError(
                f"cavity {k} reaches out of the body, with {1e9 * beyond:.3g} mm³: move it inwards, or make "
                "it smaller"
            )
    return solids


def body_solid(outline: Block, cavities: Sequence["Manifold"]) -> "Manifold":
    """The material of a body [m] with these solids cut out, such as `cavity_solids` returns."""
    from manifold3d import Manifold, OpType

    return Manifold.batch_boolean([outline_solid(outline), *cavities], OpType.Subtract)


def _cavity_solid(k: int, shape: CavityShape, values: Float[Array, " v"], chord: float) -> "Manifold":
    from manifold3d import Error, Manifold, Mesh64

    if not np.min(shape.half_sizes(values)) > 0.0 or (np.asarray(shape.slack(values)) < 0.0).any():
        raise MeshError(f"cavity {k} does not exist: make it larger, or its fillets smaller")
    points, faces = facets(shape, values, _CURVED * chord)
    solid = Manifold(Mesh64(points, faces.astype(np.uint64, order="C"))).simplify((1.0 - _CURVED) * chord)
    if solid.status() != Error.NoError or not solid.volume() > 0.0:
        raise MeshError(
            f"the surface of cavity {k} encloses nothing within {1e6 * chord:g} µm: give a smaller tolerance"
        )
    return solid
