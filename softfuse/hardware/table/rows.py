"""Rows of a table out of blocks of text: numbers as fast as pyarrow reads them, damaged rows field by field.

A block that pyarrow refuses is cut in parts until the damaged rows stand nearly alone. A row that was cut
keeps its place: what cannot be read is NaN, the last field of a cut row included, since the cut may have
shortened the number. Texts of columns in which nobody needs numbers are kept as labels.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from softfuse.hardware.table.dialect import Dialect, is_comment
from softfuse.hardware.table.form import MISSING, missing, number

_PARTS = 8
_TIME = -1
"""The number of the column of the time; those of channels are counted from 0."""
_BY_HAND = 64
"""Lines that are not worth another try."""
_MOST_LABELS = 10_000
"""Different texts in a column, beyond which they are no names and not kept."""
_NULLS = sorted({*MISSING, *(text.upper() for text in MISSING), "NaN", "None"})


@dataclass
class Block:
    """Some frames, m of them."""

    time_s: Float[np.ndarray, " m"]
    values: list[Float[np.ndarray, " m"]]
    """(m,) of each channel, NaN where there is no number."""
    line: Int[np.ndarray, " m"]
    """(m,) in the file; of a frame of several readings that of the first."""
    malformed: Bool[np.ndarray, " m"]
    """(m,) rows with fields that could not be read, too few or too many."""
    labels: dict[int, Int[np.ndarray, " m"]] = field(default_factory=dict)
    """Of channels that hold texts, by number: (m,) which of `RowReader.labels`, -1 where there is none."""


class RowReader:
    """Reads the time and the fields at `places` of the rows of a table; numbers are needed of the time, and
    at those of `needed`.
    """

    def __init__(self, dialect: Dialect, time: int | None, places: Sequence[int], needed: Sequence[int]):
        """time: its place, None where none is read. Which columns hold texts is told by the first rows, and
        later by what comes.
        """
        self._dialect = dialect
        self._places = dict(enumerate(places)) if time is None else {_TIME: time, **dict(enumerate(places))}
        self._needed = {time, *needed}
        self.labels: dict[int, dict[str, int]] = {}
        """Of columns that hold texts, by number: each text and its number."""
        self.worded = set[int]()
        """The columns of whose first fields some are texts and none is a number, by number."""
        for c, place in self._places.items():
            seen = [row[place] for row in dialect.sample if place < len(row)]
            if place not in self._needed and any(self._text(field) for field in seen):
                self.labels[c] = {}
                if all(self._number(field) is None for field in seen):
                    self.worded.add(c)

    def read(self, block: bytes, line: int) -> Iterator[Block]:
        """The rows of whole lines, of which the first has that number."""
        rows = self._by_arrow(block, line)
        if rows is not None:
            yield rows
            return
        lines = block.split(b"\n")[:-1]
        if len(lines) <= _BY_HAND:
            yield self._by_hand(lines, line)
            return
        size = -(-len(lines) // _PARTS)
        for k in range(0, len(lines), size):
            part = b"\n".join(lines[k : k + size]) + b"\n"
            yield from self.read(part, line + k)

    def _text(self, field: str) -> bool:
        return not missing(field) and number(field, self._dialect.decimal) is None

    def _by_arrow(self, block: bytes, line: int) -> Block | None:
        """All rows, or None where a row is not as it should be."""
        import pyarrow as pa
        from pyarrow import csv

        dialect = self._dialect
        if dialect.separator == " ":
            block = re.sub(rb"(?m)^ | (?=\r?$)", b"", re.sub(rb"[ \t]+", b" ", block))
        text = pa.dictionary(pa.int32(), pa.string())
        kinds = {str(place): text if c in self.labels else pa.float64() for c, place in self._places.items()}
        try:
            found = csv.read_csv(
                pa.BufferReader(block),
                csv.ReadOptions(column_names=list(map(str, range(dialect.width))), block_size=len(block) + 1),
                csv.ParseOptions(delimiter=dialect.separator, quote_char=dialect.quote),
                csv.ConvertOptions(
                    column_types=kinds,
                    include_columns=list(kinds),
                    null_values=_NULLS,
                    decimal_point=dialect.decimal,
                ),
            )
        except pa.ArrowInvalid:
            return None
        at = _lines_with_text(block)
        if len(at) != found.num_rows:  # a quote ran over the end of a line
            return None
        values, labels = dict[int, np.ndarray](), dict[int, np.ndarray]()
        malformed = np.zeros(len(at), bool)
        for (c, place), column in zip(self._places.items(), found.columns, strict=True):
            if c in self.labels:
                values[c], labels[c] = self._labelled(c, column.combine_chunks())
            else:
                values[c] = column.to_numpy().astype(float)
                values[c][~np.isfinite(values[c])] = np.nan
            if place in self._needed:
                malformed |= np.isnan(values[c])
        return _block(values, line + at, malformed, labels)

    def _labelled(self, c: int, column: Any) -> tuple[np.ndarray, np.ndarray]:
        texts = column.dictionary.to_pylist()
        numbers = np.array([np.nan if (n := self._number(text)) is None else n for text in texts] + [np.nan])
        names = np.array(
            [*(self._label(c, text) if self._text(text) else -1 for text in texts), -1], np.int32
        )
        code = column.indices.fill_null(len(texts)).to_numpy()
        return numbers[code], names[code]

    def _label(self, c: int, text: str) -> int:
        names = self.labels.setdefault(c, {})
        if text.strip() not in names and len(names) >= _MOST_LABELS:
            return -1
        return names.setdefault(text.strip(), len(names))

    def _number(self, text: str) -> float | None:
        return number(text, self._dialect.decimal)

    def _by_hand(self, lines: Sequence[bytes], first: int) -> Block:
        rows: list[tuple[int, list[str]]] = []
        for k, raw in enumerate(lines):
            line = raw.decode(errors="replace")
            if line.strip() and not is_comment(line):
                rows.append((first + k, self._dialect.fields(line)))
        width, n = self._dialect.width, len(rows)
        values = {c: np.full(n, np.nan) for c in self._places}
        labels = {c: np.full(n, -1, np.int32) for c in self.labels}
        malformed = np.zeros(n, bool)
        for i, (_, fields) in enumerate(rows):
            surplus = fields[width:]
            named = width - (not self._dialect.names[-1])
            short = len(fields) < named
            malformed[i] = short or any(surplus)
            if short:
                fields = fields[:-1]
            for c, place in self._places.items():
                field = fields[place] if place < len(fields) else ""
                found = self._number(field)
                if found is not None:
                    values[c][i] = found
                elif place in self._needed:
                    malformed[i] = True
                elif not missing(field) and not short:
                    labels.setdefault(c, np.full(n, -1, np.int32))[i] = self._label(c, field)
        return _block(values, np.array([k for k, _ in rows], dtype=int), malformed, labels)


def _block(
    values: dict[int, np.ndarray], line: np.ndarray, malformed: np.ndarray, labels: dict[int, np.ndarray]
) -> Block:
    time_s = values.pop(_TIME, None)
    time_s = np.full(len(line), np.nan) if time_s is None else time_s
    return Block(time_s, list(values.values()), line, malformed, labels)


def _lines_with_text(block: bytes) -> Int[np.ndarray, " m"]:
    """The numbers (m,), from 0, of the lines that are not empty."""
    signs = np.frombuffer(block, np.uint8)
    ends = np.flatnonzero(signs == ord("\n"))
    starts = np.concatenate([[0], ends[:-1] + 1])
    empty = (ends == starts) | ((ends == starts + 1) & (signs[starts] == ord("\r")))
    return np.flatnonzero(~empty)
