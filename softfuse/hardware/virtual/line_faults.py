"""What goes wrong on the line: bytes that are dropped, bits that are flipped; each independently of all
others.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softfuse.errors import HardwareError


@dataclass(frozen=True)
class LineFaults:
    """Probability that a byte is dropped, and that a bit is flipped."""

    drop: float = 0.0
    flip: float = 0.0

    def __post_init__(self) -> None:
        for share, what in ((self.drop, "byte is dropped"), (self.flip, "bit is flipped")):
            if not 0.0 <= share <= 0.5:
                raise HardwareError(f"the probability {share:g} that a {what} must be between 0 and 0.5")


class FaultyLine:
    """Spoils the bytes of one line; the same seed spoils the same bytes."""

    def __init__(self, faults: LineFaults, seed: Sequence[int]) -> None:
        self._faults = faults
        self._rng = np.random.default_rng(np.random.SeedSequence(list(seed)))
        self._dropped = 0
        self._flipped = 0

    @property
    def dropped(self) -> int:
        """Bytes that were dropped so far."""
        return self._dropped

    @property
    def flipped(self) -> int:
        """Bits that were flipped so far, those of bytes that were dropped included."""
        return self._flipped

    def carry(self, data: bytes) -> bytes:
        """What comes out at the other end."""
        if self._faults.flip > 0.0:
            data = self._flip(data)
        if self._faults.drop > 0.0:
            data = self._drop(data)
        return data

    def _flip(self, data: bytes) -> bytes:
        bits = 8 * len(data)
        count = int(self._rng.binomial(bits, self._faults.flip))
        if count == 0:
            return data
        self._flipped += count
        spoiled = bytearray(data)
        for bit in self._rng.choice(bits, count, replace=False).tolist():
            spoiled[bit >> 3] ^= 1 << (bit & 7)
        return bytes(spoiled)

    def _drop(self, data: bytes) -> bytes:
        count = int(self._rng.binomial(len(data), self._faults.drop))
        if count == 0:
            return data
        self._dropped += count
        kept = np.ones(len(data), bool)
        kept[self._rng.choice(len(data), count, replace=False)] = False
        return np.frombuffer(data, np.uint8)[kept].tobytes()
