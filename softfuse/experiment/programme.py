"""What a device's channels say, without noise, while something is done to it over and over again.

A programme is a table with a row every `step_s`, interpolated linearly and continued periodically; its last
row is followed by its first. Noise and converters are in `channel_electronics`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

_ROUNDING = 1e-6
"""Rows by which a time may be off."""


@dataclass(frozen=True, eq=False)
class Programme:
    """n rows of k channels.

    channels: columns of a recording, whose names end with the unit; readings (n, k) in these units. truth:
    other columns (n,) in the units of their names; those in `stepped` are counts and marks that hold until
    the next row.
    """

    step_s: float
    channels: tuple[str, ...]
    readings: Float[np.ndarray, "n k"]
    truth: Mapping[str, Float[np.ndarray, " n"]]
    stepped: frozenset[str] = frozenset()

    @property
    def period_s(self) -> float:
        """After which it begins anew [s]."""
        return self.step_s * len(self.readings)

    def at(self, time_s: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m k"]:
        """Readings (m, k) at times (m,) s, counted from the start of the first round."""
        before, after, share = self._rows(time_s)
        return (1.0 - share[:, None]) * self.readings[before] + share[:, None] * self.readings[after]

    def truth_at(self, time_s: Float[np.ndarray, " m"]) -> dict[str, Float[np.ndarray, " m"]]:
        """Truth (m,) at times (m,) s, counted from the start of the first round."""
        before, after, share = self._rows(time_s)
        last = np.floor(np.asarray(time_s) / self.step_s + _ROUNDING).astype(np.int64) % len(self.readings)
        return {
            name: values[last]
            if name in self.stepped
            else (1.0 - share) * values[before] + share * values[after]
            for name, values in self.truth.items()
        }

    def only(self, channels: Sequence[str]) -> "Programme":
        """The same with some of its channels, in the order given."""
        columns = [self.channels.index(name) for name in channels]
        return Programme(self.step_s, tuple(channels), self.readings[:, columns], self.truth, self.stepped)

    def _rows(
        self, time_s: Float[np.ndarray, " m"]
    ) -> tuple[Int[np.ndarray, " m"], Int[np.ndarray, " m"], Float[np.ndarray, " m"]]:
        row = np.asarray(time_s, float) / self.step_s
        before = np.floor(row).astype(np.int64)
        count = len(self.readings)
        return before % count, (before + 1) % count, row - before
