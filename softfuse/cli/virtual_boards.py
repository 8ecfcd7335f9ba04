"""From a virtual body to boards that send what its channels say."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from softfuse.cli.virtual_faults import Faults
from softfuse.errors import RecordingError
from softfuse.experiment.build_virtual import VirtualBody
from softfuse.experiment.channel_electronics import Readout
from softfuse.experiment.programme import Programme
from softfuse.hardware.virtual.board import Read, VirtualBoard
from softfuse.hardware.virtual.board_clock import BoardClock
from softfuse.hardware.wire.channel import Channel, RawType
from softfuse.hardware.wire.description import Description
from softfuse.sensors.electronics import ChannelElectronics

_NOISE, _FAULTS, _LINE, _CLOCK = range(4)
"""What a seed is for; with the number of the board it makes a stream of random numbers of its own."""

_LATEST_START_US = 3_600_000_000
"""Boards may have been on for an hour when they are found."""

_FLUSH_ROWS = 50


def boards_of(
    body: VirtualBody,
    name: str,
    count: int,
    rate_Hz: float,
    faults: Faults,
    seed: int,
    written: Callable[[Float[np.ndarray, " m"]], None] | None,
) -> list[VirtualBoard]:
    """One board with all channels, or two: electrodes on the first, the rest on the second.

    name: of the device. `written` is called with the times (m,) s of the first board's samples, lost ones
    too. Raises WireError for channels that the protocol does not know, HardwareError for a rate that cannot
    be.
    """
    channels = (body.programme.channels,) if count == 1 else body.boards
    names = (name,) if count == 1 else (f"{name} electrodes", f"{name} cavities")
    boards = []
    for k, (own, called) in enumerate(zip(channels, names, strict=True)):
        parts = body.electronics.taken([body.programme.channels.index(each) for each in own])
        readout = Readout(body.programme.only(own), parts, (seed, _NOISE, k))
        start = int(np.random.default_rng((seed, _CLOCK, k)).integers(_LATEST_START_US))
        drift = faults.drift_ppm if k == 0 else -faults.drift_ppm
        boards.append(
            VirtualBoard(
                k + 1,
                Description(called, channels_of(own, parts)),
                readout.read if k or written is None else _telling(readout.read, written),
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
    """The channels whose raw values are the codes of their converters."""
    return tuple(
        Channel(name, RawType.U16 if low >= 0 and high < 65536 * step else RawType.I32, step, 0.0)
        for name, step, low, high in zip(names, parts.step, parts.low, parts.high, strict=True)
    )


class TruthFile:
    """A CSV file of the truth at the times of samples: `time_s` since the epoch, then the programme's
    columns.
    """

    def __init__(self, path: Path, programme: Programme, start_s: float) -> None:
        """start_s: since the epoch when the device starts. Raises RecordingError when the file is there
        already or cannot be made.
        """
        self._path, self._programme, self._start_s = path, programme, start_s
        try:
            self._file = path.open("x", encoding="utf-8", newline="\n")
            self._file.write(",".join(("time_s", *programme.truth)) + os.linesep)
        except FileExistsError:
            raise RecordingError(f"{path} exists: remove it or give another --truth") from None
        except OSError as error:
            raise RecordingError(f"cannot make {path}: {error.strerror or error}") from error
        self._rows = 0

    def write(self, time_s: Float[np.ndarray, " m"]) -> None:
        """Write the truth at times (m,) s since the start; raises RecordingError when the disk does not take
        it.
        """
        truth = self._programme.truth_at(time_s)
        columns = np.stack([self._start_s + time_s, *truth.values()], axis=1)
        marks = [name in self._programme.stepped for name in truth]
        try:
            for at, *values in columns.tolist():
                fields = [f"{v:.0f}" if mark else f"{v:.6g}" for v, mark in zip(values, marks, strict=True)]
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


def _telling(read: Read, written: Callable[[Float[np.ndarray, " m"]], None]) -> Read:
    def tell(time_s: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m k"]:
        written(time_s)
        return read(time_s)

    return tell
