"""Ports of cavities: straight round rods from a point in each cavity, square to a face of the block.

A rod lies along one axis from its start to where it leaves the body, which is the block's face or the wall
of a notch that is open up to it, and goes on from there for a length by which a mould holds it. It is the
place of the tube later on. With s the axis and (a, b) the other two, it is the cylinder

    (a − a₀)² + (b − b₀)² ≤ R²,     0 ≤ ±(s − s₀) ≤ inside + beyond,

inscribed in which is the prism that is made: its flats are within the chord tolerance of the cylinder. The
outer half of what is outside is square instead, so that a core cannot turn in its mould.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.errors import MeshError, SoftfuseError
from softfuse.mesh.block import NORMALS, SIDES, Block
from softfuse.robot.layout.layout import AbstractLayout

if TYPE_CHECKING:
    from manifold3d import Manifold

SIDEWAYS = ("low x", "high x", "low y", "high y")
"""Faces through which rods lie in the parting plane of a mould."""

_SQUARE = 0.8
"""Half the width of a rod's square end over its radius, so that both have about the same section."""

_NOTHING = 1e-9
"""Part of a length or volume below which it is taken for none."""


@dataclass(frozen=True)
class Port:
    """How a cavity is reached: through which side of the block (one of `SIDES`), by a rod of `radius` m, from
    a point (3,) m in it, its centre where `start` is None.
    """

    cavity: int
    side: str
    radius: float
    start: tuple[float, float, float] | None = None


@dataclass(frozen=True, eq=False)
class Rod:
    """A port in its place: from `start` (3,) m along `direction` (3,), `inside` m in the body and `beyond` m
    outside, with `radius` m; `notch` is the one that it leaves the body through, or None.
    """

    cavity: int
    side: str
    start: Float[np.ndarray, "3"]
    direction: Float[np.ndarray, "3"]
    inside: float
    beyond: float
    radius: float
    notch: int | None

    def solid(self, chord: float, *, room: float = 0.0, further: float = 0.0) -> "Manifold":
        """The rod [m], its flats within `chord` m of the cylinder; `room` m larger all round, its start
        excepted, and `further` m longer.
        """
        middle = self.inside + 0.5 * self.beyond
        bar = prism(self.start, self.direction, middle + room, self.radius, chord, room=room)
        # Round and square end in each other, so that no faces of theirs lie in one plane.
        near = middle - room - min(0.5 * self.radius, 0.25 * self.beyond)
        along = np.abs(self.direction)
        across = (_SQUARE * self.radius + room) * (1.0 - along)
        ends = np.stack(
            [near * self.direction, (self.inside + self.beyond + room + further) * self.direction]
        )
        return bar + box_solid(self.start + ends.min(axis=0) - across, self.start + ends.max(axis=0) + across)


def box_solid(low: Float[np.ndarray, "3"], high: Float[np.ndarray, "3"]) -> "Manifold":
    """The box between its lowest and highest corner (3,) m."""
    from manifold3d import Manifold

    x, y, z = (high - low).tolist()
    return Manifold.cube((x, y, z)).translate(tuple(low.tolist()))


def prism(
    start: Float[np.ndarray, "3"],
    direction: Float[np.ndarray, "3"],
    length: float,
    radius: float,
    chord: float,
    *,
    room: float = 0.0,
) -> "Manifold":
    """A round bar [m] from `start` (3,) m along ± an axis (3,), its flats within `chord` m of its radius;
    with `room` m more around it, there are as many flats, so that bars in each other have room everywhere.
    """
    from manifold3d import Manifold

    # The corners lie in the planes through the axis, four at the least.
    half_angle = np.arccos(max(1.0 - chord / radius, 0.0))
    count = 4 * int(np.ceil(max(np.pi / (4.0 * half_angle), 2.0)))
    bar = Manifold.cylinder(length, radius + room, circular_segments=count)
    axis = int(np.argmax(np.abs(direction)))
    # Going round the axes takes z to the axis and keeps the corners in the planes.
    columns = np.roll(np.eye(3), axis - 2, axis=0)
    if direction[axis] < 0.0:
        columns = columns @ np.diag([1.0, -1.0, -1.0])
    return bar.transform(np.column_stack([columns, start]))


