"""Sensors of a virtual pad: a flow sensor on each cavity (`flow_electronics`), then its electrodes
(`electrode_electronics`).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from softfuse.experiment.electrode_electronics import AbstractElectrodeElectronics
from softfuse.experiment.flow_electronics import FlowElectronics
from softfuse.sensors.electronics import ChannelElectronics, side_by_side


@dataclass(frozen=True)
class PadElectronics:
    """Constants of both."""

    flow: FlowElectronics
    electrodes: AbstractElectrodeElectronics

    def readings(
        self, flow: Float[np.ndarray, "n k"], signal: Float[np.ndarray, "n e"]
    ) -> Float[np.ndarray, "n k+e"]:
        """Noiseless readings (n, k + e) in V and counts of flows (n, k) m³/s out of the cavities and of what
        the electrodes say (n, e).
        """
        return np.concatenate([self.flow.volts(flow), self.electrodes.counts(signal)], axis=1)

    def channels(self, cavities: int, electrodes: int, seed: int) -> ChannelElectronics:
        """The channels of so many flow sensors, then of so many electrodes, with parts drawn from a seed."""
        rng = np.random.default_rng(np.random.SeedSequence([seed, 0]))
        return side_by_side([self.flow.channels(cavities, rng), self.electrodes.channels(electrodes, rng)])
