"""Recordings written as tables of numbers, in the units that the columns' names say."""

import csv
import gzip
import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float

from softfuse.errors import RecordingError

Columns = dict[str, tuple[int | None, Float[np.ndarray, " n"]]]
"""Name of each column to its decimals, None for eight significant digits, and its values (n,), NaN for an
empty field.
"""

_DECIMALS = {"s": 3, "V": 5, "N": 5, "mm": 4, "mm3": 3, "Pa": 2}
"""Of columns whose names end with a unit; others hold whole numbers."""


def with_decimals(columns: Mapping[str, Float[np.ndarray, " n"]]) -> Columns:
    """Columns (n,) with as many decimals as their units, told by their names, ask for."""
    return {name: (_DECIMALS.get(name.rpartition("_")[2], 0), values) for name, values in columns.items()}


def write_recording(path: str | Path, columns: Columns) -> None:
    """Write columns to path, compressed when that ends in .gz. Raises RecordingError when that cannot be."""
    # Rounded first, and without the sign of a zero: "-0.00" says nothing.
    table = [
        values + 0.0 if digits is None else np.round(values, digits) + 0.0
        for digits, values in columns.values()
    ]
    header, body = io.StringIO(), io.StringIO()
    csv.writer(header, lineterminator="\n").writerow(columns)
    formats = ["%.8g" if digits is None else f"%.{digits}f" for digits, _ in columns.values()]
    np.savetxt(body, np.stack(table, axis=1), fmt=formats, delimiter=",")
    text = header.getvalue() + body.getvalue().replace("nan", "")  # a field without a number
    try:
        if str(path).endswith(".gz"):
            with gzip.open(path, "wt", encoding="utf-8", newline="") as file:
                file.write(text)
        else:
            Path(path).write_text(text, encoding="utf-8", newline="")
    except OSError as error:
        raise RecordingError(f"cannot write the recording {path}: {error.strerror or error}") from error
