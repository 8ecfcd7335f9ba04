"""Invariants of S = √C from those of C (3, 3): one scalar root, no eigenvectors, smooth at equal eigenvalues.

The trace t of S is the largest root of ((t² − I_C)/2)² − 2 t J − II_C = 0 and II_S = (t² − I_C)/2, where
J = det S. Every root of this quartic is real and the slope at the largest is 2 (s₁ + s₂)(s₂ + s₃)(s₃ + s₁),
which is never small for J > 0. All quantities are counted from rest (t = 3 + τ and so on), so that small
strains keep their digits:

    16 τ + 3 τ² + σ² = 3 x + y + 6 δ + 2 δ τ,   σ = 3 τ + (τ² − x)/2,
    x = I_C − 3,   y = II_C − 3,   δ = J − 1,   τ = I_S − 3,   σ = II_S − 3.

Laguerre's method finds the root: from an upper bound it converges monotonically on a polynomial whose roots
are real. Derivatives of any order follow from the implicit function theorem. For J < 0 the root is that of
the S that makes F S⁻¹ the nearest rotation (one eigenvalue of S is negative); it has a kink where the two
smallest singular values of F are equal.
Sources: Franca, Comput. Math. Appl. 18 (1989) 459; Hoger and Carlson, Q. Appl. Math. 42 (1984) 113;
Laguerre's method: Ralston and Rabinowitz, A First Course in Numerical Analysis, 2nd ed., sec. 8.9.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

_STEPS, _STEPS_INVERTED = 3, 6
"""Laguerre steps: for δ > −1 two reach rounding; inverted elements need about eight, because their root
can be nearly double.
"""


@jax.custom_jvp
def trace_of_root(
    x: Float[Array, "..."], y: Float[Array, "..."], delta: Float[Array, "..."]
) -> Float[Array, "..."]:
    """τ = tr √C − 3 [-] from x = I_C − 3, y = II_C − 3 and δ = √det C − 1 [-]."""
    bound = jnp.sqrt(3.0 * (3.0 + x))
    second_bound = jnp.sqrt(3.0 + y + 2.0 * jnp.maximum(1.0 + delta, 0.0) * bound)
    tau = jnp.sqrt(3.0 + x + 2.0 * second_bound) - 3.0

    def improved(tau: Float[Array, "..."]) -> Float[Array, "..."]:
        sigma = second_of_root(tau, x)
        value = 16.0 * tau + 3.0 * tau**2 + sigma**2 - 3.0 * x - y - 6.0 * delta - 2.0 * delta * tau
        slope = _slope(tau, sigma, delta)
        curvature = 6.0 + 2.0 * sigma + 2.0 * (3.0 + tau) ** 2
        discriminant = 9.0 * slope**2 - 12.0 * value * curvature
        return tau - 4.0 * value / (slope + jnp.sqrt(jnp.maximum(discriminant, 0.0)))

    for _ in range(_STEPS):
        tau = improved(tau)

    def further(tau: Float[Array, "..."]) -> Float[Array, "..."]:
        return jax.lax.fori_loop(0, _STEPS_INVERTED, lambda _, at: improved(at), tau)

    return jax.lax.cond(jnp.any(delta <= -1.0), further, lambda at: at, tau)


def second_of_root(tau: Float[Array, "..."], x: Float[Array, "..."]) -> Float[Array, "..."]:
    """σ = II_S − 3 [-] of S = √C from τ = tr S − 3 and x = I_C − 3 [-]."""
    return 3.0 * tau + 0.5 * (tau**2 - x)


def _slope(
    tau: Float[Array, "..."], sigma: Float[Array, "..."], delta: Float[Array, "..."]
) -> Float[Array, "..."]:
    """Derivative of the quartic at τ: 2 (I_S II_S − III_S) = 2 (s₁ + s₂)(s₂ + s₃)(s₃ + s₁) at its root."""
    return 16.0 + 6.0 * tau + 2.0 * sigma * (3.0 + tau) - 2.0 * delta


@trace_of_root.defjvp
def _trace_of_root_jvp(
    primals: tuple[Array, Array, Array], tangents: tuple[Array, Array, Array]
) -> tuple[Array, Array]:
    """dτ = (II_S dx + dy + 2 I_S dδ) / slope, in terms of the root itself: it can be differentiated again."""
    x, y, delta = primals
    dx, dy, ddelta = tangents
    tau = trace_of_root(x, y, delta)
    sigma = second_of_root(tau, x)
    return tau, ((3.0 + sigma) * dx + dy + 2.0 * (3.0 + tau) * ddelta) / _slope(tau, sigma, delta)
