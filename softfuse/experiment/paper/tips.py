"""Rigid round tips that push on the sides of a finger's segments (`mesh.finger`), wherever these are now."""

from dataclasses import dataclass
from itertools import product
from typing import Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.body.base import AbstractBody
from softfuse.errors import ConfigError
from softfuse.mechanics.rigid_cylinder import RigidCylinder

Side = Literal["palm", "left", "right"]

SIDES: dict[Side, tuple[float, float, float]] = {
    "palm": (0.0, 0.0, 1.0),
    "left": (0.0, -1.0, 0.0),
    "right": (0.0, 1.0, 0.0),
}
"""Faces of a segment, and the unit normal of each at rest, into the finger."""


@dataclass(frozen=True)
class Tips:
    """Where and what the tips are, in m: size of the finger (3,), middles of its segments along x; cylinders
    of a radius across the segment, twice `half` long, that roll over at most `reach` to each side and meet it
    at `points` points along x and across; the time for an equilibrium grows with them.
    """

    size: tuple[float, float, float]
    segment_x: tuple[float, ...]
    radius: float = 5e-3
    half: float = 6e-3
    reach: float = 9e-3
    points: tuple[int, int] = (13, 3)

    def __post_init__(self) -> None:
        if min(self.points) < 2:
            raise ConfigError(f"a tip that meets the finger at {self.points} points: give at least (2, 2)")

    def middle(self, segment: int, side: Side) -> Float[np.ndarray, "3"]:
        """The middle (3,) m of a side of a segment at rest; ConfigError when there is no such segment."""
        return self._on_side(segment, side, np.zeros((1, 2)))[0]

    def before(self, body: AbstractBody, segment: int, side: Side) -> RigidCylinder:
        """A tip that rests on the middle of a side of a segment at rest; ConfigError as `middle`."""
        along, across = (np.linspace(-1.0, 1.0, n) for n in self.points)
        patch = np.array(list(product(self.reach * along, self.half * across)))
        normal = np.array(SIDES[side])
        return RigidCylinder.before(
            body,
            self._on_side(segment, side, patch),
            self.middle(segment, side),
            normal,
            np.cross(normal, [1.0, 0.0, 0.0]),
            self.radius,
        )

    def _on_side(
        self, segment: int, side: Side, offsets: Float[np.ndarray, "g 2"]
    ) -> Float[np.ndarray, "g 3"]:
        """Points (g, 3) m on a side of a segment, at offsets (g, 2) m along x and across from its middle."""
        if not 0 <= segment < len(self.segment_x):
            raise ConfigError(
                f"segment {segment} cannot be pushed: give a number from 0 to {len(self.segment_x) - 1}"
            )
        _, width, height = self.size
        normal = np.array(SIDES[side])
        middle = np.array([self.segment_x[segment], 0.0, 0.5 * height])
        face = middle - 0.5 * normal * np.array([0.0, width, height])
        across = np.abs(np.cross(normal, [1.0, 0.0, 0.0]))
        return face + offsets[:, :1] * np.array([1.0, 0.0, 0.0]) + offsets[:, 1:] * across


def set_against(tip: RigidCylinder, grid: Float[np.ndarray, "n m 3"]) -> tuple[RigidCylinder, float]:
    """The tip set up against its patch where that is now, and the drive [m] of first contact.

    grid (n, m, 3) m: the patch's points, n along and m across it.
    It rests on the patch's middle, lies across it, and will move along its normal.
    """
    patch = grid.reshape(-1, 3)
    middle = patch.mean(axis=0)
    across = grid[:, -1].mean(axis=0) - grid[:, 0].mean(axis=0)
    lengthwise = grid[-1].mean(axis=0) - grid[0].mean(axis=0)
    normal = np.cross(lengthwise, across)
    direction = normal / np.linalg.norm(normal) * np.sign(normal @ np.asarray(tip.direction))
    axis = across / np.linalg.norm(across)
    radius = float(tip.radius)
    centre = middle - radius * direction
    placed = (jnp.asarray(centre), jnp.asarray(axis), jnp.asarray(direction))
    tip = eqx.tree_at(lambda t: (t.centre, t.axis, t.direction), tip, placed)
    ahead, aside = seen_from(tip, centre, patch)
    reached = aside < radius
    return tip, float(np.min(ahead[reached] - np.sqrt(radius**2 - aside[reached] ** 2)))


def seen_from(
    tip: RigidCylinder, centre: Float[np.ndarray, "3"], points: Float[np.ndarray, "m 3"]
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """How far points (m, 3) m are ahead (m,) of a tip's axis through centre (3,) m, and to its side (m,)."""
    direction, axis = np.asarray(tip.direction), np.asarray(tip.axis)
    away = points - centre
    ahead = away @ direction
    aside = np.linalg.norm(away - np.outer(away @ axis, axis) - np.outer(ahead, direction), axis=1)
    return ahead, aside


def patch_of(tip: RigidCylinder, body: AbstractBody, z: Float[Array, " n"]) -> Float[np.ndarray, "m 3"]:
    """Where the points are that a tip can meet (m, 3) m, the body's unknowns being z (n,)."""
    return np.asarray(tip.ports.values(body, z)).reshape(-1, 3)


def passed_through(tip: RigidCylinder, advance: float, patch: Float[np.ndarray, "m 3"]) -> bool:
    """Whether a tip that has moved on by a way [m] has left points (m, 3) m of the skin behind it that it
    should have pushed on: the law of contact knows the distance from its axis only, and is content with those
    behind.
    """
    centre = np.asarray(tip.centre) + advance * np.asarray(tip.direction)
    ahead, aside = seen_from(tip, centre, patch)
    return bool(np.any((aside < float(tip.radius)) & (ahead < 0.0)))
