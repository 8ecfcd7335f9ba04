"""What really presses on a virtual body, or hovers over it, for sensors that see contacts."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from softfuse.functional.chart import FlatChart
from softfuse.sensors.parts import Parts


@dataclass(frozen=True, eq=False)
class TrueContact:
    """A contact at a place (3, 3) of the body at rest, see `functional.chart`.

    gap: from the surface [m], negative by how deep it is pressed in; force [N]; radius [m]. middle (3,) and
    axis (3,): of what touches as it stands now [m]; half_length [m]: of a cylinder along the axis, 0 for a
    ball.
    """

    place: Float[np.ndarray, "3 3"]
    gap: float = 0.0
    force: float = 0.0
    radius: float = 8e-3
    middle: Float[np.ndarray, "3"] | None = None
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    half_length: float = 0.0


def coordinates(chart: FlatChart, contact: TrueContact) -> Float[np.ndarray, "2"]:
    """Where a contact is in a chart (2,) [m]."""
    return (np.asarray(contact.place)[0] - np.asarray(chart.origin)) @ np.asarray(chart.axes).T


def face_height(parts: Parts, direction: Float[np.ndarray, "3"]) -> float:
    """How far [m] the outermost point of the body's faces is against a direction (3,), from the origin."""
    nodes = np.unique(np.asarray(parts.faces))
    return float(np.max(-np.asarray(parts.body.rest)[nodes] @ direction))
