"""Electrodes of a virtual pad: what their converters make of capacitances, and what parts add.

* Crossed lines: counts = parasitic + counts per farad · C, for the capacitance C of each line.
* Cells of a grid: counts = N₀ (1 + γ ΔC/C₀), for the relative change of each cell, N₀ its reading at rest.

Both with white noise, a slow drift, and one count a step. Constants of the lines are those of the recordings
of the reference pad.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from softfuse.sensors.electronics import ChannelElectronics, equal_channels


class AbstractElectrodeElectronics(ABC):
    """Constants of the electrodes' converters.

    `_bound`: one value a channel, uniform in ± that, `gain_sigma`: one a channel, normal, drawn when channels
    are made; noise: one a reading, normal.
    """

    @abstractmethod
    def counts(self, signal: Float[np.ndarray, "n e"]) -> Float[np.ndarray, "n e"]:
        """Noiseless readings (n, e) counts of nominal parts, for what `pad_electrodes` say (n, e)."""

    @abstractmethod
    def channels(self, count: int, rng: np.random.Generator) -> ChannelElectronics:
        """So many channels, with parts drawn from a generator."""


@dataclass(frozen=True)
class LineElectronics(AbstractElectrodeElectronics):
    """Of crossed lines; `slow_sigma_counts`: standard deviation of a wander with `slow_time_s`."""

    counts_per_F: float = 2000e12
    parasitic_counts: float = 20000.0
    parasitic_bound_counts: float = 500.0
    gain_bound: float = 0.005
    noise_counts: float = 8.0
    slow_sigma_counts: float = 10.0
    slow_time_s: float = 300.0
    highest_counts: int = 65535

    def counts(self, signal: Float[np.ndarray, "n e"]) -> Float[np.ndarray, "n e"]:
        """Of capacitances (n, e) F."""
        return self.parasitic_counts + self.counts_per_F * signal

    def channels(self, count: int, rng: np.random.Generator) -> ChannelElectronics:
        """Lines that differ in gain and parasitic capacitance."""
        return equal_channels(
            count,
            nothing=self.parasitic_counts,
            gain=1.0 + rng.uniform(-self.gain_bound, self.gain_bound, count),
            zero=rng.uniform(-self.parasitic_bound_counts, self.parasitic_bound_counts, count),
            slow_sigma=self.slow_sigma_counts,
            slow_time=self.slow_time_s,
            noise=self.noise_counts,
            step=1.0,
            low=0.0,
            high=float(self.highest_counts),
        )


@dataclass(frozen=True)
class CellElectronics(AbstractElectrodeElectronics):
    """Of the cells of a grid.

    `drift_counts` of all and `own_drift_counts` of each cell after one second. Channels drift each on its
    own, by both together, and over times beyond `drift_time_s` no further.
    """

    rest_counts: float = 16000.0
    rest_bound_counts: float = 1500.0
    gain_sigma: float = 0.03
    noise_counts: float = 8.0
    drift_counts: float = 5.0
    own_drift_counts: float = 2.0
    drift_time_s: float = 300.0
    highest_counts: int = 65535

    def rest_and_gain(
        self, shape: tuple[int, ...], rng: np.random.Generator
    ) -> tuple[Float[np.ndarray, "*e"], Float[np.ndarray, "*e"]]:
        """Counts N₀ at rest and gain γ of cells in a given shape, drawn from a generator."""
        rest = self.rest_counts + rng.uniform(-self.rest_bound_counts, self.rest_bound_counts, shape)
        return rest, 1.0 + rng.normal(0.0, self.gain_sigma, shape)

    def counts(self, signal: Float[np.ndarray, "n e"]) -> Float[np.ndarray, "n e"]:
        """Of changes (n, e) relative to the capacitances at rest."""
        return self.rest_counts * (1.0 + signal)

    def channels(self, count: int, rng: np.random.Generator) -> ChannelElectronics:
        """Cells that differ in reading at rest and gain."""
        rest, gain = self.rest_and_gain((count,), rng)
        # A stationary wander gains σ √(2 t/τ) in a time t that is short against its τ.
        drift = float(np.hypot(self.drift_counts, self.own_drift_counts))
        return equal_channels(
            count,
            nothing=self.rest_counts,
            gain=gain * rest / self.rest_counts,
            zero=rest - self.rest_counts,
            slow_sigma=drift * np.sqrt(0.5 * self.drift_time_s),
            slow_time=self.drift_time_s,
            noise=self.noise_counts,
            step=1.0,
            low=0.0,
            high=float(self.highest_counts),
        )
