"""min ½ xᵀQx − bᵀx subject to lower ≤ x ≤ upper, for a few unknowns (Navarro et al. 2020, eqs. 9 and 10).

jaxopt's BoxOSQP finds the active bounds on the problem with unit diagonal; a direct solve on the free
unknowns then polishes the solution to machine precision and is what gets differentiated. The KKT residual
says how far the result is from optimal: the largest violation of x = clip(x − (Qx − b)/diag Q, lower, upper),
in units of x. This is the only file that knows jaxopt.
"""

import warnings

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

with warnings.catch_warnings():
    # It says on import that it is no longer developed: known, and the reason why it lives here only.
    warnings.simplefilter("ignore", DeprecationWarning)
    from jaxopt import BoxOSQP

_SOLVER = BoxOSQP(tol=1e-8, maxiter=4000, check_primal_dual_infeasability=False, jit=True)


def kkt_residual(
    x: Float[Array, " n"],
    q: Float[Array, "n n"],
    b: Float[Array, " n"],
    lower: Float[Array, " n"],
    upper: Float[Array, " n"],
) -> Float[Array, ""]:
    """Largest distance of x (n,) from its projected Jacobi step, in units of x; 0 exactly at the solution."""
    return jnp.max(jnp.abs(x - jnp.clip(x - (q @ x - b) / jnp.diag(q), lower, upper)))


def solve_bounded_qp(
    q: Float[Array, "n n"], b: Float[Array, " n"], lower: Float[Array, " n"], upper: Float[Array, " n"]
) -> tuple[Float[Array, " n"], Float[Array, ""]]:
    """Solution (n,) and KKT residual for a positive definite q (n, n), b (n,) and bounds lower ≤ upper (n,).

    Differentiable in all arguments where no bound is about to become active or inactive.
    """
    scale = 1 / jnp.sqrt(jnp.diag(q))
    problem = (q * scale[:, None] * scale, -b * scale, lower / scale, upper / scale)
    scaled_q, scaled_c, low, high = jax.lax.stop_gradient(problem)
    size = jnp.eye(len(b))
    found = _SOLVER.run(
        params_obj=(scaled_q, scaled_c), params_eq=size, params_ineq=(low, high)
    ).params.primal[0]
    # A bound is active where the solution sits on it and the gradient pushes against it.
    slope = scaled_q @ found + scaled_c
    at_lower = found - slope <= low
    at_upper = (found - slope >= high) & ~at_lower
    free = ~(at_lower | at_upper)
    held = jnp.where(at_lower, lower, jnp.where(at_upper, upper, 0.0))
    matrix = jnp.where(free[:, None] & free, q, 0.0) + jnp.diag(jnp.where(free, 0.0, 1.0))
    x = jnp.where(free, jnp.linalg.solve(matrix, jnp.where(free, b - q @ held, 0.0)), held)
    x = jnp.clip(x, lower, upper)
    return x, kkt_residual(x, q, b, lower, upper)
