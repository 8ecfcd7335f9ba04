"""A grid of mutual capacitances between columns and rows, under things that hover or press.

The charge that a grounded thing takes and the pressure under it, summed over their areas. Cell (i, j), where
column i crosses row j, has the capacitance

    C_ij = C0 [1 + f T_ij + (1 − f) M_ij],

* T_ij, the part f of the flux that passes above the surface. Held at 1 V, a strip of half width b among
  strips at 0 V has the potential φ_i(x, z) = (1/π) [atan((x − x_i + b)/z) − atan((x − x_i − b)/z)] (Laplace's
  equation in the half space; ∫ φ_i dx = 2b at every z). A grounded disc at the height z takes
  T_ij = −∬_disc φ_i φ_j dA / 4b²; one of relative permittivity ε_r returns instead the part
  (ε_r − 1)/(ε_r + 1) of its image charge, times `returned`, for it is thin against the field.
* M_ij, the mean of e^(p/E) − 1 over the cell: the layers with a soft spacer of modulus E between them, in
  which the strain ln(t/t0) = −p/E. p is the disc's pressure, its edge blurred over the layers' depth.

Then crosstalk from the cells of the same lines. Not modelled: things that are badly grounded and pass on what
they take, moisture, stretched electrodes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

_LINES_M = tuple(1e-3 * (-24.0 + 16.0 * k) for k in range(4))


@dataclass(frozen=True)
class Thing:
    """A disc that hovers or presses: x, y of its middle [m], distance from the surface [m], force [N].

    `permittivity`: relative one of a thing that does not conduct, None for one that is grounded.
    """

    place: tuple[float, float]
    distance: float = 0.0
    force: float = 0.0
    radius: float = 8e-3
    permittivity: float | None = None


@dataclass(frozen=True)
class MutualField:
    """Constants of the grid.

    `column_x`, `row_y` of the lines, `half_width` b, `depth` of the layers [m]; `fringe` f, `returned`, see
    above; `spacer_Pa` E; `crosstalk`: part of a neighbour's change.
    """

    column_x: tuple[float, ...] = _LINES_M
    row_y: tuple[float, ...] = _LINES_M
    half_width: float = 8e-3
    depth: float = 1.5e-3
    fringe: float = 0.25
    returned: float = 0.3
    spacer_Pa: float = 60e3
    crosstalk: float = 0.01

    def change(self, things: Sequence[Thing]) -> Float[np.ndarray, "c r"]:
        """Change of the cells (c, r) relative to C0 before crosstalk, first index along x."""
        taken = np.zeros((len(self.column_x), len(self.row_y)))
        pressure = self._pressure(things)
        for thing in things:
            taken += self._returned(thing) * self._flux(thing)
        squeezed = np.expm1(pressure / self.spacer_Pa).mean(axis=(1, 3))
        return self.fringe * taken + (1 - self.fringe) * squeezed

    def with_crosstalk(self, change: Float[np.ndarray, "*n c r"]) -> Float[np.ndarray, "*n c r"]:
        """Relative changes (..., c, r) and what the cells of the same lines add to each."""
        along_x = change.sum(axis=-2, keepdims=True) - change
        along_y = change.sum(axis=-1, keepdims=True) - change
        return change + self.crosstalk * (along_x + along_y)

    def _returned(self, thing: Thing) -> float:
        if thing.permittivity is None:
            return -1.0
        return self.returned * (thing.permittivity - 1) / (thing.permittivity + 1)

    def _flux(self, thing: Thing) -> Float[np.ndarray, "c r"]:
        """∬_disc φ_i φ_j dA / 4b² (c, r)."""
        at = np.array(thing.place) + thing.radius * _DISC[:, :2]
        area = thing.radius**2 * _DISC[:, 2]
        height = self.depth + thing.distance
        columns = self._potential(at[:, 0], np.array(self.column_x), height)
        rows = self._potential(at[:, 1], np.array(self.row_y), height)
        return (columns * area) @ rows.T / (2 * self.half_width) ** 2

    def _potential(
        self, at: Float[np.ndarray, " q"], line: Float[np.ndarray, " l"], height: float
    ) -> Float[np.ndarray, "l q"]:
        apart = at - line[:, None]
        b = self.half_width
        return (np.arctan((apart + b) / height) - np.arctan((apart - b) / height)) / np.pi

    def _pressure(self, things: Sequence[Thing]) -> Float[np.ndarray, "c g r h"]:
        """Pressure on the layers in Pa at points of each cell (c, points along x, r, points along y)."""
        inside = self.half_width * (np.arange(8) - 3.5) / 4
        x = np.array(self.column_x)[:, None] + inside
        y = np.array(self.row_y)[:, None] + inside
        total = np.zeros((*x.shape, *y.shape))
        for thing in things:
            apart = np.hypot(x[:, :, None, None] - thing.place[0], y[None, None, :, :] - thing.place[1])
            even = thing.force / (np.pi * thing.radius**2)
            total += even * 0.5 * (1 - np.tanh((apart - thing.radius) / self.depth))
        return total


def _unit_disc(rings: int, angles: int) -> Float[np.ndarray, "q 3"]:
    """x, y and area of points that share the unit disc."""
    radius = np.sqrt((np.arange(rings) + 0.5) / rings)
    angle = 2 * np.pi * (np.arange(angles) + 0.5) / angles
    r, a = (grid.ravel() for grid in np.meshgrid(radius, angle, indexing="ij"))
    return np.stack([r * np.cos(a), r * np.sin(a), np.full(r.shape, np.pi / r.size)], axis=1)


_DISC = _unit_disc(rings=10, angles=24)
"""x, y and area of the points at which a disc of radius 1 is summed."""
