"""Which samples of a device are missing, doubled, late, or the first after a restart.

Sequence numbers count modulo 2^32; with e the number after the newest and
d = (s - e) mod 2^32, read as a signed number:

* d >= 0 and a time not before the newest's: fresh, after d missing ones.
* d < 0, at most `REORDERED` back, a number not seen before and a time between those of its neighbours: late.
* the same, seen before with the same time: a duplicate.
* anything else: the device has restarted. Nobody knows how many samples are missing then.

A device that restarted unseen and has since run for longer than before looks like one that lost samples.
"""

from dataclasses import dataclass
from enum import Enum

MODULUS = 2**32
REORDERED = 64
"""How far back a sample is still taken for a late or doubled one [samples]."""


class Arrival(Enum):
    """What a sample is to those before it."""

    FRESH = "fresh"
    """Newer than all before, or the first."""
    RESTARTED = "restarted"
    """The first after a restart: the device's time has begun anew."""
    LATE = "late"
    """Counted as missing before, or older than the first."""
    DUPLICATE = "duplicate"


@dataclass(frozen=True, slots=True)
class Place:
    """Where a sample belongs."""

    arrival: Arrival
    missing: int
    """Samples missing between it and the newest before it; 0 unless fresh."""


@dataclass
class SequenceCounts:
    """What became of a device's samples."""

    fresh: int = 0
    """Restarts included."""
    lost: int = 0
    """Missing and not come late either."""
    duplicated: int = 0
    late: int = 0
    restarted: int = 0


class SequenceWatch:
    """Watches the samples of one device."""

    def __init__(self) -> None:
        self._newest: int | None = None
        self._newest_time_us = 0
        # The last numbers: the time of those seen, None for those missing; none from before the first.
        self._recent: dict[int, int | None] = {}
        self.counts = SequenceCounts()
        """What has become of the samples so far."""

    def place(self, sequence: int, time_us: int) -> Place:
        """Where the next sample to come belongs, by its number (modulo 2^32) and its device time [µs]."""
        if self._newest is None:
            return self._advance(sequence, time_us, 0)
        ahead = (sequence - self._newest - 1) % MODULUS
        if ahead < MODULUS // 2:
            if time_us < self._newest_time_us:
                return self._restart(sequence, time_us)
            return self._advance(sequence, time_us, ahead)
        if MODULUS - ahead > REORDERED or not self._fits(sequence, time_us):
            return self._restart(sequence, time_us)
        seen = sequence in self._recent
        if self._recent.get(sequence) is not None:
            self.counts.duplicated += 1
            return Place(Arrival.DUPLICATE, 0)
        self._recent[sequence] = time_us
        self.counts.late += 1
        self.counts.lost -= seen
        return Place(Arrival.LATE, 0)

    def _fits(self, sequence: int, time_us: int) -> bool:
        """Whether the time is that of this number or, not seen yet, between its neighbours' times."""
        own = self._recent.get(sequence)
        if own is not None:
            return own == time_us
        for other, other_us in self._recent.items():
            if other_us is None:
                continue
            earlier = (sequence - other) % MODULUS < MODULUS // 2
            if other_us > time_us if earlier else other_us < time_us:
                return False
        return True

    def _advance(self, sequence: int, time_us: int, missing: int) -> Place:
        if missing >= REORDERED:
            self._recent.clear()
        for back in range(min(missing, REORDERED - 1), 0, -1):
            self._remember((sequence - back) % MODULUS, None)
        self._remember(sequence, time_us)
        self._newest, self._newest_time_us = sequence, time_us
        self.counts.fresh += 1
        self.counts.lost += missing
        return Place(Arrival.FRESH, missing)

    def _remember(self, sequence: int, time_us: int | None) -> None:
        self._recent[sequence] = time_us
        self._recent.pop((sequence - REORDERED) % MODULUS, None)

    def _restart(self, sequence: int, time_us: int) -> Place:
        self._recent.clear()
        self._advance(sequence, time_us, 0)
        self.counts.restarted += 1
        return Place(Arrival.RESTARTED, 0)
