"""From what a channel should say to what it says: gain, zero, drift, noise, range and converter.

    v = Δ rint(clip(v₀ + γ (x − v₀) + z + w(t) + s(t) + n, low, high) / Δ)

for a noiseless reading x: v₀ is the reading that means nothing, z a constant zero, w and s zeros that wander
fast and slowly, n white noise, Δ the step of the converter. Both wanders are stationary Ornstein-Uhlenbeck
processes, w(t + δ) = e^(−δ/τ) w(t) + σ √(1 − e^(−2δ/τ)) ξ, exact for any δ (Gillespie, Phys. Rev. E 54, 2084,
1996): what runs for days stays in its bounds.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float

_SAME_S = 1e-7
"""Difference below which two times between samples are the same [s]."""


@dataclass(frozen=True, eq=False)
class ChannelElectronics:
    """k channels, each value (k,) in the unit of its channel, times in s; gain γ has none."""

    nothing: Float[np.ndarray, " k"]
    gain: Float[np.ndarray, " k"]
    zero: Float[np.ndarray, " k"]
    wander_sigma: Float[np.ndarray, " k"]
    wander_time: Float[np.ndarray, " k"]
    slow_sigma: Float[np.ndarray, " k"]
    slow_time: Float[np.ndarray, " k"]
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
    noise: float | Float[np.ndarray, " k"],
    step: float = 0.0,
    low: float = -np.inf,
    high: float = np.inf,
    nothing: float | Float[np.ndarray, " k"] = 0.0,
    gain: float | Float[np.ndarray, " k"] = 1.0,
    zero: float | Float[np.ndarray, " k"] = 0.0,
    wander_sigma: float | Float[np.ndarray, " k"] = 0.0,
    wander_time: float = 1.0,
    slow_sigma: float | Float[np.ndarray, " k"] = 0.0,
    slow_time: float = 1.0,
) -> ChannelElectronics:
    """`count` channels alike, but for gains and zeros; the options are the fields of ChannelElectronics.

    step 0: what is read is not rounded.
    """
    zeros = (zero, wander_sigma, wander_time, slow_sigma, slow_time)
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
        """The first sample's wanders are drawn from their stationary distributions."""
        self._parts, self._rng = electronics, rng
        # Both wanders together (2, k).
        self._sigma = np.stack([electronics.wander_sigma, electronics.slow_sigma])
        self._memory = np.stack([electronics.wander_time, electronics.slow_time])
        self._wander = self._sigma * self._rng.standard_normal(self._sigma.shape)
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
        value += parts.noise * drawn[:, 0]
        for k, now in enumerate(np.asarray(time_s, float).tolist()):
            elapsed = 0.0 if self._time is None else now - self._time
            if abs(elapsed - self._passed) > _SAME_S:
                self._pass(elapsed)
            self._wander = self._decay * self._wander + self._spread * drawn[k, 1:]
            value[k] += self._wander[0] + self._wander[1]
            self._time = now
        clipped = np.clip(value, parts.low, parts.high)
        step = np.where(parts.step > 0, parts.step, 1.0)
        return np.where(parts.step > 0, step * np.rint(clipped / step), clipped)

    def _pass(self, elapsed: float) -> None:
        """Work out how wanders go on over a time [s], which is nearly always the same."""
        self._passed = elapsed
        self._decay = np.exp(-elapsed / self._memory)
        self._spread = self._sigma * np.sqrt(-np.expm1(-2.0 * elapsed / self._memory))
