"""A mould of two parts in which a body is cast around its cores, parted at a plane z = p.

The mould is the block with a shell around it, less the body's outline; what fills the notches stays with the
part that it lies in. The parts come off along −z and +z. So no part may have the body behind it: with N_j a
notch in the block, the lower part has an undercut there when

    sweep(N_j ∩ {z < p}, −z) ∩ body ≠ ∅,

and the upper part in the same way along +z. Rods along x and y lie in the parting plane, half in each part;
rods along z come off with the part that they stick in. Three pins on the lower part, none at the corner of
high x and high y, let the upper part on in one way only.

Cores are laid into the lower part, the upper part is put on, and the body is cast through the filling hole
until the vent overflows. Walls along z have no draft: what is cast must give way, as silicone does.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from softfuse.design.casting import Casting, notch_solid, outline_solid
from softfuse.design.port import Rod, box_solid, prism
from softfuse.errors import MeshError, SoftfuseError
from softfuse.mesh.block import Block

if TYPE_CHECKING:
    from manifold3d import Manifold

_UP = np.array([0.0, 0.0, 1.0])

_PIN_ROOM = 1.0 / 3.0
"""Largest radius of a pin's hole over the shell's thickness: a sixth of it is left on both sides."""

_CHAMFER = 0.5
"""Height of a pin's conical tip over its radius, and by how much that narrows."""

_SAME = 1e-6
"""Length in m up to which rods lie at one level."""

_NOTHING = 1e-9
"""Part of a volume below which it is taken for none."""


@dataclass(frozen=True)
class MouldShape:
    """Lengths in m of a mould: thickness of the shell around the block; radius and length of the pins, and
    the room around them in their holes; the room around rods; where in (x, y) it is filled and vented through
    the top, and the radii of these two holes.
    """

    thickness: float
    pin_radius: float
    pin_length: float
    pin_room: float
    rod_room: float
    filled_at: tuple[float, float]
    filling_radius: float
    vented_at: tuple[float, float]
    vent_radius: float


@dataclass(frozen=True, eq=False)
class Mould:
    """The two parts [m], the height z in m of the plane between them, and how many holes lead right through
    each part.
    """

    lower: "Manifold"
    upper: "Manifold"
    parting: float
    lower_holes: int
    upper_holes: int


def mould(casting: Casting, shape: MouldShape, *, parting: float | None = None) -> Mould:
    """The mould for a casting, parted at the height z = `parting` m, where None at that of its rods.

    Raises SoftfuseError where a length of the shape does not fit, MeshError where rods are not in the parting
    plane, a notch has an undercut, or a hole does not open into the body.
    """
    from manifold3d import Manifold, OpType

    outline = casting.outline
    at = _parting(outline, casting.rods, parting)
    _check_shape(shape, outline.high[2] + shape.thickness - at)
    body = outline_solid(outline)
    _check_undercuts(outline, body, at)
    thick = np.full(3, shape.thickness)
    whole = box_solid(outline.low - thick, outline.high + thick) - body
    channels = (_channel(rod, outline, shape, casting.chord) for rod in casting.rods)
    whole = Manifold.batch_boolean([whole, *channels], OpType.Subtract)
    upper, lower = whole.split_by_plane((0.0, 0.0, 1.0), at)
    feet = _feet(outline, shape, at)
    pins = (_pin(foot, shape, 0.0, casting.chord) for foot in feet)
    holes = (_pin(foot, shape, shape.pin_room, casting.chord) for foot in feet)
    openings = _openings(casting, shape, body)
    lower = Manifold.batch_boolean([lower, *pins], OpType.Add)
    upper = Manifold.batch_boolean([upper, *holes, *openings], OpType.Subtract)
    through = [rod.direction[2] for rod in casting.rods if _pierces(rod, outline, shape)]
    return Mould(lower, upper, at, through.count(-1.0), len(openings) + through.count(1.0))


def _pierces(rod: Rod, outline: Block, shape: MouldShape) -> bool:
    """Whether the channel of a rod leads through the shell."""
    axis = int(np.argmax(np.abs(rod.direction)))
    face = (outline.high if rod.direction[axis] > 0.0 else outline.low)[axis]
    outside = abs(face - rod.start[axis]) + shape.thickness
    return bool(rod.inside + rod.beyond + shape.rod_room > outside - _SAME)


def _channel(rod: Rod, outline: Block, shape: MouldShape, chord: float) -> "Manifold":
    # No skin is left where rod and shell end in one plane.
    further = shape.thickness if _pierces(rod, outline, shape) else 0.0
    return rod.solid(chord, room=shape.rod_room, further=further)


def _parting(outline: Block, rods: Sequence[Rod], parting: float | None) -> float:
    flat = [rod for rod in rods if rod.direction[2] == 0.0]
    if parting is None and not flat:
        raise SoftfuseError("no rod lies in a plane z: say at which height `parting` the mould is parted")
    at = float(flat[0].start[2]) if parting is None else parting
    for rod in flat:
        if abs(rod.start[2] - at) > _SAME:
            raise MeshError(
                f"the rod of cavity {rod.cavity} lies at z = {1e3 * rod.start[2]:.4g} mm, the mould is "
                f"parted at {1e3 * at:.4g} mm: give all ports that lead sideways starts at one "
                "level within their cavities"
            )
    if not outline.low[2] < at < outline.high[2]:
        raise SoftfuseError(
            f"a mould parted at z = {1e3 * at:.4g} mm has one part only: the block reaches from "
            f"{1e3 * outline.low[2]:.4g} to {1e3 * outline.high[2]:.4g} mm"
        )
    return at


