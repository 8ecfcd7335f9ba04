"""What goes wrong before a sample is packed: samples that are lost, sensors that die.

A lost sample keeps its sequence number and is not sent. A silent channel is no longer read (NaN on the host),
a stuck one repeats what it read last.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from softfuse.errors import HardwareError


@dataclass(frozen=True)
class DeadSensor:
    """A channel that is silent, or else stuck, from a true time [s]."""

    channel: str
    from_s: float
    silent: bool


@dataclass(frozen=True)
class SensorFaults:
    """Share of samples that are lost [-], and sensors that die."""

    lost: float = 0.0
    dead: tuple[DeadSensor, ...] = ()

    def __post_init__(self) -> None:
        if not 0.0 <= self.lost < 1.0:
            raise HardwareError(f"a share of {self.lost:g} of the samples cannot be lost: give 0 to below 1")


NO_FAULTS = SensorFaults()
"""Nothing goes wrong."""


class FaultySensors:
    """Applies faults to the samples of one board; the same seed loses the same samples."""

    def __init__(self, names: Sequence[str], faults: SensorFaults, seed: Sequence[int]) -> None:
        """names: the board's channels; faults of other boards' channels are left out."""
        self._lost = faults.lost
        self._rng = np.random.default_rng(np.random.SeedSequence(list(seed)))
        self._dead = [
            (list(names).index(dead.channel), dead) for dead in faults.dead if dead.channel in names
        ]
        self._last: dict[int, float] = {}

    def spoil(self, time_s: Float[np.ndarray, " m"], values: Float[np.ndarray, "m k"]) -> None:
        """Change the values (m, k) of samples taken at true times (m,) s in place."""
        for column, dead in self._dead:
            gone = time_s >= dead.from_s
            if dead.silent:
                values[gone, column] = np.nan
            else:
                if not gone.all():
                    self._last[column] = float(values[~gone, column][-1])
                values[gone, column] = self._last.setdefault(column, float(values[0, column]))

    def lose(self, count: int) -> Float[np.ndarray, " m"]:
        """Which of the next samples (m,) are lost."""
        if self._lost == 0.0:
            return np.zeros(count, bool)
        return self._rng.random(count) < self._lost
