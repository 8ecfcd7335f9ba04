"""Flow sensors of a virtual pad: OMRON D6F-P0001A1, flows to volts, and what parts add.

V = V₀ + S Q, Q out of the cavity, on a converter of 12 bits: a zero of some mV for each part, which wanders,
white noise, a dead zone (none in the data sheet), and nothing below 0 V: a fast release saturates. Constants
are those of the recordings of the reference pad. Not modelled: the sensor's response time, leaks past the
vent, cross-talk.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from softfuse.sensors.electronics import ChannelElectronics, equal_channels


@dataclass(frozen=True)
class FlowElectronics:
    """Constants of the sensors.

    `_bound`: one value a channel, uniform in ± that, drawn when channels are made; `_sigma`: standard
    deviation of a wander with that `_time`; noise: one a reading, normal.
    """

    zero_V: float = 0.5
    sensitivity_Vs_m3: float = 20.0 / (1e-3 / 60.0)
    zero_bound_V: float = 6e-3
    gain_bound: float = 0.01
    noise_V: float = 2e-3
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

    def channels(self, count: int, rng: np.random.Generator) -> ChannelElectronics:
        """So many channels, with parts drawn from a generator."""
        return equal_channels(
            count,
            nothing=self.zero_V,
            dead_zone=self.sensitivity_Vs_m3 * self.dead_zone_m3_s,
            gain=1.0 + rng.uniform(-self.gain_bound, self.gain_bound, count),
            zero=rng.uniform(-self.zero_bound_V, self.zero_bound_V, count),
            wander_sigma=self.wander_sigma_V,
            wander_time=self.wander_time_s,
            slow_sigma=self.slow_sigma_V,
            slow_time=self.slow_time_s,
            noise=self.noise_V,
            step=self.volts_per_code,
            low=0.0,
            high=self.volts_per_code * (2**self.adc_bits - 1),
        )
