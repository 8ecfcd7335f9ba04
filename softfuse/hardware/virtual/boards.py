"""Boards that send what the channels of a virtual robot say, and a file of the truth of their samples."""

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from softfuse.errors import RecordingError
from softfuse.hardware.virtual.board import BoardClock, Read, VirtualBoard
from softfuse.hardware.virtual.faults import Faults
from softfuse.hardware.wire.description import Channel, Description, RawType
from softfuse.sensors.electronics import ChannelElectronics, Converter

_NOISE, _FAULTS, _LINE, _CLOCK = range(4)
"""What a seed is for; with the number of the board it makes a stream of random numbers of its own."""

_LATEST_START_US = 3_600_000_000
"""Boards may have been on for an hour when they are found."""

_FLUSH_ROWS = 50


@dataclass(frozen=True, eq=False)
class BoardChannels:
    """The channels of a board: its name, theirs (k,), what they should say (m, k) at times (m,) s, and what
    their electronics make of that.
    """

    name: str
    channels: tuple[str, ...]
    ideal: Callable[[Float[np.ndarray, " m"]], Float[np.ndarray, "m k"]]
    electronics: ChannelElectronics


def boards_of(
    parts: Sequence[BoardChannels],
    rate_Hz: float,
    faults: Faults,
    seed: int,
    written: Callable[[Float[np.ndarray, " m"]], None] | None,
) -> list[VirtualBoard]:
    """One board for each part. `written` is called with the times (m,) s of the first one's samples, lost
    ones too.

    Raises WireError for channels that the protocol does not know, HardwareError for a rate that cannot be.
    """
    boards = []
    for k, part in enumerate(parts):
        read = _reading(part, (seed, _NOISE, k), None if k else written)
        start = int(np.random.default_rng((seed, _CLOCK, k)).integers(_LATEST_START_US))
        drift = faults.drift_ppm if k == 0 else -faults.drift_ppm
        boards.append(
            VirtualBoard(
                k + 1,
                Description(part.name, channels_of(part.channels, part.electronics)),
                read,
                BoardClock(rate_Hz, start, drift),
                faults=faults.sensors,
                seed=(seed, _FAULTS, k),
            )
        )
    return boards


def line_seed(seed: int, board: int) -> tuple[int, int, int]:
    """The seed of a board's line."""
    return seed, _LINE, board


def channels_of(names: Sequence[str], parts: ChannelElectronics) -> tuple[Channel, ...]:
    """The channels whose raw values are the codes of their converters; numbers as they are where these do not
    round.
    """
    found = []
    for name, step, low, high in zip(names, parts.step, parts.low, parts.high, strict=True):
        whole = RawType.U16 if low >= 0 and high < 65536 * step else RawType.I32
        found.append(Channel(name, whole, step, 0.0) if step > 0 else Channel(name, RawType.F32, 1.0, 0.0))
    return tuple(found)


class TruthFile:
    """A CSV file of the truth at the times of samples: `time_s` since the epoch, then its columns."""

    def __init__(
        self,
        path: Path,
        truth: Callable[[Float[np.ndarray, " m"]], Mapping[str, Float[np.ndarray, " m"]]],
        marks: frozenset[str],
        start_s: float,
    ) -> None:
        """truth: columns (m,) at times (m,) s since the start; marks: those of them that are whole numbers;
        start_s: since the epoch. Raises RecordingError when the file is there already or cannot be made.
        """
        self._path, self._truth, self._start_s = path, truth, start_s
        names = list(truth(np.zeros(1)))
        self._marks = [name in marks for name in names]
        try:
            self._file = path.open("x", encoding="utf-8", newline="\n")
            self._file.write(",".join(("time_s", *names)) + os.linesep)
        except FileExistsError:
            raise RecordingError(f"{path} exists: remove it or give another --truth") from None
        except OSError as error:
            raise RecordingError(f"cannot make {path}: {error.strerror or error}") from error
        self._rows = 0

    def write(self, time_s: Float[np.ndarray, " m"]) -> None:
        """Write the truth at times (m,) s since the start; raises RecordingError when the disk does not take
        it.
        """
        columns = np.stack([self._start_s + time_s, *self._truth(time_s).values()], axis=1)
        try:
            for at, *values in columns.tolist():
                fields = [_field(value, mark=mark) for value, mark in zip(values, self._marks, strict=True)]
                self._file.write(",".join([f"{at:.6f}", *fields]) + "\n")
            self._rows += len(columns)
            if self._rows >= _FLUSH_ROWS:
                self._rows = 0
                self._file.flush()
        except OSError as error:
            raise RecordingError(f"cannot write {self._path}: {error.strerror or error}") from error

    def close(self) -> None:
        """Write what waits; raises RecordingError when the disk does not take it."""
        try:
            self._file.close()
        except OSError as error:
            raise RecordingError(f"cannot write {self._path}: {error.strerror or error}") from error


def _field(value: float, *, mark: bool) -> str:
    if math.isnan(value):
        return ""
    return f"{value:.0f}" if mark else f"{value:.6g}"


def _reading(
    part: BoardChannels, seed: Sequence[int], written: Callable[[Float[np.ndarray, " m"]], None] | None
) -> Read:
    """Reads samples one after the other, and tells their times; the same seed gives the same samples."""
    converter = Converter(part.electronics, np.random.default_rng(np.random.SeedSequence(list(seed))))

    def read(time_s: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m k"]:
        if written is not None:
            written(time_s)
        return converter.read(time_s, part.ideal(time_s))

    return read
