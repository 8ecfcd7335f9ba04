"""Points that move with the body: each is carried by the nodes of its element, x(X) = Σ_a N_a(ξ(X)) x_a.

The local coordinates ξ solve Σ_a N_a(ξ) X_a = X on the rest mesh. Which element a point lies in is found
once; ξ follows rest nodes and point differentiably: one Newton step from the solution, exact for elements
with straight edges and to first order for curved ones.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.body.base import AbstractBody
from softfuse.body.shape import linear, quadratic
from softfuse.errors import MeshError

_NEWTON_STEPS = 6
_CANDIDATES = 32  # elements that are looked at: in the mesh of a layout the ninth was met as the right one
_OUTSIDE = 1e-6  # barycentric: a point so little outside an element counts as inside


def _values(local: Float[Array, "3"], nodes: int) -> Float[Array, " a"]:
    whole = jnp.concatenate([1 - jnp.sum(local, keepdims=True), local])
    return linear(whole) if nodes == 4 else quadratic(whole)


def _local(corners_and_middles: Float[Array, "a 3"], point: Float[Array, "3"]) -> Float[Array, "3"]:
    """ξ (3,) of a point (3,) m in an element with rest nodes (a, 3) m."""
    a = corners_and_middles.shape[0]

    def missed(local, nodes, point):
        return _values(local, a) @ nodes - point

    def step(local, nodes, point):
        return local - jnp.linalg.solve(jax.jacfwd(missed)(local, nodes, point), missed(local, nodes, point))

    given = jax.lax.stop_gradient((corners_and_middles, point))
    # A loop: written out, these steps were a fifth of every program.
    local = jax.lax.fori_loop(0, _NEWTON_STEPS, lambda _, local: step(local, *given), jnp.full(3, 0.25))
    return step(local, corners_and_middles, point)


_locals = jax.jit(jax.vmap(_local, (0, None)))
"""ξ (e, 3) of one point (3,) m in each of e elements with rest nodes (e, a, 3) m."""


class MaterialPoints(eqx.Module):
    """g points at rest locations (g, 3) m, carried by the nodes (g, a) of the elements (g,) they lie in."""

    element: Int[Array, " g"]
    nodes: Int[Array, "g a"]
    location: Float[Array, "g 3"]

    @classmethod
    def embedded(cls, body: AbstractBody, points: Float[np.ndarray, "g 3"]) -> "MaterialPoints":
        """The points (g, 3) m of a body. Raises MeshError for a point that lies outside it."""
        tets, rest = np.asarray(body.tets), np.asarray(body.rest)
        corner = rest[tets[:, :4]]
        edges = np.swapaxes(corner[:, 1:] - corner[:, :1], 1, 2)
        found = []
        for k, point in enumerate(np.asarray(points, float).reshape(-1, 3)):
            flat = np.linalg.solve(edges, (point - corner[:, 0])[..., None])[..., 0]
            inside = np.minimum(flat.min(axis=1), 1 - flat.sum(axis=1))
            # An element with curved edges may hold the point although its corners' tetrahedron does not.
            near = np.argsort(-inside)[:_CANDIDATES]
            local = np.asarray(_locals(rest[tets[near]], point))
            depth = np.minimum(local.min(axis=1), 1 - local.sum(axis=1))
            best = int(np.argmax(depth))
            if not depth[best] >= -_OUTSIDE:
                raise MeshError(
                    f"point {k} at ({', '.join(f'{1e3 * c:g}' for c in point)}) mm lies outside the body: "
                    "move it into the material"
                )
            found.append(near[best])
        element = np.array(found, int)
        location = jnp.asarray(points, float).reshape(-1, 3)
        return cls(jnp.asarray(element), jnp.asarray(tets[element]), location)

    def shape(self, rest: Float[Array, "k 3"]) -> Float[Array, "g a"]:
        """Shape-function values (g, a) [-] on rest nodes (k, 3) m."""
        local = jax.vmap(_local)(rest[self.nodes], self.location)
        return jax.vmap(lambda xi: _values(xi, self.nodes.shape[1]))(local)
