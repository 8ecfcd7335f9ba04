"""Points that move with the body: each is carried by the nodes of its element, x(X) = Σ_a N_a(ξ(X)) x_a.

The local coordinates ξ solve Σ_a N_a(ξ) X_a = X on the rest mesh. Which element a point lies in, and where in
it, is found once; ξ then follows rest nodes and point differentiably, by Newton steps from there: exact for
elements with straight edges, and to first order for curved ones. With the slopes of the shape functions the
deformation gradient at a point is F = I + Σ_a u_a ⊗ ∂N_a/∂X. Points drawn on a smooth surface lie slightly
outside a coarse mesh of it; they may be put onto the mesh's surface.
"""

import logging
from functools import cache
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from softfuse.body.base import AbstractBody
from softfuse.body.shape import linear, linear_slopes, quadratic, quadratic_slopes
from softfuse.errors import MeshError
from softfuse.mesh.nearest import nearest_on_triangles
from softfuse.mesh.surface import boundary_faces
from softfuse.mesh.tetmesh import tet_mesh

log = logging.getLogger(__name__)

_NEWTON_STEPS = 6
_CANDIDATES = 32  # elements that are looked at: in the mesh of a layout the ninth was met as the right one
_OUTSIDE = 1e-6  # barycentric: a point so little outside an element counts as inside
_AT_ONCE = 64  # points that are looked for
_NAMED = 6  # points outside, in a message


@cache
def _polynomial(nodes: int) -> tuple[Float[np.ndarray, "a 4"], Float[np.ndarray, "4 a 4"]]:
    """Of an element's shape functions, at most quadratic in barycentric coordinates L: ∂N_a/∂L_i at L = 0 (a,
    4), and its own slope in L_j (j, a, i).
    """
    slopes = linear_slopes if nodes == 4 else quadratic_slopes
    at_zero = slopes(np.zeros((1, 4)))[0]
    return at_zero, slopes(np.eye(4)) - at_zero


def _shape(local: Float[Array, "g 3"], nodes: int) -> tuple[Float[Array, "g a"], Float[Array, "g a 3"]]:
    """N_a (g, a) and ∂N_a/∂ξ (g, a, 3) at ξ (g, 3)."""
    at_zero, bend = map(jnp.asarray, _polynomial(nodes))
    whole = jnp.concatenate([1 - jnp.sum(local, axis=1, keepdims=True), local], axis=1)
    slopes = at_zero + jnp.einsum("gj,jai->gai", whole, bend)
    values = jnp.einsum("gai,gi->ga", 0.5 * (slopes + at_zero), whole)
    return values, slopes[:, :, 1:] - slopes[:, :, :1]


def _step(
    local: Float[Array, "g 3"], nodes: Float[Array, "g a 3"], points: Float[Array, "g 3"]
) -> Float[Array, "g 3"]:
    """One Newton step for ξ (g, 3) of points (g, 3) m in elements with rest nodes (g, a, 3) m."""
    values, slopes = _shape(local, nodes.shape[1])
    missed = jnp.einsum("ga,gai->gi", values, nodes) - points
    inverse = _inverse(jnp.einsum("gam,gai->gmi", slopes, nodes))
    return local - jnp.einsum("gi,gim->gm", missed, inverse)


def _inverse(t: Float[Array, "g 3 3"]) -> Float[Array, "g 3 3"]:
    """Of matrices, by cross products of their rows: LAPACK takes longer for ones so small."""
    a, b, c = (t[:, k] for k in range(3))
    columns = jnp.stack([jnp.cross(b, c), jnp.cross(c, a), jnp.cross(a, b)], axis=2)
    return columns / jnp.sum(a * columns[:, :, 0], axis=1)[:, None, None]


