"""A rigid cylinder that is moved into a body: frictionless contact with whatever of the surface it meets.

Ports are the positions of m points of the surface, the drive is how far the cylinder has moved along its unit
direction d from where it first touches the body at rest. With the distance ρ_k (3,) of point k from the axis,
perpendicular to it, and the gap s_k = |ρ_k| − R, a point is pushed by f_k = λ_k ρ_k / |ρ_k|, 0 ≤ λ_k ⊥ s_k ≥
0: no friction, no penetration, no tension and no penalty. Points may slide over the cylinder and along it.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.body.base import AbstractBody
from softfuse.functional.material_points import MaterialPoints
from softfuse.mechanics.load import AbstractLoad, Sizes
from softfuse.mechanics.points import PointPorts

_SOFTENING = 1e-8  # of 1/stiffness: points that a coarse mesh cannot tell apart share their force


class RigidCylinder(AbstractLoad):
    """A cylinder of `radius` [m] around the line through `centre` (3,) m along the unit vector `axis` (3,),
    moved along the unit vector `direction` (3,).

    `stiffness` [N/m] weighs gaps against forces and does not move the solution.
    """

    ports: PointPorts
    centre: Float[Array, "3"]
    axis: Float[Array, "3"]
    direction: Float[Array, "3"]
    radius: Float[Array, ""]
    stiffness: Float[Array, ""]

    @classmethod
    def before(
        cls,
        body: AbstractBody,
        surface: Float[np.ndarray, "m 3"],
        at: Float[np.ndarray, "3"],
        direction: Float[np.ndarray, "3"],
        axis: Float[np.ndarray, "3"],
        radius: float,
    ) -> "RigidCylinder":
        """A cylinder that can meet the points `surface` (m, 3) m of a body's skin and at rest touches the
        flat skin at the point `at` (3,) m.

        `direction` into the body and `axis` across it, (3,) of any length. Raises MeshError for a point
        outside the body.
        """
        d = np.asarray(direction, float) / np.linalg.norm(direction)
        along = np.asarray(axis, float) / np.linalg.norm(axis)
        ports = PointPorts.at(MaterialPoints.embedded(body, surface), body)
        stiffness = jax.lax.stop_gradient(body.pressure_unit * radius)
        centre = jnp.asarray(np.asarray(at) - radius * d)
        return cls(ports, centre, jnp.asarray(along), jnp.asarray(d), jnp.asarray(radius, float), stiffness)

    @property
    def sizes(self):
        """Positions and forces of m points; a magnitude for each; the cylinder's displacement."""
        m = self.ports.points.nodes.shape[0]
        return Sizes(ports=3 * m, forces=3 * m, internal=m, drives=1)

    def start(self):
        """No force; the cylinder where it first touches."""
        sizes = self.sizes
        return jnp.zeros(sizes.forces), jnp.zeros(sizes.internal), jnp.zeros(1)

    def units(self):
        """Newtons."""
        return jnp.ones(self.sizes.forces + self.sizes.internal)

    def equations(self, force, internal, y, drive):
        """f_k − λ_k ρ_k/|ρ_k| = 0 (3 m,), then γ s_k = 0 or, off the surface, λ_k = 0 (m,) [N]."""
        away = y.reshape(-1, 3) - (self.centre + drive[0] * self.direction)
        away = away - jnp.outer(away @ self.axis, self.axis)
        apart = jnp.linalg.norm(away, axis=1)
        gap = self.stiffness * (apart - self.radius)
        law = jnp.where(internal - gap > 0, gap + _SOFTENING * internal, internal)
        return jnp.concatenate([force - ((internal / apart)[:, None] * away).ravel(), law])

    def conjugate(self, force, internal, y):
        """The force (1,) [N] along its direction that moves the cylinder."""
        del internal, y
        return jnp.sum(force.reshape(-1, 3) @ self.direction, keepdims=True)
