"""A closed surface with a place, sizes and an orientation: x(u) = c + R(ω) (h ∘ r(u) u).

c is the centre [m], h the half-sizes [m] along the cavity's own axes, R(ω) the turn by the rotation vector ω
[rad] (by |ω| about ω/|ω|), r(u) the radius of the cavity's `profile`. A point of the surface keeps its
direction u while the values (c, h, ω, then the profile's parameters) change: that is what a mesh follows.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.robot.layout.profile import AbstractProfile

PLACE = ("x", "y", "z", "half x", "half y", "half z", "turn x", "turn y", "turn z")
"""Names of the first nine values: centre [m], half-sizes [m], rotation vector [rad]."""

_SMALL_ANGLE = 1e-12
"""rad² below which a turn is told from none by its first order."""


class CavityShape(eqx.Module):
    """A kind of cavity: which surface its values (v,) describe."""

    profile: AbstractProfile

    @property
    def names(self) -> tuple[str, ...]:
        """Of the values (v,): those of PLACE, then the profile's."""
        return (*PLACE, *self.profile.names)

    def centre(self, values: Float[Array, " v"]) -> Float[Array, "3"]:
        """Centre (3,) [m]."""
        return values[:3]

    def half_sizes(self, values: Float[Array, " v"]) -> Float[Array, "3"]:
        """Half-sizes (3,) [m] along its own axes."""
        return values[3:6]

    def grown(self, values: Float[Array, " v"], more: Float[Array, ""]) -> Float[Array, " v"]:
        """The values (v,) of a cavity whose half-sizes are `more` m larger."""
        return values.at[3:6].add(more)

    def points(
        self, values: Float[Array, " v"], directions: Float[Array | np.ndarray, "m 3"]
    ) -> Float[Array, "m 3"]:
        """Points (m, 3) [m] of the surface along unit directions (m, 3) of its own, scaled axes.

        Differentiable in the values (v,).
        """
        radius = self.profile.radius(values[9:], self.half_sizes(values), directions)
        local = self.half_sizes(values) * (radius[:, None] * directions)
        return self.centre(values) + local @ rotation(values[6:9]).T

    def reach(self, values: Float[Array, " v"], normals: Float[Array, "m 3"]) -> Float[Array, " m"]:
        """How far (m,) [m] the surface, or its convex hull, reaches along unit vectors (m, 3): max n · x.

        Differentiable in both.
        """
        own = normals @ rotation(values[6:9])
        return normals @ self.centre(values) + self.profile.support(values[9:], self.half_sizes(values), own)

    def slack(self, values: Float[Array, " v"]) -> Float[Array, " s"]:
        """What must not be negative (s,) [m] for such a surface to exist."""
        return self.profile.slack(values[9:], self.half_sizes(values))


def rotation(vector: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """The matrix (3, 3) that turns by a rotation vector (3,) [rad]; differentiable, at 0 too.

    With K v = ω × v: R = 1 + sin|ω|/|ω| K + (1 − cos|ω|)/|ω|² K² (Rodrigues).
    """
    square = vector @ vector
    small = square < _SMALL_ANGLE
    angle = jnp.sqrt(jnp.where(small, 1.0, square))
    first = jnp.where(small, 1.0 - square / 6.0, jnp.sin(angle) / angle)
    second = jnp.where(small, 0.5 - square / 24.0, (1.0 - jnp.cos(angle)) / angle**2)
    cross = jnp.cross(vector, jnp.eye(3), axisa=0, axisb=0, axisc=0)
    return jnp.eye(3) + first * cross + second * (cross @ cross)
