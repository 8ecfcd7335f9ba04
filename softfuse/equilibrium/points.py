"""Positions of material points as ports: their conjugate forces are point forces."""

import jax.numpy as jnp

from softfuse.equilibrium.load import AbstractPorts
from softfuse.functional.material_points import MaterialPoints


class PointPorts(AbstractPorts):
    """x, y, z of g material points, one after the other: 3 g ports [m]."""

    points: MaterialPoints

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
        """The tangents as they are: the ports are linear."""
        del body, z, force
        return tangents
