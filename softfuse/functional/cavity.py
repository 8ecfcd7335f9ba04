"""Enclosed volume Φ of a closed surface: Φ = 1/3 ∮ x · n dA, exact for the curved faces of quadratic
elements.

x · (∂x/∂ξ × ∂x/∂η) is a polynomial of degree 4 (quadratic faces) or 1 (linear ones) in ξ, η, and the
quadrature is exact for it. The conjugate force of Φ is the gauge pressure inside [Pa]. Source: the divergence
theorem; Navarro et al. 2020, eq. 8.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.body.quadrature import TRIANGLE_6
from softfuse.body.shape import linear, linear_slopes, quadratic, quadratic_slopes
from softfuse.functional.base import Functional


def cone_volume(x: Float[Array, "s 3"]) -> Float[Array, ""]:
    """Signed volume [m³] between the origin and one face of nodes x (s, 3) m."""
    points, weights = TRIANGLE_6
    is_linear = x.shape[0] == 3
    values = linear(points) if is_linear else quadratic(points)
    slopes = linear_slopes(points) if is_linear else quadratic_slopes(points)
    along = jnp.einsum("si,qsd->dqi", x, slopes[:, :, 1:] - slopes[:, :, :1])
    outwards = jnp.cross(along[0], along[1])
    return jnp.einsum("qi,qi,q->", jnp.asarray(values) @ x, outwards, jnp.asarray(weights)) / 6.0


class Cavity(Functional):
    """A closed surface of faces (f, 3) or (f, 6) whose normals point out of the enclosed space."""

    faces: Int[Array, "f s"]

    def __call__(self, positions: Float[Array, "k 3"]) -> Float[Array, ""]:
        """Enclosed volume [m³] at node positions (k, 3) m."""
        return jnp.sum(jax.vmap(cone_volume)(positions[self.faces]))


def enclosed_volume(faces: Int[np.ndarray, "f s"], nodes: Float[np.ndarray, "k 3"]) -> float:
    """The volume [m³] that faces (f, 3) or (f, 6) of nodes (k, 3) m enclose, their edges as curved as they
    are.
    """
    return float(Cavity(jnp.asarray(faces))(jnp.asarray(nodes)))
