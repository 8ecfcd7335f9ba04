"""One sample of named channels, whatever it came from."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, eq=False, slots=True)
class Reading:
    """What a device read at one time, n channels."""

    device: int
    """Which of the devices of its source."""
    sequence: int | None
    """The number of the sample by the device, modulo 2^32; None where the device does not count."""
    device_time_us: int | None
    """The device's time [µs]; None where the device does not tell."""
    host_s: float
    """The host's time of the chunk with its last byte, in seconds since the epoch."""
    names: tuple[str, ...]
    """Of the channels, as the columns of a recording, each with its unit at the end."""
    values: Float[np.ndarray, " n"]
    """(n,) in the units of the names, NaN where not read."""
