"""Enclosed volume Φ of a surface: Φ = 1/3 ∮ x · n dA, exact for the curved faces of quadratic elements.

x · (∂x/∂ξ × ∂x/∂η) is a polynomial of degree 4 (quadratic faces) or 1 (linear ones) in ξ, η, and the
quadrature is exact for it. An open surface, such as that of a chamber with an inlet, is closed by a cap: the
fan from the mean c of its rim's corners to the rim. Φ = 1/3 ∫ (x − c) · n dA over the faces alone, since the
cones from c over the fan are flat; it does not change when the body moves as a whole.

The conjugate force of Φ is the gauge pressure inside [Pa]. On a cap it acts too, as on a membrane without
mass that hands all of it to the rim: what a plug or the fitting of a tube does that is glued in there.
Source: the divergence theorem; Navarro et al. 2020, eq. 8.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.body.quadrature import TRIANGLE_6
from softfuse.body.shape import linear, linear_slopes, quadratic, quadratic_slopes
from softfuse.functional.base import AbstractFunctional


def cone_volume(x: Float[Array, "s 3"]) -> Float[Array, ""]:
    """Signed volume [m³] between the origin and one face of nodes x (s, 3) m."""
    points, weights = TRIANGLE_6
    is_linear = x.shape[0] == 3
    values = linear(points) if is_linear else quadratic(points)
    slopes = linear_slopes(points) if is_linear else quadratic_slopes(points)
    along = jnp.einsum("si,qsd->dqi", x, slopes[:, :, 1:] - slopes[:, :, :1])
    outwards = jnp.cross(along[0], along[1])
    return jnp.einsum("qi,qi,q->", jnp.asarray(values) @ x, outwards, jnp.asarray(weights)) / 6.0


class Cavity(AbstractFunctional):
    """Faces (f, 3) or (f, 6) whose normals point out of the enclosed space, and the corners (r,) of the rim
    that a cap closes, none of a closed surface.
    """

    faces: Int[Array, "f s"]
    rim: Int[Array, " r"] = eqx.field(default_factory=lambda: jnp.zeros(0, jnp.int32))

    @classmethod
    def of(cls, faces: Int[np.ndarray, "f s"]) -> "Cavity":
        """The volume inside faces (f, 3) or (f, 6), closed or with one rim."""
        return cls(jnp.asarray(faces), jnp.asarray(np.unique(rim_edges(np.asarray(faces))), jnp.int32))

    def __call__(self, positions: Float[Array, "k 3"]) -> Float[Array, ""]:
        """Enclosed volume [m³] at node positions (k, 3) m."""
        return jnp.sum(jax.vmap(cone_volume)(positions[self.faces] - self.apex(positions)))

    def change(self, body, z):
        """By how much the volume [m³] has grown at unknowns z (n,) of a body that watches the walls."""
        return self(body.rest + body.watched(z)) - self(body.rest)

    def apex(self, positions: Float[Array, "k 3"]) -> Float[Array, "3"]:
        """Where the cap's triangles meet (3,) m; the origin of a closed surface."""
        return jnp.mean(positions[self.rim], axis=0) if self.rim.size else jnp.zeros(3)


def rim_edges(faces: Int[np.ndarray, "f s"]) -> Int[np.ndarray, "r 2"]:
    """Corners (r, 2) of the edges that belong to one of the faces (f, 3) or (f, 6) only."""
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    return unique[count == 1]


def volume_within(faces: Int[np.ndarray, "f s"], nodes: Float[np.ndarray, "k 3"]) -> float:
    """The volume [m³] inside faces (f, 3) or curved ones (f, 6) of nodes (k, 3) m, closed or with one rim."""
    return float(Cavity.of(faces)(jnp.asarray(nodes)))
