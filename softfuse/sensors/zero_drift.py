"""Kalman filter for the zero of an integrated sensor: a constant bias plus a Gauss-Markov wander.

    z = b + w,   db = sqrt(q_b) dW,   dw = -w/tau dt + sigma_w sqrt(2/tau) dW',
    reading = z + signal + white noise.

While the signal is known to be zero, the reading observes z. While it is not, the reading minus the predicted
z is integrated, and the error e of that integral obeys de = (z - z_predicted) dt + white noise dt, so that
(b, w, e) is one linear system and its covariance P is exact: it holds the noise, the error of the zero at the
start and the wander since. The wander's mean decays to zero with tau, that is the prediction returns to the
long-run bias: averaging longer than tau for the present value would be wrong, averaging shorter for the bias
as well. The model is the usual one for an inertial sensor's bias (Gelb, Applied Optimal Estimation, 1974,
Secs. 3.6, 4.2). Everything is per channel; units are those of the reading (V) and V s.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Num


class ZeroDrift(eqx.Module):
    """Noise model of a reading's zero; all fields are leaves, one value for all channels."""

    noise_V: Float[Array, ""]
    """Standard deviation of one reading's white noise [V]."""
    bias_sigma_V: Float[Array, ""]
    """Standard deviation of the bias before any reading [V]."""
    bias_walk_V: Float[Array, ""]
    """Random walk of the bias in one second [V/sqrt(s)]."""
    wander_sigma_V: Float[Array, ""]
    """Stationary standard deviation of the wander [V]."""
    wander_time_s: Float[Array, ""]
    """Correlation time of the wander [s]."""


class ZeroEstimate(eqx.Module):
    """Mean of bias and wander and covariance of (bias, wander, integral's error), per channel."""

    bias_V: Float[Array, " k"]
    """(k,) [V]."""
    wander_V: Float[Array, " k"]
    """(k,) [V]."""
    covariance: Float[Array, "k 3 3"]
    """(k, 3, 3) of (bias [V], wander [V], integral's error [V s])."""


def zero_prior(model: ZeroDrift, nominal_V: Float[Array, " k"]) -> ZeroEstimate:
    """Estimate before any reading.

    Args: nominal_V (k,) zero from the data sheet [V].
    Returns: ZeroEstimate with the model's prior covariance and no integral.
    """
    variance = jnp.diag(jnp.stack([model.bias_sigma_V**2, model.wander_sigma_V**2, jnp.zeros(())]))
    return ZeroEstimate(
        bias_V=nominal_V,
        wander_V=jnp.zeros_like(nominal_V),
        covariance=jnp.broadcast_to(variance, (nominal_V.shape[0], 3, 3)),
    )


def zero_transition(
    model: ZeroDrift, dt_s: Float[Array, ""], samples: Num[Array, ""]
) -> tuple[Float[Array, "3 3"], Float[Array, "3 3"]]:
    """How (bias [V], wander [V], integral's error [V s]) go on over dt_s.

    Args: dt_s [s], >= 0; samples: number of readings in that time, whose white noise the integral takes up.
    Returns: the transition (3, 3), and the covariance (3, 3) of what comes to them by chance.
    """
    decay = jnp.exp(-dt_s / model.wander_time_s)
    reach = model.wander_time_s * (1.0 - decay)
    one, zero = jnp.ones_like(decay), jnp.zeros_like(decay)
    transition = jnp.stack(
        [
            jnp.stack([one, zero, zero]),
            jnp.stack([zero, decay, zero]),
            jnp.stack([dt_s, reach, one]),
        ]
    )
    # Exact process noise of an Ornstein-Uhlenbeck process and its integral (Gillespie, Phys. Rev. E 54, 2084,
    # 1996).
    variance = model.wander_sigma_V**2
    tau = model.wander_time_s
    ww = variance * (1.0 - decay**2)
    we = variance * tau * (1.0 - decay) ** 2
    # tau^2 (2 r - 3 + 4 e^-r - e^-2r), r = dt/tau: the series where cancellation would leave only rounding.
    r = dt_s / tau
    series = r**3 * (2.0 / 3.0 - r / 2.0 + 7.0 * r**2 / 30.0)
    exact = 2.0 * r - 3.0 + 4.0 * decay - decay**2
    ee = variance * tau**2 * jnp.where(r < 1e-2, series, exact)
    ee = ee + model.bias_walk_V**2 * dt_s**3 / 3.0 + model.noise_V**2 * dt_s**2 / jnp.maximum(samples, 1.0)
    bb = model.bias_walk_V**2 * dt_s
    be = 0.5 * model.bias_walk_V**2 * dt_s**2
    noise = jnp.stack(
        [jnp.stack([bb, zero, be]), jnp.stack([zero, ww, we]), jnp.stack([be, we, ee])],
    )
    return transition, noise


