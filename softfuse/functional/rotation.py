"""The rotation in a deformation gradient, and rotations as vectors and quaternions.

F = R U with U = Uᵀ > 0. Newton's iteration R ← (γ R + (γ R)⁻ᵀ)/2 finds R from F without singular values,
whose derivatives would not exist where two of them are equal, as they are at rest. From F = R U follows
dR = R [w]× with (tr U · I − U) w = axial(Rᵀ dF − dFᵀ R), which is regular for det F > 0. Source: Higham,
SIAM J. Sci. Stat. Comput. 7(4), 1986, for the iteration with its factors γ.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

_STEPS = 8
"""Of Newton's iteration; for principal stretches from 0.1 to 10, six reach rounding."""


@jax.custom_jvp
def polar_rotation(f: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    """R (3, 3) of a deformation gradient (3, 3) with det F > 0."""

    def improved(_, r: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
        turned = jnp.stack([jnp.cross(r[1], r[2]), jnp.cross(r[2], r[0]), jnp.cross(r[0], r[1])])
        inverse = turned / jnp.dot(r[0], turned[0])  # R⁻ᵀ
        factor = jnp.sqrt(jnp.linalg.norm(inverse) / jnp.linalg.norm(r))
        return 0.5 * (factor * r + inverse / factor)

    return jax.lax.fori_loop(0, _STEPS, improved, f)


@polar_rotation.defjvp
def _polar_rotation_jvp(primals, tangents):
    (f,), (df,) = primals, tangents
    r = polar_rotation(f)
    stretch = 0.5 * (r.T @ f + f.T @ r)
    half = r.T @ df
    w = jnp.linalg.solve(jnp.trace(stretch) * jnp.eye(3) - stretch, _axial(half - half.T))
    return r, r @ cross_matrix(w)


def cross_matrix(w: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """[w]×, whose product with a vector v is w × v."""
    return jnp.cross(w, jnp.eye(3)).T


def _axial(a: Float[Array, "3 3"]) -> Float[Array, "3"]:
    """w (3,) of an antisymmetric [w]×."""
    return jnp.stack([a[2, 1], a[0, 2], a[1, 0]])


def quaternion(r: Float[Array, "3 3"]) -> Float[Array, "4"]:
    """(w, x, y, z) with w ≥ 0 of a rotation (3, 3); differentiable up to half a turn.

    The largest of the four is found from the diagonal, so that none is divided by little. Source:
    Shepperd, J. Guidance and Control 1(3), 1978.
    """
    # q qᵀ times four.
    trace = jnp.trace(r)
    across = _axial(r - r.T)
    lower = r + r.T + (1 - trace) * jnp.eye(3)
    square = jnp.block([[(1 + trace)[None, None], across[None]], [across[:, None], lower]])
    row = square[jnp.argmax(jnp.diagonal(square))]
    q = row / jnp.linalg.norm(row)
    return jnp.where(q[0] < 0, -q, q)


def rotation_vector(r: Float[Array, "3 3"]) -> Float[Array, "3"]:
    """Axis times angle [rad], below π, of a rotation (3, 3)."""
    q = quaternion(r)
    squared = jnp.sum(q[1:] ** 2)
    small = squared < 1e-16
    sine = jnp.sqrt(jnp.where(small, 1.0, squared))
    return q[1:] * jnp.where(small, 2.0, 2 * jnp.arctan2(sine, q[0]) / sine)
