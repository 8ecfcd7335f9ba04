"""Sensors of a virtual pad: capacitances to counts, flows to volts, and what parts add to both.

* Lines: counts = parasitic + counts per farad · C; white noise, a slow drift, one count a step.
* Flow: OMRON D6F-P0001A1, V = V₀ + S Q, Q out of the cavity, on a converter of 12 bits: a zero of some mV for
  each part, which wanders, white noise, a dead zone (none in the data sheet), and nothing below 0 V: a fast
  release saturates.

Constants are those of the recordings of the reference pad. Not modelled: the sensor's response time, leaks
past the vent, cross-talk.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from softfuse.experiment.channel_electronics import ChannelElectronics, equal_channels, side_by_side


@dataclass(frozen=True)
class PadElectronics:
    """Constants of the sensors.

    `_bound`: one value a channel, uniform in ± that, drawn from the seed; `_sigma`: standard deviation of a
    wander with that `_time`; noise: one a reading, normal.
    """

    counts_per_F: float = 2000e12
    parasitic_counts: float = 20000.0
    parasitic_bound_counts: float = 500.0
    line_gain_bound: float = 0.005
    line_noise_counts: float = 8.0
    line_slow_sigma_counts: float = 10.0
    line_slow_time_s: float = 300.0
    highest_counts: int = 65535
    zero_V: float = 0.5
    sensitivity_Vs_m3: float = 20.0 / (1e-3 / 60.0)
    zero_bound_V: float = 6e-3
    flow_gain_bound: float = 0.01
    flow_noise_V: float = 2e-3
    wander_sigma_V: float = 0.4e-3
    wander_time_s: float = 3.0
    slow_sigma_V: float = 0.8e-3
    slow_time_s: float = 1800.0
    dead_zone_m3_s: float = 0.0
    adc_bits: int = 12
    adc_V: float = 3.3

    @property
    def volts_per_code(self) -> float:
        """Step of the converter [V]."""
        return self.adc_V / 2**self.adc_bits

    def volts(self, flow: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
        """Noiseless readings (n, k) V of flows (n, k) m³/s out of the cavities."""
        return self.zero_V + self.sensitivity_Vs_m3 * flow

    def counts(self, capacitance: Float[np.ndarray, "n e"]) -> Float[np.ndarray, "n e"]:
        """Noiseless readings (n, e) counts of capacitances (n, e) F."""
        return self.parasitic_counts + self.counts_per_F * capacitance

    def channels(self, cavities: int, lines: int, seed: int) -> ChannelElectronics:
        """The channels of so many flow sensors, then of so many lines, with parts drawn from a seed."""
        rng = np.random.default_rng(np.random.SeedSequence([seed, 0]))
        top = self.volts_per_code * (2**self.adc_bits - 1)
        flow = equal_channels(
            cavities,
            nothing=self.zero_V,
            dead_zone=self.sensitivity_Vs_m3 * self.dead_zone_m3_s,
            gain=1.0 + rng.uniform(-self.flow_gain_bound, self.flow_gain_bound, cavities),
            zero=rng.uniform(-self.zero_bound_V, self.zero_bound_V, cavities),
            wander_sigma=self.wander_sigma_V,
            wander_time=self.wander_time_s,
            slow_sigma=self.slow_sigma_V,
            slow_time=self.slow_time_s,
            noise=self.flow_noise_V,
            step=self.volts_per_code,
            low=0.0,
            high=top,
        )
        line = equal_channels(
            lines,
            nothing=self.parasitic_counts,
            gain=1.0 + rng.uniform(-self.line_gain_bound, self.line_gain_bound, lines),
            zero=rng.uniform(-self.parasitic_bound_counts, self.parasitic_bound_counts, lines),
            slow_sigma=self.line_slow_sigma_counts,
            slow_time=self.line_slow_time_s,
            noise=self.line_noise_counts,
            step=1.0,
            low=0.0,
            high=float(self.highest_counts),
        )
        return side_by_side([flow, line])
