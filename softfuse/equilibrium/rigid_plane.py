"""The flat end of a rigid tip that is moved into a body: frictionless contact with what it meets.

Ports are the positions of m points of the surface, the drive is how far the plane has moved along its unit
normal d, into the body. With the gap s_k = d · x_k − s₀ − u a point is pushed by f_k = λ_k d, 0 ≤ λ_k ⊥ s_k ≥
0: no friction, no penetration, no tension and no penalty. Points may slide along the plane; it is larger than
the patch of points.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.body.body import Body
from softfuse.equilibrium.load import AbstractLoad, Sizes
from softfuse.equilibrium.points import PointPorts
from softfuse.functional.material_points import MaterialPoints

_SOFTENING = 1e-8  # of 1/stiffness: points that a coarse mesh cannot tell apart share their force


class RigidPlane(AbstractLoad):
    """A plane of unit normal `direction` (3,) into the body, at `offset` [m] along it while its drive is 0.

    `stiffness` [N/m] weighs gaps against forces and does not move the solution.
    """

    ports: PointPorts
    direction: Float[Array, "3"]
    offset: Float[Array, ""]
    stiffness: Float[Array, ""]

    @classmethod
    def before(
        cls,
        body: Body,
        surface: Float[np.ndarray, "m 3"],
        direction: Float[np.ndarray, "3"],
    ) -> "RigidPlane":
        """A plane that meets the points `surface` (m, 3) m of a body's skin, at rest the first of them.

        `direction` (3,) of any length. Raises MeshError for a point outside the body.
        """
        d = np.asarray(direction, float) / np.linalg.norm(direction)
        points = MaterialPoints.embedded(body, surface)
        size = jnp.max(jnp.ptp(points.location, axis=0))
        stiffness = jax.lax.stop_gradient(body.pressure_unit * size)
        first = jnp.min(points.location @ d)
        return cls(PointPorts.at(points, body), jnp.asarray(d), first, stiffness)

    @property
    def sizes(self):
        """Positions and forces of m points; a magnitude for each; the plane's displacement."""
        m = self.ports.points.nodes.shape[0]
        return Sizes(ports=3 * m, forces=3 * m, internal=m, drives=1)

    def start(self):
        """No force; the plane where it stands."""
        sizes = self.sizes
        return jnp.zeros(sizes.forces), jnp.zeros(sizes.internal), jnp.zeros(1)

    def units(self):
        """Newtons."""
        return jnp.ones(self.sizes.forces + self.sizes.internal)

    def equations(self, force, internal, y, drive):
        """f_k − λ_k d = 0 (3 m,), then γ s_k = 0 where a point touches and λ_k = 0 where not (m,) [N]."""
        gap = self.stiffness * (y.reshape(-1, 3) @ self.direction - self.offset - drive[0])
        law = jnp.where(internal - gap > 0, gap + _SOFTENING * internal, internal)
        return jnp.concatenate([force - jnp.outer(internal, self.direction).ravel(), law])

    def conjugate(self, force, internal, y):
        """The force (1,) [N] that moves the plane."""
        del force, y
        return jnp.sum(internal, keepdims=True)