def _found(nodes: Float[np.ndarray, "m a 3"], points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
    """ξ (m, 3) of a point (m, 3) m in each of m elements with rest nodes (m, a, 3) m, from their middles."""
    values, slopes = (linear, linear_slopes) if nodes.shape[1] == 4 else (quadratic, quadratic_slopes)
    local = np.full((len(nodes), 3), 0.25)
    for _ in range(_NEWTON_STEPS):
        whole = np.concatenate([1 - local.sum(axis=1, keepdims=True), local], axis=1)
        each = slopes(whole)
        along = np.einsum("mai,mak->mik", nodes, each[:, :, 1:] - each[:, :, :1])
        missed = np.einsum("ma,mai->mi", values(whole), nodes) - points
        local -= np.linalg.solve(along, missed[..., None])[..., 0]
    return local


class MaterialPoints(eqx.Module):
    """g points at rest locations (g, 3) m, carried by the nodes (g, a) of the elements (g,) they lie in, at
    `local` coordinates ξ (g, 3) where they were found.
    """

    element: Int[Array, " g"]
    nodes: Int[Array, "g a"]
    location: Float[Array, "g 3"]
    local: Float[Array, "g 3"]

    @classmethod
    def embedded(
        cls,
        body: AbstractBody,
        points: Float[np.ndarray, "g 3"],
        *,
        named: str = "point",
        within: float = 0.0,
    ) -> "MaterialPoints":
        """The points (g, 3) m of a body; `named`: what each is called in messages.

        Those up to `within` [m] outside it are put onto its surface, with a note in the log. Raises
        MeshError, with how far and the nearest places, for points that are further out.
        """
        tets, rest = np.asarray(body.tets), np.asarray(body.rest)
        given = np.asarray(points, float).reshape(-1, 3)
        corner = rest[tets[:, :4]]
        inverse = np.linalg.inv(np.swapaxes(corner[:, 1:] - corner[:, :1], 1, 2))
        element, local, depth = np.zeros(len(given), int), np.zeros((len(given), 3)), np.zeros(len(given))
        count = min(_CANDIDATES, len(tets))
        for first in range(0, len(given), _AT_ONCE):
            at = slice(first, first + _AT_ONCE)
            flat = np.einsum("eij,pej->pei", inverse, given[at, None] - corner[:, 0])
            inside = np.minimum(flat.min(axis=2), 1 - flat.sum(axis=2))
            # An element with curved edges may hold the point although its corners' tetrahedron does not.
            near = np.argpartition(-inside, count - 1, axis=1)[:, :count]
            places = _found(rest[tets[near]].reshape(-1, tets.shape[1], 3), np.repeat(given[at], count, 0))
            places = places.reshape(-1, count, 3)
            each = np.nan_to_num(np.minimum(places.min(axis=2), 1 - places.sum(axis=2)), nan=-np.inf)
            best, one = np.argmax(each, axis=1), np.arange(len(near))
            element[at], local[at], depth[at] = near[one, best], places[one, best], each[one, best]
        outside = np.flatnonzero(~(depth >= -_OUTSIDE))
        if len(outside):
            found = nearest_places(body, given[outside])
            far = found.apart > within
            if far.any():
                raise MeshError(
                    _told_outside(given, outside[far], found.at(far), named) + ": move into the material"
                )
            log.warning("%s: put onto its surface", _told_outside(given, outside, found, named))
            element[outside], local[outside], given[outside] = found.element, found.local, found.place
        return cls(jnp.asarray(element), jnp.asarray(tets[element]), jnp.asarray(given), jnp.asarray(local))

    def _placed(self, rest: Float[Array, "k 3"]) -> tuple[Float[Array, "g 3"], Float[Array, "g a 3"]]:
        """ξ (g, 3) of the points, and the rest nodes (g, a, 3) m of their elements."""
        nodes = rest[self.nodes]
        near = _step(*jax.lax.stop_gradient((self.local, nodes, self.location)))
        return _step(near, nodes, self.location), nodes

    def shape(self, rest: Float[Array, "k 3"]) -> Float[Array, "g a"]:
        """Shape-function values (g, a) [-] on rest nodes (k, 3) m."""
        return _shape(self._placed(rest)[0], self.nodes.shape[1])[0]

    def gradients(self, rest: Float[Array, "k 3"]) -> Float[Array, "g a 3"]:
        """∂N_a/∂X (g, a, 3) [1/m] on rest nodes (k, 3) m."""
        local, nodes = self._placed(rest)
        slopes = _shape(local, nodes.shape[1])[1]
        # ∂ξ_m/∂X_j is the transpose of the inverse of ∂X_j/∂ξ_m.
        return jnp.einsum("gam,gjm->gaj", slopes, _inverse(jnp.einsum("gam,gai->gmi", slopes, nodes)))

    def positions(self, rest: Float[Array, "k 3"], displacement: Float[Array, "k 3"]) -> Float[Array, "g 3"]:
        """Where the points are (g, 3) [m] when nodes at `rest` (k, 3) m have moved by (k, 3) m."""
        return self.location + jnp.einsum("ga,gai->gi", self.shape(rest), displacement[self.nodes])

    def deformation(
        self, rest: Float[Array, "k 3"], displacement: Float[Array, "k 3"]
    ) -> Float[Array, "g 3 3"]:
        """F (g, 3, 3) [-] at the points when nodes at `rest` (k, 3) m have moved by (k, 3) m."""
        moved = jnp.einsum("gai,gaj->gij", displacement[self.nodes], self.gradients(rest))
        return jnp.eye(3) + moved


def ball(centre: Float[np.ndarray, "3"], radius: float) -> Float[np.ndarray, "b 3"]:
    """Points (b, 3) m whose mean stands for that over a ball of `radius` [m] around `centre` (3,) m.

    Exact for polynomials of third order.
    """
    steps = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    inner = steps[(steps**2).sum(axis=1) < 3]
    # The mean of |x|² over a ball is 3/5 of its radius squared.
    spacing = radius * np.sqrt(0.6 / (inner**2).sum(axis=1).mean())
    return centre + spacing * inner


class SurfacePlaces(NamedTuple):
    """g places (g, 3) m on the surface of a body, in its elements (g,) at ξ (g, 3), and how far (g,) m they
    are from the points that they are nearest to.
    """

    place: Float[np.ndarray, "g 3"]
    element: Int[np.ndarray, " g"]
    local: Float[np.ndarray, "g 3"]
    apart: Float[np.ndarray, " g"]

    def at(self, which: Bool[np.ndarray, " g"]) -> "SurfacePlaces":
        """Some of them."""
        return SurfacePlaces(*(each[which] for each in self))


def nearest_places(body: AbstractBody, points: Float[np.ndarray, "g 3"]) -> SurfacePlaces:
    """The places on the surface of a body at rest that are nearest to points (g, 3) m."""
    tets, rest = np.asarray(body.tets), np.asarray(body.rest)
    surface = boundary_faces(tet_mesh(rest, tets))
    pieces = np.array(
        [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]] if surface.faces.shape[1] == 6 else [[0, 1, 2]]
    )
    corners = rest[surface.faces[:, pieces]].reshape(-1, 3, 3)
    near = nearest_on_triangles(points, corners)
    element = surface.tets[near.triangle // len(pieces)]
    foot = np.einsum("gk,gki->gi", near.barycentric, corners[near.triangle])
    local = _found(rest[tets[element]], foot)
    # Of a curved face the triangle is a chord, which may be outside.
    whole = np.maximum(np.concatenate([1 - local.sum(axis=1, keepdims=True), local], axis=1), 0.0)
    whole /= whole.sum(axis=1, keepdims=True)
    values = (linear if tets.shape[1] == 4 else quadratic)(whole)
    place = np.einsum("ga,gai->gi", values, rest[tets[element]])
    return SurfacePlaces(place, element, whole[:, 1:], np.linalg.norm(place - points, axis=1))


def _told_outside(
    points: Float[np.ndarray, "p 3"], outside: Int[np.ndarray, " g"], found: SurfacePlaces, named: str
) -> str:
    """What is said of those of some points that are outside, each with its distance."""
    each = [
        f"{named} {k} at {_mm(points[k])} mm lies outside the body by {1e3 * by:.3g} mm "
        f"(nearest place {_mm(place)} mm)"
        for k, place, by in zip(outside[:_NAMED], found.place, found.apart, strict=False)
    ]
    if len(outside) > _NAMED:
        each.append(f"{len(outside) - _NAMED} more lie outside")
    return "; ".join(each)


def _mm(place: Float[np.ndarray, "3"]) -> str:
    return f"({', '.join(f'{1e3 * c:.6g}' for c in place)})"
