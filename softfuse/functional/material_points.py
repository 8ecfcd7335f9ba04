"""Points that move with the body: each is carried by the nodes of its element, x(X) = Σ_a N_a(ξ(X)) x_a.

The local coordinates ξ solve Σ_a N_a(ξ) X_a = X on the rest mesh. Which element a point lies in is found
once; ξ follows rest nodes and point differentiably: one Newton step from the solution, exact for elements
with straight edges and to first order for curved ones. Points drawn on a smooth surface lie slightly outside
a coarse mesh of it; they are put onto the mesh's surface.
"""

import logging

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.body.base import AbstractBody
from softfuse.body.shape import linear, quadratic
from softfuse.errors import MeshError
from softfuse.mesh.surface import boundary_faces
from softfuse.mesh.tetmesh import tet_mesh

log = logging.getLogger(__name__)

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
    def embedded(
        cls, body: AbstractBody, points: Float[np.ndarray, "g 3"], *, within: float = 0.0, what: str = "point"
    ) -> "MaterialPoints":
        """The points (g, 3) m of a body; what: what they are called.

        within [m]: those that are so far outside the body or less are put onto its surface, with a note in
        the log. Raises MeshError, which names all that are further out, how far, and the nearest places.
        """
        tets, rest = np.asarray(body.tets), np.asarray(body.rest)
        corner = rest[tets[:, :4]]
        edges = np.swapaxes(corner[:, 1:] - corner[:, :1], 1, 2)
        location = np.array(points, float).reshape(-1, 3)
        element, outside = np.zeros(len(location), int), []
        for k, point in enumerate(location):
            flat = np.linalg.solve(edges, (point - corner[:, 0])[..., None])[..., 0]
            inside = np.minimum(flat.min(axis=1), 1 - flat.sum(axis=1))
            # An element with curved edges may hold the point although its corners' tetrahedron does not.
            near = np.argsort(-inside)[:_CANDIDATES]
            local = np.asarray(_locals(rest[tets[near]], point))
            depth = np.minimum(local.min(axis=1), 1 - local.sum(axis=1))
            best = int(np.argmax(depth))
            element[k] = near[best]
            if not depth[best] >= -_OUTSIDE:
                outside.append(k)
        if outside:
            owners, places, apart = nearest_places(body, location[outside])
            told = [
                f"{what} {k} at {_mm(location[k])} mm lies {1e3 * far:.3g} mm outside the body (nearest "
                f"place {_mm(place)} mm)"
                for k, place, far in zip(outside, places, apart, strict=True)
            ]
            far_out = [text for text, far in zip(told, apart, strict=True) if far > within]
            if far_out:
                raise MeshError(f"{'; '.join(far_out)}: move into the material")
            log.warning("%s: put onto its surface", "; ".join(told))
            element[outside], location[outside] = owners, places
        return cls(jnp.asarray(element), jnp.asarray(tets[element]), jnp.asarray(location))

    def shape(self, rest: Float[Array, "k 3"]) -> Float[Array, "g a"]:
        """Shape-function values (g, a) [-] on rest nodes (k, 3) m."""
        local = jax.vmap(_local)(rest[self.nodes], self.location)
        return jax.vmap(lambda xi: _values(xi, self.nodes.shape[1]))(local)


def nearest_places(
    body: AbstractBody, points: Float[np.ndarray, "g 3"]
) -> tuple[Int[np.ndarray, " g"], Float[np.ndarray, "g 3"], Float[np.ndarray, " g"]]:
    """For points (g, 3) m the nearest places (g, 3) m on the surface of a body at rest, in which elements
    (g,) these are, and how far (g,) m from the points.
    """
    import trimesh
    from trimesh.proximity import closest_point

    tets, rest = np.asarray(body.tets), np.asarray(body.rest)
    surface = boundary_faces(tet_mesh(rest, tets))
    pieces = [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]] if surface.faces.shape[1] == 6 else [[0, 1, 2]]
    triangles = trimesh.Trimesh(rest, surface.faces[:, pieces].reshape(-1, 3), process=False)
    places, _, piece = closest_point(triangles, points)
    owner = surface.tets[np.asarray(piece) // len(pieces)]
    for k, (place, element) in enumerate(zip(np.asarray(places), owner, strict=True)):
        local = np.asarray(_locals(rest[tets[[element]]], place))[0]
        # Of a curved face the triangle is a chord, which may be outside.
        whole = np.maximum(np.append(1 - local.sum(), local), 0.0)
        places[k] = (
            np.asarray(_values(jnp.asarray(whole[1:] / whole.sum()), tets.shape[1])) @ rest[tets[element]]
        )
    return owner, places, np.linalg.norm(places - points, axis=1)


def _mm(place: Float[np.ndarray, "3"]) -> str:
    return f"({', '.join(f'{1e3 * c:.6g}' for c in place)})"
