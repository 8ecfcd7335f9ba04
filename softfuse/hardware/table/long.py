"""Tables with a row for each reading, its time, which channel, its value, as frames of all channels.

Where readings of several channels share their times, a time is a frame. Where each has its own, a frame
begins with the first reading whose channel does not come later, in the order of the first frame, than the one
before; its time is that of its last reading. What a frame has no reading of is missing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from softfuse.hardware.table.rows import Block

_SHARED = 1.5
"""Readings per time, from which on times are shared."""
_IDS = frozenset(
    ("id", "name", "channel", "channel_id", "channel_name", "ch", "sensor", "sensor_id", "sensor_name")
    + ("signal", "signal_name", "topic", "key", "variable", "label", "tag", "source", "metric", "field")
    + ("series",)
)
_VALUES = frozenset(("value", "values", "val", "reading", "data", "measurement", "raw", "v", "y"))


@dataclass
class Readings:
    """Some readings, m of them."""

    time_s: Float[np.ndarray, " m"]
    channel: Int[np.ndarray, " m"]
    """(m,) which channel, -1 where it is none that is wanted."""
    value: Float[np.ndarray, " m"]
    line: Int[np.ndarray, " m"]
    malformed: Bool[np.ndarray, " m"]

    def after(self, earlier: "Readings") -> "Readings":
        """These behind earlier ones."""
        joined = {name: np.concatenate([getattr(earlier, name), getattr(self, name)]) for name in vars(self)}
        return Readings(**joined)

    def part(self, at: slice | Bool[np.ndarray, " m"]) -> "Readings":
        """Some of them."""
        return Readings(**{name: values[at] for name, values in vars(self).items()})


class Pivot:
    """Gathers readings of so many channels, which come in pieces, into frames."""

    def __init__(self, channels: int):
        """Nothing has been read."""
        self._channels = channels
        self._rest: Readings | None = None
        self._shared: bool | None = None

    def add(self, readings: Readings) -> Block:
        """The frames that end in the next readings."""
        known = readings.part(readings.channel >= 0)
        known = known if self._rest is None else known.after(self._rest)
        if not len(known.time_s):
            return self._frames(known, np.zeros(0, int))
        begins = self._begins(known)
        # The last frame may go on.
        last = int(np.flatnonzero(begins)[-1])
        self._rest = known.part(slice(last, None))
        return self._frames(known.part(slice(0, last)), np.cumsum(begins[:last]) - 1)

    def end(self) -> Block:
        """The frame that was not ended."""
        rest = self._rest
        if rest is None:
            rest = Readings(np.zeros(0), np.zeros(0, int), np.zeros(0), np.zeros(0, int), np.zeros(0, bool))
        return self._frames(rest, np.zeros(len(rest.time_s), int))

    def _begins(self, known: Readings) -> Bool[np.ndarray, " m"]:
        later = known.time_s[1:] != known.time_s[:-1]
        later &= np.isfinite(known.time_s[1:]) | np.isfinite(known.time_s[:-1])
        if self._shared is None:
            timed = np.isfinite(known.time_s).any()
            self._shared = bool(timed and len(later) + 1 >= _SHARED * (1 + later.sum()))
        again = known.channel[1:] <= known.channel[:-1]
        return np.concatenate([[True], later if self._shared else again])

    def _frames(self, known: Readings, frame: Int[np.ndarray, " m"]) -> Block:
        n = int(frame[-1]) + 1 if len(frame) else 0
        table = np.full((self._channels, n), np.nan)
        table[known.channel, frame] = known.value
        first = np.searchsorted(frame, np.arange(n))
        last = np.searchsorted(frame, np.arange(n), side="right") - 1
        malformed = np.zeros(n, bool)
        malformed[frame[known.malformed]] = True
        return Block(known.time_s[last], list(table), known.line[first], malformed)


def long_columns(
    names: Sequence[str], told: Mapping[str, str | None], time: int | None
) -> tuple[int, int] | None:
    """The fields of channel and value by the names that were told of "id" and "value", else by likely ones;
    None where one is missing.
    """
    found = []
    for what, likely in (("id", _IDS), ("value", _VALUES)):
        name = told[what]
        among = [k for k, one in enumerate(names) if (one == name if name else one.lower() in likely)]
        among = [k for k in among if k != time and k not in found]
        if not among:
            return None
        found.append(among[0])
    return found[0], found[1]