def predict_zero(
    model: ZeroDrift, estimate: ZeroEstimate, dt_s: Float[Array, ""], samples: Num[Array, ""]
) -> tuple[ZeroEstimate, Float[Array, " k"]]:
    """Advance by dt_s and integrate the predicted zero; arguments as those of `zero_transition`.

    Returns: the estimate dt_s later and the integral (k,) of the predicted zero over dt_s [V s].
    """
    transition, noise = zero_transition(model, dt_s, samples)
    later = ZeroEstimate(
        bias_V=estimate.bias_V,
        wander_V=transition[1, 1] * estimate.wander_V,
        covariance=transition @ estimate.covariance @ transition.T + noise,
    )
    return later, transition[2, 0] * estimate.bias_V + transition[2, 1] * estimate.wander_V


def observe_zero(
    model: ZeroDrift, estimate: ZeroEstimate, reading_V: Float[Array, " k"], use: Bool[Array, " k"]
) -> ZeroEstimate:
    """Kalman update with readings whose signal is zero.

    Args: reading_V (k,) [V]; use (k,) which channels take part.
    Returns: the updated estimate; channels left out are unchanged.
    """
    covariance = estimate.covariance
    column = covariance[:, :, 0] + covariance[:, :, 1]
    innovation_variance = column[:, 0] + column[:, 1] + model.noise_V**2
    gain = jnp.where(use[:, None], column / innovation_variance[:, None], 0.0)
    innovation = jnp.where(use, reading_V - estimate.bias_V - estimate.wander_V, 0.0)
    return ZeroEstimate(
        bias_V=estimate.bias_V + gain[:, 0] * innovation,
        wander_V=estimate.wander_V + gain[:, 1] * innovation,
        covariance=covariance - gain[:, :, None] * column[:, None, :],
    )


def restart_integral(estimate: ZeroEstimate, restart: Bool[Array, " k"]) -> ZeroEstimate:
    """Forget the integral's error where the integral starts anew: restart (k,)."""
    keep = jnp.where(restart[:, None], jnp.asarray([1.0, 1.0, 0.0]), 1.0)
    return eqx.tree_at(
        lambda e: e.covariance, estimate, estimate.covariance * keep[:, :, None] * keep[:, None, :]
    )


def zero_variance(estimate: ZeroEstimate) -> Float[Array, " k"]:
    """Variance of the zero, bias plus wander: (k,) [V^2]."""
    return jnp.sum(estimate.covariance[:, :2, :2], axis=(1, 2))


class ReadingDrift(NamedTuple):
    """What the zeros of k readings do to them in one frame, for those who go on with them: the error ρ · δ.

    δ = (bias, wander, integral's error) of each channel minus what is predicted of them: a linear process
    that starts with the covariance of the prediction and goes on as `zero_transition` says. `covariance`
    (k, 3, 3): of δ, [V], [V], [V s]; `calm` (k,): nothing touches and nothing flows, so that the reading of a
    body that came back to rest is its own error; `period_s`: since the sensors' last reading [s].
    """

    covariance: Float[Array, "k 3 3"]
    calm: Bool[Array, " k"]
    period_s: Float[Array, ""]


class DriftModel(eqx.Module):
    """How δ of k readings goes on, `zero`, each value of it (k,), and what it does to each: `effect` (k,),
    readings [SI] per volt second of the integral's error, 0 of a reading that does not drift.
    """

    zero: ZeroDrift
    effect: Float[Array, " k"]

    @classmethod
    def joined(cls, models: Sequence["DriftModel | None"], counts: Sequence[int]) -> "DriftModel":
        """That of the readings of several sensors, so many each; None: they do not drift."""
        some = next(model for model in models if model is not None)

        def still(count: int) -> "DriftModel":
            one = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf[:1], (count,)), some)
            return replace(one, effect=jnp.zeros(count))

        every = [still(n) if model is None else model for model, n in zip(models, counts, strict=True)]
        return jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *every)

    def step(
        self, dt_s: float, period_s: float
    ) -> tuple[Float[np.ndarray, "k 3 3"], Float[np.ndarray, "k 3 3"]]:
        """The transition (k, 3, 3) over dt_s [s] in each reading, and what comes by chance (k, 3, 3), of
        sensors that are read every period_s [s].
        """
        # Numbers of one type, whatever they came as: of another this would be compiled once more.
        samples = np.float64(max(dt_s / period_s, 1.0))
        transition, noise = _transition(self.zero, np.float64(dt_s), samples)
        return np.asarray(transition), np.asarray(noise)

    def white(self, period_s: float) -> Float[np.ndarray, " k"]:
        """Standard deviations (k,) of what is only in the newest reading: half a step of the trapezoidal rule
        over a period [s].
        """
        return 0.5 * period_s * np.asarray(self.zero.noise_V) * np.abs(np.asarray(self.effect))


@jax.jit
def _transition(zero: ZeroDrift, dt_s: Float[Array, ""], samples: Num[Array, ""]) -> tuple[Array, Array]:
    return jax.vmap(zero_transition, (0, None, None))(zero, dt_s, samples)