def placed(
    layout: AbstractLayout, theta: Float[Array | np.ndarray, " p"], port: Port, *, beyond: float
) -> Rod:
    """The rod of a port with parameters (p,), `beyond` m of it outside the body.

    Raises SoftfuseError where there is no such cavity or side, or a length is not positive, MeshError where
    the start lies outside the block or in a notch, or the way leads through a notch into the body again.
    """
    if not 0 <= port.cavity < len(layout.shapes):
        raise SoftfuseError(
            f"a port belongs to cavity {port.cavity}, which does not exist: there are {len(layout.shapes)}, "
            "numbered from 0"
        )
    if port.side not in SIDES:
        raise SoftfuseError(f"there is no side {port.side!r}: the block has {', '.join(SIDES)}")
    if not (port.radius > 0.0 and beyond > 0.0):
        raise SoftfuseError(
            f"a rod's radius, {port.radius:g} m, and `beyond`, {beyond:g} m, must be positive"
        )
    direction = NORMALS[SIDES.index(port.side)]
    shape, values = layout.shapes[port.cavity], layout.values(jnp.asarray(theta))[port.cavity]
    start = np.asarray(shape.centre(values) if port.start is None else port.start, float)
    inside, notch = _way_out(layout.outline, port, start, direction)
    return Rod(port.cavity, port.side, start, direction, inside, beyond, port.radius, notch)


def _way_out(
    outline: Block, port: Port, start: Float[np.ndarray, "3"], direction: Float[np.ndarray, "3"]
) -> tuple[float, int | None]:
    """How far [m] the body reaches from `start` along `direction`, and the notch behind, if any."""
    axis = int(np.argmax(np.abs(direction)))
    others = [a for a in range(3) if a != axis]
    sign = direction[axis]
    face = float((outline.high if sign > 0 else -outline.low)[axis] - sign * start[axis])
    if (start <= outline.low).any() or (start >= outline.high).any():
        raise MeshError(
            f"the rod of cavity {port.cavity} starts at {_mm(start)} mm, outside the block: move the start"
        )
    crossed = []
    for k, (low, high) in enumerate(outline.notches):
        if (start[others] > low[others]).all() and (start[others] < high[others]).all():
            near, far = np.sort(sign * (np.array([low, high])[:, axis] - start[axis]))
            if far > 0.0:
                crossed.append((float(near), float(far), k))
    if not crossed:
        return face, None
    nearest, reached, notch = min(crossed)
    if nearest <= 0.0:
        raise MeshError(f"the rod of cavity {port.cavity} starts in notch {notch}: move its start")
    for near, far, _ in sorted(crossed):
        reached = max(reached, far) if near <= reached else reached
    if reached < face - _NOTHING * face:
        raise MeshError(
            f"the rod of cavity {port.cavity} to {port.side} passes notch {notch} and enters the body again: "
            "choose another side or start"
        )
    return nearest, notch


def check_rods(
    layout: AbstractLayout,
    rods: Sequence[Rod],
    cavities: Sequence["Manifold"],
    *,
    wall: float,
    chord: float,
) -> None:
    """Raise MeshError where a rod does not begin well inside its cavity, or comes nearer than `wall` m to
    another cavity or rod, to a face of the block or to a notch, except where it leaves the body.

    cavities: what `cavity_solids` returns for the layout with `chord` m.
    """
    for rod in rods:
        reason = (
            _loose(rod, cavities, chord)
            or _too_near_outside(layout.outline, rod, wall)
            or _too_near_inside(rod, cavities, wall, chord)
        )
        if reason:
            raise MeshError(reason)
    for first, second in combinations(rods, 2):
        if _gap(first.solid(chord), second.solid(chord), wall) < wall:
            raise MeshError(
                f"the rods of cavities {first.cavity} and {second.cavity} come nearer to each other than "
                f"{1e3 * wall:g} mm: lead them through different sides or move their starts"
            )


