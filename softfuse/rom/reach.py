"""Places of a disc in a cell that together touch every face which any place in the cell touches."""

import numpy as np
from jaxtyping import Float

from softfuse.functional.chart import facing
from softfuse.functional.contact import Contact
from softfuse.rom.cells import Cell

_SIDE = 21
"""Places along each edge of a cell. They find faces whose edge crosses what a point of the disc passes over,
and those that hold one of its corners."""
_INSIDE = 1e-3
"""So far inside a face, as a part of the way to its middle, its corners are tried."""


def places_over(cell: Cell, disc: Contact, rest: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "s 3 3"]:
    """Places (s, 3, 3) in a cell, for a disc on a surface of nodes at `rest` (k, 3) m.

    A grid; and where a point of the disc passes over a corner of a face, that comes in from there as narrow
    as may be, a place at which the point lies in this corner.
    """
    surface = disc.surface
    tangents, direction = np.asarray(surface.tangents), np.asarray(surface.direction)
    corners = rest[np.asarray(surface.faces)[:, :3]] @ tangents.T
    inside = corners + _INSIDE * (corners.mean(axis=1, keepdims=True) - corners)
    offsets = np.asarray(disc.points - disc.location) @ tangents.T
    places = (inside[:, :, None] - offsets) @ tangents + (cell.centre @ direction) * direction
    places = facing(places.reshape(len(corners), -1, 3), direction)
    held = cell.holds(places)
    # One place is enough to know all nodes of a face.
    one = np.argmax(held, axis=1)
    return np.concatenate([cell.grid(_SIDE), places[np.arange(len(places)), one][held.any(axis=1)]])
