"""The zero of a sensor: averaged at rest, followed slowly, frozen otherwise. Pa stands for the unit of the
reading.

    reading = zero + p + white noise,   p = 0 at rest.

That of a pressure holds the part's offset (2.5 % of full scale), the weather (absolute parts) and the
temperature of the gas that is sealed in: 101 kPa / 295 K = 343 Pa per kelvin. It is a filter of one state:
each reading at rest enters with the weight K = max(P/(P + r²), 1 - exp(-dt/T)), where P is the variance of
the zero and r the noise. The first term averages the first readings equally and trusts new ones after a long
touch, the second never falls asleep; P follows as P <- (1 - K)² P + K² r², exact for any K. The unknown rate
d of the drift adds (d t)², t the time since the zero was last seen: a drift keeps its direction, it is no
random walk.

A reading far from the zero is no zero: something touches unseen. Only when that lasts is the zero learnt
anew.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from softfuse.io.quantity import PositiveNumber, PositiveTime
from softfuse.io.settings import Settings


class TareTimes(Settings):
    """How zeros are taken at rest: within settle, and followed with the time constant follow, in s.

    gate_sigma: what is further from the zero, in standard deviations, is none; after relearn, in s, of it at
    rest the zero is learnt anew.
    """

    settle: PositiveTime = 1.0
    follow: PositiveTime = 5.0
    gate_sigma: PositiveNumber = 5.0
    relearn: PositiveTime = 5.0


class Tare(eqx.Module):
    """How zeros are taken, see `TareTimes`: standard deviations of the zero before any reading [Pa], and of
    the rate at which it drifts [Pa/s], one value for all channels or one for each. All fields are leaves.
    """

    offset_sigma_Pa: Float[Array, "..."]
    drift_Pa_s: Float[Array, "..."]
    settle_s: Float[Array, ""]
    follow_s: Float[Array, ""]
    gate_sigma: Float[Array, ""]
    relearn_s: Float[Array, ""]


class TareState(eqx.Module):
    """Zero of each channel and what is known of it."""

    zero_Pa: Float[Array, " k"]
    """(k,) reading at rest [Pa]."""
    variance_Pa2: Float[Array, " k"]
    """(k,) its variance when it was last seen [Pa^2]."""
    unseen_s: Float[Array, " k"]
    """(k,) time since then [s]."""
    averaged_s: Float[Array, " k"]
    """(k,) time at rest since the learning began [s]."""
    rejected_s: Float[Array, " k"]
    """(k,) time at rest outside the gate [s]."""


def tare_init(tare: Tare, nominal_Pa: Float[Array, " k"]) -> TareState:
    """State before any reading: nominal_Pa (k,) reading of a perfect part at rest [Pa]."""
    nominal = jnp.asarray(nominal_Pa, float)
    nothing = jnp.zeros_like(nominal)
    return TareState(
        zero_Pa=nominal,
        variance_Pa2=nothing + tare.offset_sigma_Pa**2,
        unseen_s=nothing,
        averaged_s=nothing,
        rejected_s=nothing,
    )


def tare_variance(tare: Tare, state: TareState) -> Float[Array, " k"]:
    """Variance of the zero now, with the drift since it was last seen: (k,) [Pa^2]."""
    return state.variance_Pa2 + (tare.drift_Pa_s * state.unseen_s) ** 2


def tare_known(tare: Tare, state: TareState) -> Bool[Array, " k"]:
    """Channels whose zero has been averaged for long enough: (k,)."""
    return state.averaged_s >= tare.settle_s


def tare_update(
    tare: Tare,
    state: TareState,
    dt_s: Float[Array, ""],
    pressure_Pa: Float[Array, " k"],
    noise_Pa: Float[Array, " k"],
    at_rest: Bool[Array, " k"],
) -> TareState:
    """One frame.

    Args: dt_s time since the last frame [s]; pressure_Pa (k,) readings [Pa], finite; noise_Pa (k,) standard
    deviation of one [Pa]; at_rest (k,): the reading can be used and the robot is at rest.
    """
    state = eqx.tree_at(lambda s: s.unseen_s, state, state.unseen_s + dt_s)
    variance = tare_variance(tare, state)
    innovation = pressure_Pa - state.zero_Pa
    near = innovation**2 < tare.gate_sigma**2 * (variance + noise_Pa**2)
    use = at_rest & (near | ~tare_known(tare, state))
    rejected = jnp.where(use, 0.0, state.rejected_s + jnp.where(at_rest, dt_s, 0.0))
    relearn = rejected > tare.relearn_s

    weight = jnp.maximum(variance / (variance + noise_Pa**2), 1.0 - jnp.exp(-dt_s / tare.follow_s))
    weight = jnp.where(use, weight, 0.0)
    averaged = (1.0 - weight) ** 2 * variance + weight**2 * noise_Pa**2
    return TareState(
        zero_Pa=state.zero_Pa + weight * innovation,
        variance_Pa2=jnp.where(
            relearn, tare.offset_sigma_Pa**2, jnp.where(use, averaged, state.variance_Pa2)
        ),
        unseen_s=jnp.where(use | relearn, 0.0, state.unseen_s),
        averaged_s=jnp.where(relearn, 0.0, state.averaged_s + jnp.where(use, dt_s, 0.0)),
        rejected_s=jnp.where(relearn, 0.0, rejected),
    )
