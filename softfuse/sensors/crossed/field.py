"""What crossed lines of diamonds measure when a grounded cylinder comes near: a method of moments.

All lines are at 1 V, the cylinder at 0 V, in a medium of uniform permittivity. Lines and cylinder are cut
into squares of constant charge density q, whose potentials at each other's middles must be those of the
conductors,

    | E   C | | q_e |   | 1 |
    | Cᵀ  T | | q_t | = | 0 |,

and a line's capacitance is the charge on it. The cylinder stands upright, at a gap above the body or pressed
into it; what then counts is where the electrodes are under it. This is independent of
`crossed.diamond_array`, which takes the charge under a plane's edge for that under a cylinder's. Not
modelled: wires, the table below, the change of permittivity from silicone to air. Source: Harrington, Field
Computation by Moment Methods, 1968, ch. 2.

A square of side a in a plane, with the charge 1 C spread evenly over it, has at the place (x, y, z) from its
middle the potential

    φ = 1/(4πε a²) Σ± ± [u ln(v + r) + v ln(u + r) − z atan(u v/(z r))],  r² = u² + v² + z²,

summed over its corners (u, v) = (x ± a/2, y ± a/2) with the sign of their product. Source: Hess and Smith,
Prog. Aeronaut. Sci. 8 (1967) 1, for constant sources; Harrington. Far away it is that of a point, 1/(4πε r).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

_TURN = np.sqrt(0.5)
_RIM_PIECES = 8
"""Pieces along each side of a square that the rim of the cylinder's bottom may cut."""
_LEAST_SHARE = 0.02
"""Part of such a square that must lie on the bottom for it to count."""
_IN_PLANE_M = 1e-9
"""Height above the plane of a square that is none: the terms in z need one."""
_STRETCH = 1.35
"""By which the rings of squares on the cylinder's wall grow upwards."""


@dataclass(frozen=True)
class CrossedLines:
    """Where the lines of an array are: rows at y = row_y, columns at x = column_x, depths below the top; in
    m.
    """

    row_y: tuple[float, ...]
    column_x: tuple[float, ...]
    row_depth: float
    column_depth: float


@dataclass(frozen=True)
class FieldSettings:
    """Permittivity in F/m, size of the grounded cylinder in m, and how finely it is computed.

    cuts: squares along each side of a diamond; bottom_side: of the squares on the cylinder's bottom in m;
    around: squares around its wall.
    """

    radius: float = 10e-3
    height: float = 40e-3
    permittivity: float = 3.0 * 8.8541878128e-12
    cuts: int = 4
    bottom_side: float = 1.43e-3
    around: int = 16


@dataclass(frozen=True, eq=False)
class Panels:
    """Squares: middles (m, 3) m, z from the body's top; sides (m,) m; number (m,) of the line of each."""

    middle: Float[np.ndarray, "m 3"]
    side: Float[np.ndarray, " m"]
    line: Int[np.ndarray, " m"]


def line_panels(lines: CrossedLines, cuts: int) -> Panels:
    """The squares of all lines, rows first; each diamond in cuts² of them, turned by 45°."""
    row_y, column_x = np.array(lines.row_y), np.array(lines.column_x)
    across, along, area, row = _diamonds(row_y, column_x, cuts)
    rows = np.stack([along, across, np.full(len(across), -lines.row_depth)], axis=1)
    across, along, column_area, column = _diamonds(column_x, row_y, cuts)
    columns = np.stack([across, along, np.full(len(across), -lines.column_depth)], axis=1)
    return Panels(
        np.concatenate([rows, columns]),
        np.sqrt(np.concatenate([area, column_area])),
        np.concatenate([row, len(row_y) + column]),
    )


