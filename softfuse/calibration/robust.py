"""The parameters that explain whitened misfits best, where a few presses may be wrong altogether.

The readings of one cavity in one press are a group g of n_g numbers with squared length d_g². They are taken
to follow Student's t with ν degrees of freedom, whose tails let go of a group that nothing explains:

    z* = argmin ½ |z|² + Σ_g (ν + n_g)/2 ln(1 + d_g²(z)/ν),

a normal prior of z, in prior standard deviations, included. Its curvature with the weights w_g = (ν + n_g) /
(ν + d_g²) is the inverse of z's covariance and gives the evidence (Laplace). Sources: Lange, Little and
Taylor, J. Am. Stat. Assoc. 84 (1989) 881; MacKay, Neural Comput. 4 (1992) 415.
"""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int

from softfuse.calibration.presses import Presses
from softfuse.errors import SoftfuseError
from softfuse.estimation.model_error import missed, whitening

FREEDOM = 15.0
"""ν: three readings of a press that miss by ten standard deviations in all count a seventh. Fewer degrees of
freedom make the recordings of the reference block less likely, as they give up presses that tell most.
"""


class Linear(NamedTuple):
    """Whitened misfits left − slope z of m numbers: left (m,), slope (m, p) per prior standard deviation,
    their group (m,), and which say something (m,).
    """

    left: Float[Array | np.ndarray, " m"]
    slope: Float[Array | np.ndarray, "m p"]
    group: Int[Array | np.ndarray, " m"]
    told: Bool[Array | np.ndarray, " m"]


class Explained(NamedTuple):
    """z* (p,), its information (p, p) = covariance⁻¹, weights w (g,) of the groups, and the minimum."""

    z: Float[np.ndarray, " p"]
    information: Float[np.ndarray, "p p"]
    weight: Float[np.ndarray, " g"]
    cost: float

    @property
    def ln_evidence(self) -> float:
        """Logarithm of how likely the misfits are, but for ln det of their covariance and constants."""
        return -self.cost - 0.5 * float(np.linalg.slogdet(self.information)[1])


def explained(linear: Linear, groups: int) -> Explained:
    """The z (p,) that explains the misfits best; raises SoftfuseError where the search does not end."""
    found = _explain(linear, groups)
    if not bool(found.pop("converged")):
        raise SoftfuseError("the fit's inner problem did not converge: look for readings that are far off")
    z, information, weight = (np.asarray(found[name]) for name in ("z", "information", "weight"))
    return Explained(z, information, weight, float(found["cost"]))


def cost(
    left: Float[Array | np.ndarray, " m"],
    linear: Linear,
    z: Float[Array | np.ndarray, " p"],
    groups: int,
) -> Float[Array, ""]:
    """What `explained` minimises, for misfits (m,) that were computed otherwise than linearly."""
    return 0.5 * (jnp.sum(_terms(jnp.asarray(left), linear, groups)) + jnp.sum(jnp.asarray(z) ** 2))


def _lengths(left: Array, linear: Linear, groups: int) -> tuple[Array, Array]:
    """Squared lengths d² (g,) and counts n (g,)."""
    total = partial(jax.ops.segment_sum, segment_ids=jnp.asarray(linear.group), num_segments=groups)
    return total(left**2), total(jnp.asarray(linear.told, float))


def _terms(left: Array, linear: Linear, groups: int) -> Array:
    square, count = _lengths(left, linear, groups)
    return (FREEDOM + count) * jnp.log1p(square / FREEDOM)


@eqx.filter_jit
def _explain(linear: Linear, groups: int) -> dict[str, Array]:
    def residual(z: Array, _: None) -> Array:
        left = jnp.asarray(linear.left - linear.slope @ z)
        square, count = _lengths(left, linear, groups)
        some = jnp.where(square > 0, square, 1.0)
        each = jnp.where(square > 0, _terms(left, linear, groups) / some, 1 + count / FREEDOM)
        return jnp.concatenate([left * jnp.sqrt(each)[linear.group], z])

    solver = optx.LevenbergMarquardt(rtol=1e-9, atol=1e-9)
    start = jnp.zeros(linear.slope.shape[1])
    solution = optx.least_squares(residual, solver, start, max_steps=500, throw=False)
    left = jnp.asarray(linear.left - linear.slope @ solution.value)
    square, count = _lengths(left, linear, groups)
    weight = (FREEDOM + count) / (FREEDOM + square)
    information = jnp.eye(len(start)) + linear.slope.T @ (weight[linear.group][:, None] * linear.slope)
    return {
        "z": solution.value,
        "information": information,
        "weight": weight,
        "cost": cost(left, linear, solution.value, groups),
        "converged": solution.result == optx.RESULTS.successful,
    }


def alike_in_press(press: Int[np.ndarray, " s"], correlation: float) -> Float[np.ndarray, "s s"]:
    """Correlation matrix C (s, s) of samples that belong to presses (s,)."""
    same = press[:, None] == press
    return correlation * same + (1 - correlation) * np.eye(len(same))


@dataclass(frozen=True)
class Discrepancy:
    """How far a model that is fitted as well as it can be misses what the sensors say.

    A reading misses by its noise σ and by what the model does not know, a part δ of its size m
    (`estimation.model_error`), alike in the samples of one press. The covariance of a reading's s samples is

        S = diag(σ²) + δ² diag(m) C diag(m),

    with C = 1 on the diagonal, ρ between samples of one press, 0 between presses. Source of the idea: Kennedy
    and O'Hagan, J. R. Stat. Soc. B 63 (2001) 425.

    `part` δ [-] of a reading, `floor` φ [-] of the largest, of each reading (k,), see `missed`; `alike` ρ [-]
    in a press: 0.9 to 0.95 make the nominal recording of the reference block likeliest.
    """

    part: Float[np.ndarray, " k"]
    floor: Float[np.ndarray, " k"]
    alike: float = 0.9

    def missed(
        self, reading: Float[np.ndarray, "s k"], kind: Int[np.ndarray, " k"]
    ) -> Float[np.ndarray, "s k"]:
        """Standard deviations m δ (s, k) of readings (s, k) of some kinds (k,), in their units."""
        return missed(reading, self.part, kind, self.floor)

    def whitening(self, presses: Presses) -> "Whitening":
        """What makes misfits of presses standard normal."""
        told, sizes = presses.told, self.missed(presses.reading, presses.kind)
        alike = alike_in_press(presses.applied.press, self.alike)
        inverse, ln_det = [], 0.0
        for k in range(told.shape[1]):
            on = told[:, k]
            missing = alike * np.outer(sizes[:, k], sizes[:, k])
            inverse.append(whitening(missing + np.diag(presses.sigma[:, k] ** 2), on))
            ln_det -= 2 * np.sum(np.log(np.diag(inverse[-1])[on]))
        return Whitening(np.array(inverse), float(ln_det))


@dataclass(frozen=True, eq=False)
class Whitening:
    """Inverse Cholesky factors (k, s, s) of readings' covariances, 0 for what says nothing; ln det of all."""

    inverse: Float[np.ndarray, "k s s"]
    ln_det: float

    def of(self, misfit: Float[np.ndarray, "s k ..."]) -> Float[np.ndarray, "s k ..."]:
        """Whitened misfits (s, k, ...) or slopes of them; what is not known takes no part."""
        return np.einsum("kst,tk...->sk...", self.inverse, np.nan_to_num(misfit))
