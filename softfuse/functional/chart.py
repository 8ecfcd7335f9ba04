"""Coordinates on a part of a body's surface, and the places that they name.

A *place* is where a contact presses on the body at rest: an array (3, 3) whose rows are a point of the
surface [m] and two unit tangents u, v there. Their cross product u × v is the direction into the body in which
the contact presses. A contact that is off its place by (a, b) [m] is at the point moved by a u + b v; what
presses there is carried along the direction onto the surface (`functional.contact`).
"""

from abc import abstractmethod

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


def direction_of(place: Float[Array, "... 3 3"]) -> Float[Array, "... 3"]:
    """The unit vector (..., 3) into the body along which a contact at a place (..., 3, 3) presses."""
    return jnp.cross(place[..., 1, :], place[..., 2, :])


def moved(place: Float[Array, "... 3 3"], offset: Float[Array, "... 2"]) -> Float[Array, "... 3 3"]:
    """A place (..., 3, 3) moved along its tangents by an offset (..., 2) [m]; the tangents stay."""
    return place.at[..., 0, :].add(jnp.einsum("...k,...ki->...i", offset, place[..., 1:, :]))


class AbstractChart(eqx.Module):
    """Two coordinates [m] on a part of the surface."""

    @abstractmethod
    def place(self, at: Float[Array, "2"]) -> Float[Array, "3 3"]:
        """The place (3, 3) at coordinates (2,) [m]."""


class FlatChart(AbstractChart):
    """Distances [m] from `origin` (3,) along unit vectors `axes` (2, 3) at right angles to each other and to
    the unit vector `direction` (3,), in which contacts press: a flat face, or what is seen along one
    direction.
    """

    origin: Float[Array, "3"]
    axes: Float[Array, "2 3"]
    direction: Float[Array, "3"]

    @classmethod
    def along(cls, direction: Float[np.ndarray, "3"]) -> "FlatChart":
        """The chart of what is seen along a direction (3,) of any length: x and y where that is along z, else
        the two axes that are most across it, made level with it.
        """
        d = np.asarray(direction, float) / np.linalg.norm(direction)
        first = np.eye(3)[np.argmin(np.abs(d))]
        first = first - d * (first @ d)
        first /= np.linalg.norm(first)
        second = np.cross(d, first)
        # Of the two senses the one that points along an axis, not against it.
        second *= np.sign(second[np.argmax(np.abs(second))])
        return cls(jnp.zeros(3), jnp.asarray(np.stack([first, second])), jnp.asarray(d))

    def place(self, at):
        """The point there, with the first axis as u."""
        u = self.axes[0]
        return jnp.stack([self.origin + at @ self.axes, u, jnp.cross(self.direction, u)])