class ArrayField:
    """The field of one array, with the electrodes' own part worked out."""

    def __init__(self, lines: CrossedLines, settings: FieldSettings) -> None:
        """Squares and inverse of the electrodes' potentials; some thousand squares take seconds."""
        self._settings = settings
        self.panels = line_panels(lines, settings.cuts)
        """The squares of the lines on the body at rest."""
        middle, side = self.panels.middle, self.panels.side
        own = square_potential(_turned(middle[:, None] - middle[None]), side[None], settings.permittivity)
        self._inverse = np.linalg.inv(0.5 * (own + own.T))
        self._alone = self._inverse.sum(axis=1)
        self._tip, self._tip_side, self._flat = _cylinder(settings)
        self._tip_own = self._own_of_tip()

    @property
    def alone(self) -> Float[np.ndarray, " e"]:
        """Capacitance (e,) F of each line, rows first, with nothing near."""
        return self._of_lines(self._alone)

    def lines(
        self, at: tuple[float, float], bottom: float, electrodes: Float[np.ndarray, "m 3"] | None = None
    ) -> Float[np.ndarray, " e"]:
        """Capacitance (e,) F of each line, rows first, under the cylinder.

        at: x, y of its axis, bottom: z of its bottom, from the body's top at rest, in m; electrodes (m, 3) m:
        where the panels' middles are, by default as at rest.
        """
        permittivity = self._settings.permittivity
        middle = self.panels.middle if electrodes is None else electrodes
        offset = middle[:, None] - (self._tip + np.array([*at, bottom]))
        flat, wall = offset[:, : self._flat], offset[:, self._flat :]
        coupling = np.concatenate(
            [
                square_potential(_turned(flat), self.panels.side[:, None], permittivity),
                point_potential(wall, permittivity),
            ],
            axis=1,
        )
        response = self._inverse @ coupling
        charge = np.linalg.solve(self._tip_own - coupling.T @ response, -response.sum(axis=0))
        return self._of_lines(self._alone - response @ charge)

    def _of_lines(self, charge: Float[np.ndarray, " m"]) -> Float[np.ndarray, " e"]:
        return np.bincount(self.panels.line, charge)

    def _own_of_tip(self) -> Float[np.ndarray, "t t"]:
        permittivity, flat = self._settings.permittivity, self._flat
        offset = self._tip[:, None] - self._tip[None]
        own = point_potential(offset, permittivity)
        on_bottom = square_potential(offset[:flat, :flat], self._tip_side[None, :flat], permittivity)
        own[:flat, :flat] = 0.5 * (on_bottom + on_bottom.T)
        wall = np.arange(flat, len(own))
        own[wall, wall] = own_potential(self._tip_side[flat:], permittivity)
        return own


