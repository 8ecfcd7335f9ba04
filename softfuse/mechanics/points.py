"""Positions of material points as ports: their conjugate forces act on points, or are shared by several.

A point force sinks into an elastic body the deeper the finer the mesh, without limit: what carries a large
one has to be given its size.
"""

from abc import abstractmethod

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from softfuse.body.base import AbstractBody
from softfuse.errors import SolveError
from softfuse.functional.material_points import MaterialPoints
from softfuse.mechanics.load import AbstractPorts, force_resultants


class AbstractGuides(AbstractPorts):
    """x, y, z of g places in a body, one after the other: 3 g ports [m], linear in the body's unknowns."""

    @property
    @abstractmethod
    def location(self) -> Float[Array, "g 3"]:
        """Where they are on the body at rest (g, 3) [m]."""

    def moved_to(self, location: Float[Array, "g 3"]) -> "AbstractGuides":
        """The same at other places (g, 3) m on the body at rest. Raises SolveError for a reduced body's."""
        del location
        raise SolveError("guides of a reduced body stay where they are: move those of the full one")

    def resultants(self, body, z):
        """Unit forces along the axes at the places (6, 3 g)."""
        return force_resultants(self.values(body, z).reshape(-1, 3))


class PointPorts(AbstractGuides):
    """x, y, z of g weighted means of m material points, one after the other: 3 g ports [m].

    `share` (g, m): weights, each row's sum is 1; `support` [N/m]: of each mean that is a single point.
    """

    points: MaterialPoints
    share: Float[Array, "g m"]
    support: Float[Array, ""]

    @classmethod
    def at(cls, points: MaterialPoints, body: AbstractBody) -> "PointPorts":
        """Each point by itself."""
        return cls.shared(points, jnp.eye(points.nodes.shape[0]), body)

    @classmethod
    def shared(cls, points: MaterialPoints, share: Float[Array, "g m"], body: AbstractBody) -> "PointPorts":
        """Means of points; single ones are supported as stiffly as a piece of the body between them."""
        apart = jnp.linalg.norm(jnp.diff(share @ points.location, axis=0), axis=1)
        spacing = jnp.mean(apart) if apart.size else jnp.cbrt(body.volume)
        support = jax.lax.stop_gradient(body.pressure_unit * spacing)
        return cls(points, jnp.asarray(share, float), support)

    @property
    def location(self):
        """Where the means are on the body at rest (g, 3) [m]."""
        return self.share @ self.points.location

    def moved_to(self, location):
        """As long as these are in or next to the same elements; differentiable in them."""
        shift = jnp.sign(self.share).T @ (location - self.location)
        return eqx.tree_at(lambda p: p.points.location, self, self.points.location + shift)

    @property
    def _single(self) -> Float[Array, "g m"]:
        return jnp.where(self.share == 1, 1.0, 0.0)

    def values(self, body, z):
        """Positions (3 g,) [m]."""
        nodes = self.points.nodes
        x = body.rest[nodes] + body.watched(z)[nodes]
        each = jnp.einsum("ma,mai->mi", self.points.shape(body.rest), x)
        return (self.share @ each).ravel()

    def rows(self, body, z):
        """Shares of the shape values in the rows of the points' nodes (n, 3 g) [-]."""
        del z
        shape = self.points.shape(body.rest)
        m, g = shape.shape[0], self.share.shape[0]
        spread = jnp.einsum("ma,ij,gm->maigj", shape, jnp.eye(3), self.share).reshape(m, -1, 3, 3 * g)
        return body.spread(self.points.nodes, spread)

    def stiffen(self, body, z, force, tangents):
        """The tangents with the supporting springs; the ports are linear."""
        del z, force
        shape = self.points.shape(body.rest)
        a = shape.shape[1]
        springs = self.support * jnp.sum(self._single, axis=0)
        spring = jnp.einsum("m,ma,mb,ij->maibj", springs, shape, shape, jnp.eye(3))
        block = spring.reshape(-1, 3 * a, 3 * a)
        return body.stiffened(tangents, self.points.element, self.points.nodes, block)

    @property
    def supports(self):
        """The same spring for all single points, none for means (3 g,) [N/m]."""
        return self.support * jnp.repeat(jnp.sum(self._single, axis=1), 3)