def _check_shape(shape: MouldShape, upper: float) -> None:
    lengths = {
        name: getattr(shape, name)
        for name in ("thickness", "pin_radius", "pin_length", "filling_radius", "vent_radius")
    }
    for name, length in lengths.items():
        if not length > 0.0:
            raise SoftfuseError(f"the mould's {name} is {length:g} m: it must be positive")
    if min(shape.pin_room, shape.rod_room) < 0.0:
        raise SoftfuseError("the room around pins and rods must not be negative")
    widest = _PIN_ROOM * shape.thickness - shape.pin_room
    if shape.pin_radius > widest:
        raise SoftfuseError(
            f"pins with a radius of {1e3 * shape.pin_radius:g} mm leave too little of a shell of "
            f"{1e3 * shape.thickness:g} mm: make them at most {1e3 * widest:.3g} mm, or the shell thicker"
        )
    if shape.pin_length + shape.pin_room > upper - _PIN_ROOM * shape.thickness:
        raise SoftfuseError(
            f"pins of {1e3 * shape.pin_length:g} mm come through the upper part, which is "
            f"{1e3 * upper:.3g} mm high: make them shorter"
        )


def _check_undercuts(outline: Block, body: "Manifold", at: float) -> None:
    from manifold3d import Manifold

    tall = 2.0 * (outline.high[2] - outline.low[2])
    for k in range(len(outline.notches)):
        notch = notch_solid(outline, k) ^ box_solid(outline.low, outline.high)
        upper, lower = notch.split_by_plane((0.0, 0.0, 1.0), at)
        for part, sign, name in ((lower, -1.0, "lower"), (upper, 1.0, "upper")):
            if part.is_empty():
                continue
            # A notch is a box, so what it sweeps is the hull of where it is and where it goes.
            swept = Manifold.batch_hull([part, part.translate((0.0, 0.0, sign * tall))])
            behind = (swept ^ body).volume()
            if behind > _NOTHING * body.volume():
                raise MeshError(
                    f"notch {k} is an undercut of the mould's {name} part, which has {1e9 * behind:.4g} mm³ "
                    f"of the body behind it along z: part the mould at another height than "
                    f"{1e3 * at:.4g} mm, or let the notch be open to the top or the bottom"
                )


def _feet(outline: Block, shape: MouldShape, at: float) -> Float[np.ndarray, "3 3"]:
    """Places (3, 3) m in the parting plane, in corners of the shell, of the pins' axes."""
    (x, y), (a, b) = outline.low[:2] - 0.5 * shape.thickness, outline.high[:2] + 0.5 * shape.thickness
    return np.array([[x, y, at], [a, y, at], [x, b, at]])


def _pin(foot: Float[np.ndarray, "3"], shape: MouldShape, room: float, chord: float) -> "Manifold":
    """A pin with a chamfer, or with `room` m around it its hole; both reach into the lower part too."""
    from manifold3d import Manifold

    sunk = 0.5 * shape.thickness
    tip = min(_CHAMFER * shape.pin_radius, 0.5 * shape.pin_length)
    begin, length = foot - sunk * _UP, sunk + shape.pin_length + room
    wide = prism(begin, _UP, length - tip, shape.pin_radius, chord, room=room)
    narrow = prism(begin, _UP, length, shape.pin_radius, chord, room=room - tip)
    return Manifold.batch_hull([wide, narrow])


def _openings(casting: Casting, shape: MouldShape, body: "Manifold") -> list["Manifold"]:
    top, chord = float(casting.outline.high[2]), casting.chord
    given = (
        ("filling hole", shape.filled_at, shape.filling_radius),
        ("vent", shape.vented_at, shape.vent_radius),
    )
    bars = []
    for name, (x, y), radius in given:
        foot = np.array([x, y, top])
        # As deep as nothing, but enough to tell the body's top from a notch.
        below = prism(foot - chord * _UP, _UP, chord, radius, chord)
        if (below - body).volume() > 1e-6 * below.volume():
            raise MeshError(
                f"the {name} at ({1e3 * x:.4g}, {1e3 * y:.4g}) mm does not open into the body's top with all "
                f"of its {2e3 * radius:.3g} mm: move it away from the edge and from notches, or narrow it"
            )
        bar = prism(foot - chord * _UP, _UP, 2.0 * shape.thickness + chord, radius, chord)
        for core, called in zip(casting.cores, casting.names, strict=True):
            if not (bar ^ core).is_empty():
                raise MeshError(f"the {name} meets the rod of core {called}: move one of them")
        bars.append(bar)
    if not (bars[0] ^ bars[1]).is_empty():
        raise MeshError("the filling hole and the vent meet: move them apart")
    return bars