def _turned(offset: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """Offsets as seen from squares that are turned by 45° about z."""
    x, y, z = np.moveaxis(offset, -1, 0)
    return np.stack([_TURN * (x + y), _TURN * (y - x), z], axis=-1)


def _diamonds(
    own: Float[np.ndarray, " n"], cross: Float[np.ndarray, " k"], cuts: int
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"], Float[np.ndarray, " m"], Int[np.ndarray, " m"]]:
    """Place across and along the lines, area and line of the pieces (m,) of parallel lines at `own` (n,) m.

    They are crossed by lines at `cross` (k,) m, between which the diamonds stand; each line ends in halves of
    a diamond, whose pieces on the array's rim are triangles.
    """
    half_own = 0.5 * float(np.mean(np.diff(own)))
    grid = (2.0 * np.arange(cuts) + 1.0) / cuts - 1.0
    a, b = (g.ravel() for g in np.meshgrid(grid, grid, indexing="ij"))
    wide, far = 0.5 * (a + b), 0.5 * (a - b)
    middles, halves = 0.5 * (cross[1:] + cross[:-1]), 0.5 * np.diff(cross)
    across = [half_own * np.tile(wide, len(middles))]
    along = [(middles[:, None] + halves[:, None] * far).ravel()]
    area = [np.repeat(2.0 * half_own * halves / cuts**2, cuts**2)]
    inside, cut = far < -1e-9, np.abs(far) <= 1e-9
    for apex, half in ((cross[0], -halves[0]), (cross[-1], halves[-1])):
        whole = 2.0 * half_own * abs(half) / cuts**2
        across += [half_own * wide[inside], half_own * wide[cut]]
        # The middle of a triangle is a third of its height from its base, which is on the rim.
        along += [
            apex + half * (1.0 + far[inside]),
            np.full(cut.sum(), apex + half * (1.0 - 1.0 / (3 * cuts))),
        ]
        area += [np.full(inside.sum(), whole), np.full(cut.sum(), 0.5 * whole)]
    each = np.concatenate(across)
    return (
        (own[:, None] + each).ravel(),
        np.tile(np.concatenate(along), len(own)),
        np.tile(np.concatenate(area), len(own)),
        np.repeat(np.arange(len(own)), len(each)),
    )


def _cylinder(settings: FieldSettings) -> tuple[Float[np.ndarray, "t 3"], Float[np.ndarray, " t"], int]:
    """Middles (t, 3) m from the middle of the bottom, sides (t,) m, and how many are on the bottom: first."""
    radius, side = settings.radius, settings.bottom_side
    reach = int(np.ceil(radius / side))
    x, y = (g.ravel() for g in np.meshgrid(*[side * np.arange(-reach, reach + 1)] * 2))
    within = (np.arange(_RIM_PIECES) + 0.5) / _RIM_PIECES - 0.5
    dx, dy = (side * g.ravel() for g in np.meshgrid(within, within))
    px, py = x[:, None] + dx, y[:, None] + dy
    on = px**2 + py**2 < radius**2
    share = on.mean(axis=1)
    kept = share > _LEAST_SHARE
    count = on.sum(axis=1)[kept]
    middle = [np.where(on, p, 0.0).sum(axis=1)[kept] / count for p in (px, py)]
    bottom = np.stack([*middle, np.zeros(len(count))], axis=1)
    rings, step = [0.0], side
    while rings[-1] < settings.height:
        rings.append(rings[-1] + step)
        step *= _STRETCH
    heights = np.array(rings)
    turn = 2.0 * np.pi * (np.arange(settings.around) + 0.5) / settings.around
    z, angle = (g.ravel() for g in np.meshgrid(0.5 * (heights[1:] + heights[:-1]), turn, indexing="ij"))
    wall = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
    area = np.repeat(np.diff(heights), settings.around) * 2.0 * np.pi * radius / settings.around
    sides = np.concatenate([side * np.sqrt(share[kept]), np.sqrt(area)])
    return np.concatenate([bottom, wall]), sides, len(bottom)


def square_potential(
    offset: Float[np.ndarray, "*n 3"], side: Float[np.ndarray, "*#n"], permittivity: float
) -> Float[np.ndarray, "*n"]:
    """Potential (*n) [V/C] at offsets (*n, 3) m from the middles of squares of sides (*n) m, or alike ones.

    Squares lie across z, their sides along x and y; permittivity in F/m.
    """
    x, y = offset[..., 0], offset[..., 1]
    z = np.maximum(np.abs(offset[..., 2]), _IN_PLANE_M)
    total = np.zeros(np.broadcast_shapes(x.shape, side.shape))
    for sign_u in (-1.0, 1.0):
        for sign_v in (-1.0, 1.0):
            u, v = x + 0.5 * sign_u * side, y + 0.5 * sign_v * side
            r = np.sqrt(u * u + v * v + z * z)
            corner = u * np.log(v + r) + v * np.log(u + r) - z * np.arctan(u * v / (z * r))
            total += sign_u * sign_v * corner
    return total / (4.0 * np.pi * permittivity * side**2)


def point_potential(offset: Float[np.ndarray, "*n 3"], permittivity: float) -> Float[np.ndarray, "*n"]:
    """Potential (*n) [V/C] at offsets (*n, 3) m from points; infinite at the point itself."""
    with np.errstate(divide="ignore"):
        return 1.0 / (4.0 * np.pi * permittivity * np.linalg.norm(offset, axis=-1))


def own_potential(side: Float[np.ndarray, "*n"], permittivity: float) -> Float[np.ndarray, "*n"]:
    """Potential (*n) [V/C] in the middle of squares of sides (*n) m: ln(1 + √2)/(π ε a)."""
    return np.log(1.0 + np.sqrt(2.0)) / (np.pi * permittivity * side)
