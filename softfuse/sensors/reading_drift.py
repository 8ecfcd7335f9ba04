"""What the zero of an integrated sensor does to its reading, for those who go on with it: the error ρ · δ.

δ = (bias, wander, integral's error) of each channel minus what `zero_drift` predicts of them: a linear
process that starts with the covariance of the prediction and goes on as `zero_transition` says.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from softfuse.sensors.zero_drift import ZeroDrift, zero_transition


class ReadingDrift(NamedTuple):
    """Of k readings in one frame.

    `covariance` (k, 3, 3): of δ, [V], [V], [V s]; `calm` (k,): nothing touches and nothing flows, so that
    the reading of a body that came back to rest is its own error; `period_s`: since the sensors' last reading
    [s].
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
def _transition(zero: ZeroDrift, dt_s: Float[Array, ""], samples: Float[Array, ""]) -> tuple[Array, Array]:
    return jax.vmap(zero_transition, (0, None, None))(zero, dt_s, samples)
