"""Coordinates on a part of a body's surface, and the places that they name.

A *place* is where a contact presses on the body at rest: an array (3, 3) whose rows are a point of the
surface [m] and two unit tangents u, v there. Their cross product u × v is the outward normal; a contact
presses against it. A contact that is off its place by (a, b) [m] is at the point moved by a u + b v; what
presses there is carried along the direction onto the surface (`functional.contact`).
"""

from collections.abc import Sequence
from typing import TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int


def direction_of(place: Float[Array | np.ndarray, "... 3 3"]) -> Float[Array, "... 3"]:
    """The unit vector (..., 3) into the body along which a contact at a place (..., 3, 3) presses."""
    return jnp.cross(place[..., 2, :], place[..., 1, :])


Numbers = TypeVar("Numbers", Array, np.ndarray)


def moved(place: Numbers, offset: Numbers) -> Numbers:
    """A place (..., 3, 3) moved along its tangents by an offset (..., 2) [m]; the tangents stay."""
    tangents = place[..., 1:, :]
    along = (offset[..., None] * tangents).sum(axis=-2, keepdims=True)
    return place.__array_namespace__().concat([place[..., :1, :] + along, tangents], axis=-2)


def across(
    direction: Sequence[float] | Float[np.ndarray, "3"],
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """The unit vector (3,) along a direction of any length, and that across it nearest to one of x, y, z."""
    d = np.asarray(direction, float) / np.linalg.norm(direction)
    first = np.eye(3)[np.argmin(np.abs(d))]
    first = first - d * (first @ d)
    return d, first / np.linalg.norm(first)


def facing(
    points: Float[np.ndarray, "... 3"], direction: Sequence[float] | Float[np.ndarray, "3"]
) -> Float[np.ndarray, "... 3 3"]:
    """The places (..., 3, 3) at points (..., 3) m that are pressed along one direction (3,) of any length."""
    into, u = across(direction)
    tangents = np.broadcast_to([u, np.cross(u, into)], (*np.shape(points)[:-1], 2, 3))
    return np.concatenate([np.asarray(points, float)[..., None, :], tangents], axis=-2)


def nearest(
    places: Float[np.ndarray, "e 3 3"], place: Float[np.ndarray, "... 3 3"]
) -> Int[np.ndarray | np.int64, "..."]:
    """The number (...) of that of some places (e, 3, 3) whose point is nearest to a place's (..., 3, 3)."""
    away = np.asarray(place)[..., None, 0, :] - places[:, 0]
    return np.argmin(np.sum(away**2, axis=-1), axis=-1)


class FlatChart(eqx.Module):
    """Distances [m] from `origin` (3,) along unit vectors `axes` (2, 3) at right angles to each other and to
    the unit vector `direction` (3,), in which contacts press: a flat face, or what is seen along it.
    """

    origin: Float[Array, "3"]
    axes: Float[Array, "2 3"]
    direction: Float[Array, "3"]

    @classmethod
    def along(cls, direction: Sequence[float] | Float[np.ndarray, "3"]) -> "FlatChart":
        """The chart of what is seen along a direction (3,) of any length: x and y where that is along z, else
        two axes across it, each as near as may be to one of x, y, z.
        """
        into, first = across(direction)
        second = np.cross(into, first)
        axes = np.stack([first, second * np.sign(second[np.argmax(np.abs(second))])])
        return cls(jnp.zeros(3), jnp.asarray(axes), jnp.asarray(into))

    @property
    def tangents(self) -> Float[Array, "2 3"]:
        """u, along the first axis, and v, along or against the second (2, 3)."""
        u = self.axes[0]
        return jnp.stack([u, jnp.cross(u, self.direction)])

    def place(self, at: Float[Array, "... 2"]) -> Float[Array, "... 3 3"]:
        """The places (..., 3, 3) at coordinates (..., 2) [m], all with the same tangents."""
        point = self.origin + at @ self.axes
        return jnp.concatenate(
            [point[..., None, :], jnp.broadcast_to(self.tangents, (*point.shape[:-1], 2, 3))], axis=-2
        )

    def coordinates(self, place: Float[np.ndarray, "... 3 3"]) -> Float[np.ndarray, "... 2"]:
        """The coordinates (..., 2) [m] of places (..., 3, 3): how far along the axes they are."""
        return (place[..., 0, :] - np.asarray(self.origin)) @ np.asarray(self.axes).T
