"""Compressible Ogden solid: W = Σᵢ μᵢ/αᵢ (λ₁^αᵢ + λ₂^αᵢ + λ₃^αᵢ − 3 − αᵢ ln J) + λ/2 (ln J)².

λ₁, λ₂, λ₃ are the principal stretches. −αᵢ ln J removes the stress at rest; small strains have
μ = ½ Σ μᵢ αᵢ and Lamé's λ.

The stretches are never computed, because their derivatives are singular where two of them meet. Of a matrix
of determinant one the traces x = tr X − 3 and y = tr X⁻¹ − 3 say everything a trace can depend on, and from
those of C̄ = C / J^(2/3) follow
1. those of X = C̄^(1/2ᵏ), by k square roots (square_root.py);
2. those of X^γ, γ = α/2, from ((1 + w)/(1 − w))^γ = Σ cₙ wⁿ with (n + 1) cₙ₊₁ = 2γ cₙ + (n − 1) cₙ₋₁, for w
   the small eigenvalues of (X − I)(X + I)⁻¹, whose power sums obey Newton's identities;
3. those of C̄^(α/2), by k squarings: x → 6x + x² − 2y, y → 6y + y² − 2x.
Every step is smooth, is counted from rest so that small strains keep their digits, and differentiates to
any order, in α too.
Sources: Ogden, Proc. R. Soc. A 328 (1972) 567; inverse scaling and squaring: Higham, Functions of Matrices,
ch. 10 and 11.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from softfuse.errors import ConfigError
from softfuse.material.base import constant
from softfuse.material.isotropic import AbstractIsotropic, Invariants
from softfuse.material.square_root import second_of_root, trace_of_root

HALVINGS = 5  # |w| < 0.07 for stretches in [0.2, 5]; rounding errors grow as 2ᵏ, so no more than needed
SERIES_TERMS = 20  # |α w|ⁿ/n! is then below rounding up to |α| = 20


class Ogden(AbstractIsotropic):
    """Ogden law of n terms: moduli `mu` (n,) [Pa], exponents `alpha` (n,) [-], Lamé's λ `lame` [Pa].

    No exponent may be zero. Sums of powers are good to 1e-11 (relative) for |α| ≤ 20 while the principal
    stretches differ by less than a factor of 25; at a factor of 400, for |α| ≤ 8.
    Raises ConfigError when `mu` and `alpha` are not equally long lists.
    """

    mu: Float[Array, " n"] = eqx.field(converter=constant)
    alpha: Float[Array, " n"] = eqx.field(converter=constant)
    lame: Float[Array, ""] = eqx.field(converter=constant)

    def __check_init__(self) -> None:
        if self.mu.ndim != 1 or self.mu.shape != self.alpha.shape:
            raise ConfigError(
                f"Ogden law: mu has shape {self.mu.shape} and alpha {self.alpha.shape}; "
                "give one list of moduli and one of exponents, equally long"
            )

    def times(self, factor):
        """The same law with all moduli times the factor; exponents stay."""
        return Ogden(factor * self.mu, self.alpha, factor * self.lame)

    def distortion_of(self, at: Invariants) -> Float[Array, "..."]:
        """Σ μᵢ/αᵢ (λ₁^αᵢ + λ₂^αᵢ + λ₃^αᵢ − 3 − αᵢ ln J) (...) [J/m³]."""
        log_volume = self.dilatation_of(at)

        def term(mu: Float[Array, ""], alpha: Float[Array, ""]) -> Float[Array, "..."]:
            growth = alpha * log_volume / 3.0
            x, _ = _isochoric_powers(at, log_volume, alpha)
            return mu / alpha * (3.0 * (jnp.expm1(growth) - growth) + jnp.exp(growth) * x)

        return jnp.sum(jax.vmap(term)(self.mu, self.alpha), axis=0)

    def dilatation_of(self, at: Invariants) -> Float[Array, "..."]:
        """ln J (...) [-]."""
        return jnp.log(at.volume)

    def shear_modulus(self) -> Float[Array, ""]:
        """½ Σ μᵢ αᵢ [Pa]."""
        return 0.5 * jnp.sum(self.mu * self.alpha)


def _isochoric_powers(
    at: Invariants, log_volume: Float[Array, "..."], alpha: Float[Array, ""]
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """tr C̄^(α/2) − 3 and tr C̄^(−α/2) − 3 (...) [-]."""
    x = at.first * jnp.exp(-2.0 / 3.0 * log_volume) - 3.0
    y = at.second * jnp.exp(-4.0 / 3.0 * log_volume) - 3.0
    for _ in range(HALVINGS):
        tau = trace_of_root(x, y, jnp.zeros_like(x))
        x, y = tau, second_of_root(tau, x)
    x, y = _small_powers(x, y, 0.5 * alpha)
    for _ in range(HALVINGS):
        x, y = 6.0 * x + x**2 - 2.0 * y, 6.0 * y + y**2 - 2.0 * x
    return x, y


def _small_powers(
    x: Float[Array, "..."], y: Float[Array, "..."], gamma: Float[Array, ""]
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """tr X^γ − 3 and tr X^(−γ) − 3 (...) [-] of X ≈ I, det X = 1, from x = tr X − 3 and y = tr X⁻¹ − 3."""
    scale = 8.0 + x + y
    e1, e2 = (y - x) / scale, -(x + y) / scale
    e3 = -e1

    def add_term(state: tuple[Array, ...], term: tuple[Array, Array]) -> tuple[tuple[Array, ...], None]:
        before, power, after, previous, coefficient, sums, inverse_sums = state
        order, sign = term
        next_power = e1 * after - e2 * power + e3 * before
        following = (2.0 * gamma * coefficient + (order - 1.0) * previous) / (order + 1.0)
        addend = coefficient * power
        totals = sums + addend, inverse_sums + sign * addend
        return (power, after, next_power, coefficient, following, *totals), None

    zero = jnp.zeros_like(x * gamma)
    start = (jnp.full_like(x, 3.0), e1, e1**2 - 2.0 * e2, jnp.ones_like(gamma), 2.0 * gamma, zero, zero)
    order = jnp.arange(1.0, SERIES_TERMS + 1.0)
    (*_, sums, inverse_sums), _ = jax.lax.scan(add_term, start, (order, (-1.0) ** order))
    return sums, inverse_sums
