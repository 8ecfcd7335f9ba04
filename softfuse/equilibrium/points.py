"""Positions of material points as ports: their conjugate forces are point forces."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from softfuse.body.body import Body
from softfuse.equilibrium.load import AbstractPorts
from softfuse.functional.material_points import MaterialPoints


class PointPorts(AbstractPorts):
    """x, y, z of g material points, one after the other: 3 g ports [m]; `support` [N/m]: of each."""

    points: MaterialPoints
    support: Float[Array, ""]

    @classmethod
    def at(cls, points: MaterialPoints, body: Body) -> "PointPorts":
        """Ports supported as stiffly as a piece of the body as long as the points are apart."""
        apart = jnp.linalg.norm(jnp.diff(points.location, axis=0), axis=1)
        spacing = jnp.mean(apart) if apart.size else jnp.cbrt(jnp.sum(body.weights))
        return cls(points, jax.lax.stop_gradient(body.pressure_unit * spacing))

    def values(self, body, z):
        """Positions (3 g,) [m]."""
        x = body.rest + body.displacement(z)
        return jnp.einsum("ga,gai->gi", self.points.shape(body.rest), x[self.points.nodes]).ravel()

    def rows(self, body, z):
        """Shape values in the rows of the points' nodes (n, 3 g) [-]."""
        del z
        shape = self.points.shape(body.rest)
        g = shape.shape[0]
        spread = jnp.einsum("ga,ij,gh->gaihj", shape, jnp.eye(3), jnp.eye(g)).reshape(g, -1, 3, 3 * g)
        index = body.displacement_index[self.points.nodes]
        return jnp.zeros((body.n, 3 * g)).at[index].add(spread, mode="drop")

    def stiffen(self, body, z, force, tangents):
        """The tangents with the supporting springs; the ports are linear."""
        del z, force
        shape = self.points.shape(body.rest)
        a = shape.shape[1]
        spring = self.support * jnp.einsum("ga,gb,ij->gaibj", shape, shape, jnp.eye(3))
        block = spring.reshape(-1, 3 * a, 3 * a)
        return tangents.at[self.points.element, : 3 * a, : 3 * a].add(block)

    @property
    def supports(self):
        """The same spring for all (3 g,) [N/m]."""
        return jnp.full(3 * self.points.nodes.shape[0], self.support)
