"""Recordings written as tables of numbers, in the units that the columns' names say."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from softfuse.errors import RecordingError
from softfuse.experiment.channel_electronics import Readout
from softfuse.experiment.programme import Programme
from softfuse.sensors.electronics import ChannelElectronics

Columns = dict[str, tuple[int, Float[np.ndarray, " n"]]]
"""Name of each column to its decimals and values (n,)."""

_DECIMALS = {"V": 5, "N": 5, "mm": 4, "mm3": 3, "Pa": 2}
"""Of columns whose names end with a unit; others hold whole numbers."""


def recorded(programme: Programme, electronics: ChannelElectronics, seed: Sequence[int]) -> Columns:
    """One round of a programme as its channels say it, with the truth; seed: see `Readout`."""
    time = programme.step_s * np.arange(len(programme.readings))
    values = Readout(programme, electronics, seed).read(time)
    columns = dict(zip(programme.channels, values.T, strict=True)) | programme.truth_at(time)
    return {"time_s": (3, time)} | {
        name: (_DECIMALS.get(name.rpartition("_")[2], 0), column) for name, column in columns.items()
    }


def write_recording(path: str | Path, columns: Columns) -> None:
    """Write columns to path, compressed when that ends in .gz. Raises RecordingError when that cannot be."""
    # Rounded first, and without the sign of a zero: "-0.00" says nothing.
    table = [np.round(values, decimals) + 0.0 for decimals, values in columns.values()]
    try:
        np.savetxt(
            path,
            np.stack(table, axis=1),
            fmt=[f"%.{decimals}f" for decimals, _ in columns.values()],
            delimiter=",",
            header=",".join(columns),
            comments="",
        )
    except OSError as error:
        raise RecordingError(f"cannot write the recording {path}: {error.strerror or error}") from error
