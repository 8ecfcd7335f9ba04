"""A programme read through electronics, sample after sample."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from softfuse.experiment.programme import Programme
from softfuse.sensors.electronics import ChannelElectronics, Converter


class Readout:
    """Reads a programme through electronics; the same seed gives the same samples."""

    def __init__(self, programme: Programme, electronics: ChannelElectronics, seed: Sequence[int]) -> None:
        """`seed`: numbers that no two readouts of a device share."""
        rng = np.random.default_rng(np.random.SeedSequence(list(seed)))
        self._programme, self._converter = programme, Converter(electronics, rng)

    def read(self, time_s: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m k"]:
        """Samples (m, k) at times (m,) s that are later than all before and increase."""
        return self._converter.read(time_s, self._programme.at(time_s))
