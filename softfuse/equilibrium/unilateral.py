"""Forces of the pressure cells under rigid discs: no tension, no penetration, prescribed totals.

With z = z₀ + Y a the displacements under the cells are g = g₀ + S a, S = Gᵀ K⁻¹ G the compliance. A disc at
depth d touches where g = d and lies above where g > d: 0 ≤ a ⊥ g − d ≥ 0, Σ a = F for each disc, which are
the optimality conditions of min ½ aᵀS a + g₀ᵀ a subject to a ≥ 0, Σ a = F. Solved by a primal-dual active set
method (Hintermüller, Ito and Kunisch, SIAM J. Optim. 13(3), 2002).
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

_SEED = 1e-9  # N: a disc without force keeps the cells that would touch first
_MAX_CHANGES = 60
_SOFTENING = 1e-9  # of the mean compliance: cells that a coarse mesh cannot tell apart share their force


def distribute_on(
    pressed: Bool[Array, "c m"],
    compliance: Float[Array, "c m c m"],
    offset: Float[Array, "c m"],
    total: Float[Array, " c"],
) -> tuple[Float[Array, "c m"], Float[Array, " c"]]:
    """Cell forces (c, m) [N] and depths (c,) [m] when exactly the `pressed` cells (c, m) carry force.

    `compliance` (c, m, c, m) [m/N]; `offset` (c, m) [m]: displacements without force; `total` (c,) [N].
    Linear in offset and total.
    """
    c, m = offset.shape
    k = c * m
    scale = jnp.trace(compliance.reshape(k, k)) / k
    on = pressed.ravel()
    belongs = jnp.repeat(jnp.eye(c), m, axis=0)
    stiff = jnp.where(on[:, None] & on[None, :], compliance.reshape(k, k) / scale, 0.0)
    matrix = jnp.block(
        [
            [stiff + jnp.diag(jnp.where(on, 0.0, 1.0)), -belongs * on[:, None]],
            [-belongs.T * on, jnp.zeros((c, c))],
        ]
    )
    rhs = jnp.concatenate([jnp.where(on, -offset.ravel() / scale, 0.0), -total])
    factor = jax.scipy.linalg.lu_factor(matrix + jnp.diag(_SOFTENING * (jnp.arange(k + c) < k)))
    solution = jax.scipy.linalg.lu_solve(factor, rhs)
    # The softening leaves the solution again where there is one without it.
    solution = solution + jax.scipy.linalg.lu_solve(factor, rhs - matrix @ solution)
    return solution[:k].reshape(c, m), scale * solution[k:]


def distribute(
    start: Bool[Array, "c m"],
    compliance: Float[Array, "c m c m"],
    offset: Float[Array, "c m"],
    total: Float[Array, " c"],
) -> tuple[Float[Array, "c m"], Float[Array, " c"], Bool[Array, "c m"]]:
    """Cell forces (c, m) [N], depths (c,) [m] and which cells touch (c, m), starting the search from the set
    `start`.

    Arguments as in `distribute_on`. Not differentiated: `distribute_on` the returned set is.
    """
    total_seen = jnp.maximum(total, _SEED)

    def update(carry):
        pressed, _, count = carry
        force, depth = distribute_on(pressed, compliance, offset, total_seen)
        gap = offset + jnp.einsum("cmdn,dn->cm", compliance, force) - depth[:, None]
        proposed = jnp.where(pressed, force > 0, gap < 0)
        keep_one = force >= jnp.max(force, axis=1, keepdims=True)
        proposed = jnp.where(jnp.any(proposed, axis=1, keepdims=True), proposed, keep_one)
        return proposed, jnp.any(proposed != pressed), count + 1

    start = jnp.where(jnp.any(start, axis=1, keepdims=True), start, True)
    compliance, offset, total_seen = jax.lax.stop_gradient((compliance, offset, total_seen))
    pressed, _, _ = jax.lax.while_loop(
        lambda carry: carry[1] & (carry[2] < _MAX_CHANGES), update, (start, jnp.array(True), 0)
    )
    return *distribute_on(pressed, compliance, offset, total), pressed
