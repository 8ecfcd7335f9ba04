"""From what a channel should say to what it says: gain, zero, drift, noise, range and converter.

    v = Δ rint(clip(v₀ + γ (x − v₀) + z + w(t) + s(t) + d(t) + n, low, high) / Δ)

for a noiseless reading x: v₀ is the reading that means nothing, z a constant zero, w and s zeros that wander
fast and slowly, d one that drifts, n white noise, Δ the step of the converter. Both wanders are stationary
Ornstein-Uhlenbeck processes, w(t + δ) = e^(−δ/τ) w(t) + σ √(1 − e^(−2δ/τ)) ξ, exact for any δ (Gillespie,
Phys. Rev. E 54, 2084, 1996): what runs for days stays in its bounds. They have no rate: in a short time they
go as far as √t. What drifts has one, of standard deviation r, and keeps its direction for some time τ, as
where gas or a part warms up: d is stationary with covariance (r τ)² (1 + |t|/τ) e^(−|t|/τ), Matérn's of order
3/2. With d = r τ y and its rate r v, for a = δ/τ

    (y, v)(t + δ) = e^(−a) [[1 + a, a], [−a, 1 − a]] (y, v)(t) + L ξ,   L Lᵀ = what keeps both of variance 1

(Särkkä and Solin, Applied Stochastic Differential Equations, 2019, Sec. 12.3).
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float
from scipy.special import gammainc

Values = float | Float[np.ndarray, " k"]
"""One for all of k channels, or one for each."""

DRIFT_TIME_S = 600.0
"""How long a virtual zero drifts one way, where nothing else is said."""

_SAME_S = 1e-7
"""Difference below which two times between samples are the same [s]."""


@dataclass(frozen=True, eq=False)
class ChannelElectronics:
    """k channels, each value (k,) in the unit of its channel, that of drift r per second, times in s; gain γ
    has none.
    """

    nothing: Float[np.ndarray, " k"]
    gain: Float[np.ndarray, " k"]
    zero: Float[np.ndarray, " k"]
    wander_sigma: Float[np.ndarray, " k"]
    wander_time: Float[np.ndarray, " k"]
    slow_sigma: Float[np.ndarray, " k"]
    slow_time: Float[np.ndarray, " k"]
    drift: Float[np.ndarray, " k"]
    drift_time: Float[np.ndarray, " k"]
    noise: Float[np.ndarray, " k"]
    step: Float[np.ndarray, " k"]
    low: Float[np.ndarray, " k"]
    high: Float[np.ndarray, " k"]

    def taken(self, channels: Sequence[int]) -> "ChannelElectronics":
        """Some of the channels, by their numbers."""
        return ChannelElectronics(*(getattr(self, field.name)[list(channels)] for field in fields(self)))


def equal_channels(
    count: int,
    *,
    noise: Values,
    step: Values = 0.0,
    low: Values = -np.inf,
    high: Values = np.inf,
    nothing: Values = 0.0,
    gain: Values = 1.0,
    zero: Values = 0.0,
    wander_sigma: Values = 0.0,
    wander_time: Values = 1.0,
    slow_sigma: Values = 0.0,
    slow_time: Values = 1.0,
    drift: Values = 0.0,
    drift_time: Values = DRIFT_TIME_S,
) -> ChannelElectronics:
    """`count` channels; the options are the fields of ChannelElectronics.

    step 0: what is read is not rounded.
    """
    zeros = (zero, wander_sigma, wander_time, slow_sigma, slow_time, drift, drift_time)
    values = (nothing, gain, *zeros, noise, step, low, high)
    return ChannelElectronics(*(np.broadcast_to(np.asarray(value, float), (count,)) for value in values))


def side_by_side(parts: Sequence[ChannelElectronics]) -> ChannelElectronics:
    """The channels of all parts in their order."""
    return ChannelElectronics(
        *(
            np.concatenate([getattr(part, field.name) for part in parts])
            for field in fields(ChannelElectronics)
        )
    )


class Converter:
    """Reads channels sample after sample; the same generator gives the same samples."""

    def __init__(self, electronics: ChannelElectronics, rng: np.random.Generator) -> None:
        """The first sample's wanders and drift are drawn from their stationary distributions."""
        self._parts, self._rng, self._drift_rng = electronics, rng, *rng.spawn(1)
        # Both wanders together (2, k).
        self._sigma = np.stack([electronics.wander_sigma, electronics.slow_sigma])
        self._memory = np.stack([electronics.wander_time, electronics.slow_time])
        self._wander = self._sigma * self._rng.standard_normal(self._sigma.shape)
        # What drifts and its rate (2, k), over their standard deviations.
        self._drifting = self._drift_rng.standard_normal(self._sigma.shape)
        self._time: float | None = None
        self._pass(0.0)

    def read(
        self, time_s: Float[np.ndarray, " m"], ideal: Float[np.ndarray, "m k"]
    ) -> Float[np.ndarray, "m k"]:
        """Samples (m, k) of ideal readings (m, k) at times (m,) s that are later than all before and
        increase.
        """
        parts = self._parts
        value = parts.nothing + parts.gain * (ideal - parts.nothing) + parts.zero
        # Drawn sample by sample, so that it does not matter how many are read at once.
        drawn = self._rng.standard_normal((len(value), 3, value.shape[1]))
        pushed = self._drift_rng.standard_normal((len(value), 2, value.shape[1]))
        drifted = parts.drift * parts.drift_time
        value += parts.noise * drawn[:, 0]
        for k, now in enumerate(np.asarray(time_s, float).tolist()):
            elapsed = 0.0 if self._time is None else now - self._time
            if abs(elapsed - self._passed) > _SAME_S:
                self._pass(elapsed)
            self._wander = self._decay * self._wander + self._spread * drawn[k, 1:]
            self._drifting = np.einsum("ijk,jk->ik", self._kept, self._drifting) + np.einsum(
                "ijk,jk->ik", self._push, pushed[k]
            )
            value[k] += self._wander[0] + self._wander[1] + drifted * self._drifting[0]
            self._time = now
        clipped = np.clip(value, parts.low, parts.high)
        step = np.where(parts.step > 0, parts.step, 1.0)
        return np.where(parts.step > 0, step * np.rint(clipped / step), clipped)

    def _pass(self, elapsed: float) -> None:
        """Work out how wanders and drift go on over a time [s], which is nearly always the same."""
        self._passed = elapsed
        self._decay = np.exp(-elapsed / self._memory)
        self._spread = self._sigma * np.sqrt(-np.expm1(-2.0 * elapsed / self._memory))
        a = elapsed / self._parts.drift_time
        left = np.exp(-a)
        self._kept = left * np.array([[1.0 + a, a], [-a, 1.0 - a]])
        # Of 1 − e^(−2a)(1 + 2a + 2a²) the difference would leave nothing where a is small.
        variance, both = gammainc(3.0, 2.0 * a), 2.0 * (a * left) ** 2
        rates = -np.expm1(-2.0 * a) + 2.0 * a * (1.0 - a) * left**2
        first = np.sqrt(variance)
        along = np.divide(both, first, out=np.zeros_like(a), where=first > 0)
        self._push = np.array([[first, 0.0 * a], [along, np.sqrt(np.maximum(rates - along**2, 0.0))]])
