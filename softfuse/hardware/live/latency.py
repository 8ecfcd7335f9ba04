"""Quantiles of latencies in constant memory: counts in bins whose widths grow by 2 %."""

import math

import numpy as np

_LEAST_S, _MOST_S, _RATIO = 1e-5, 1e3, 1.02
_BINS = math.ceil(math.log(_MOST_S / _LEAST_S) / math.log(_RATIO)) + 2


class Latencies:
    """A histogram of times from 10 µs to 1000 s; quantiles are good to 2 %."""

    def __init__(self) -> None:
        self._counts = np.zeros(_BINS, np.int64)
        self._largest_s = 0.0

    def add(self, seconds: float) -> None:
        """Count one; what is below 10 µs counts as that."""
        at = math.ceil(math.log(max(seconds, _LEAST_S) / _LEAST_S) / math.log(_RATIO))
        self._counts[min(at, _BINS - 1)] += 1
        self._largest_s = max(self._largest_s, seconds)

    @property
    def count(self) -> int:
        """How many there are."""
        return int(self._counts.sum())

    @property
    def largest_s(self) -> float:
        """The largest one [s]; 0 without any."""
        return self._largest_s

    def quantile_s(self, share: float) -> float:
        """The time [s] that a share of all is not above, rounded up by at most 2 %; NaN without any."""
        total = self._counts.sum()
        if total == 0:
            return math.nan
        at = int(np.searchsorted(np.cumsum(self._counts), max(share * total, 1.0)))
        return min(_LEAST_S * _RATIO**at, self._largest_s)