def nearest_ports(
    layout: AbstractLayout,
    theta: Float[Array | np.ndarray, " p"],
    cavities: Sequence["Manifold"],
    *,
    radius: float,
    wall: float,
    chord: float,
    level: float | None = None,
    sides: Sequence[str] = SIDEWAYS,
) -> tuple[Port, ...]:
    """For each cavity, one after the other, the port with the shortest free way out, of rods of `radius` m
    that keep `wall` m as `check_rods` says.

    level: height z in m of all starts, which otherwise are the centres; a mould wants all rods at one level.
    cavities: what `cavity_solids` returns with parameters (p,) and the tolerance `chord` m. Raises MeshError
    where a cavity has no way out, and as `placed` does.
    """
    chosen: list[Port] = []
    rods: list[Rod] = []
    for k, (shape, values) in enumerate(zip(layout.shapes, layout.values(jnp.asarray(theta)), strict=True)):
        x, y, z = np.asarray(shape.centre(values), float).tolist()
        start = None if level is None else (x, y, level)
        found: list[tuple[float, Port, Rod]] = []
        reasons: list[str] = []
        for side in sides:
            port = Port(k, side, radius, start)
            try:
                rod = placed(layout, theta, port, beyond=wall)
                check_rods(layout, [*rods, rod], cavities, wall=wall, chord=chord)
            except MeshError as error:
                reasons.append(str(error))
                continue
            found.append((rod.inside, port, rod))
        if not found:
            raise MeshError(f"cavity {k} has no way out: {'; '.join(reasons)}")
        # Ways that are as long but for rounding: the side that was named first.
        shortest = min(length for length, _, _ in found) * (1.0 + _NOTHING)
        _, port, rod = next(part for part in found if part[0] <= shortest)
        chosen.append(port)
        rods.append(rod)
    return tuple(chosen)


def _loose(rod: Rod, cavities: Sequence["Manifold"], chord: float) -> str | None:
    end = prism(rod.start, rod.direction, min(chord, rod.inside), rod.radius, chord)
    if (end - cavities[rod.cavity]).volume() <= 1e-6 * end.volume():
        return None
    return (
        f"the rod of cavity {rod.cavity}, {2e3 * rod.radius:g} mm thick, does not begin inside it at "
        f"{_mm(rod.start)} mm: make it thinner or move its start"
    )


def _too_near_outside(outline: Block, rod: Rod, wall: float) -> str | None:
    axis = int(np.argmax(np.abs(rod.direction)))
    others = [a for a in range(3) if a != axis]
    what = f"the rod of cavity {rod.cavity} to {rod.side}"
    least = wall * (1.0 - _NOTHING)
    for a in others:
        for name, gap in (
            (SIDES[a], rod.start[a] - outline.low[a]),
            (SIDES[a + 3], outline.high[a] - rod.start[a]),
        ):
            if gap - rod.radius < least:
                return (
                    f"{what} lies {1e3 * (gap - rod.radius):.3g} mm from {name}, nearer than "
                    f"{1e3 * wall:g} mm: make it thinner or move its start"
                )
    ends = np.stack([rod.start, rod.start + rod.inside * rod.direction])
    for k, (low, high) in enumerate(outline.notches):
        apart = np.maximum(np.maximum(low - ends.max(axis=0), ends.min(axis=0) - high), 0.0)
        if k == rod.notch:
            edge = np.minimum(rod.start - low, high - rod.start)[others].min()
            if edge - rod.radius < 0.0:
                return f"{what} leaves the body over the edge of notch {k}: make it thinner or move its start"
        elif np.linalg.norm(apart[others]) - rod.radius < least and apart[axis] < least:
            return (
                f"{what} comes nearer to notch {k} than {1e3 * wall:g} mm: choose another side (see "
                "nearest_ports) or start, or make it thinner"
            )
    return None


def _too_near_inside(rod: Rod, cavities: Sequence["Manifold"], wall: float, chord: float) -> str | None:
    solid = rod.solid(chord)
    for k, cavity in enumerate(cavities):
        if k == rod.cavity:
            continue
        gap = _gap(solid, cavity, wall)
        if gap < wall:
            how = "meets" if gap == 0.0 else f"comes within {1e3 * gap:.3g} mm of"
            return (
                f"the rod of cavity {rod.cavity} to {rod.side} {how} cavity {k}, where {1e3 * wall:g} mm are "
                "asked for: choose another side (see nearest_ports) or start, or make it thinner"
            )
    return None


def _gap(first: "Manifold", second: "Manifold", wall: float) -> float:
    """Distance [m] of two solids, 0 where they meet, at least `wall` m where it is more."""
    if not (first ^ second).is_empty():
        return 0.0
    return first.min_gap(second, wall * (1.0 + _NOTHING))


def _mm(point: Float[np.ndarray, "3"]) -> list[float]:
    return (1e3 * point).round(3).tolist()
