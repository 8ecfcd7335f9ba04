"""The text of a file, .gz or not, in blocks of whole lines, as UTF-8 whatever it is written in; and rows of a
table out of these: numbers as fast as pyarrow reads them, damaged rows field by field.

A block that pyarrow refuses is cut in parts until the damaged rows stand nearly alone. A row that was cut
keeps its place: what cannot be read is NaN, the last field of a cut row included, since the cut may have
shortened the number. Texts of columns in which nobody needs numbers are kept as labels.
"""

import codecs
import gzip
import logging
import re
import zlib
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from io import BufferedReader
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from softfuse.errors import RecordingError
from softfuse.hardware.table.dialect import Dialect, is_comment
from softfuse.hardware.table.form import MISSING, missing, number

logger = logging.getLogger(__name__)

HEAD = 1 << 18
"""Bytes of the first block, which tells how the file is written."""
BLOCK = 1 << 21
LONGEST_LINE = 1 << 17
_BOMS = (
    *((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF32_LE, "utf-32"), (codecs.BOM_UTF32_BE, "utf-32")),
    *((codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16")),
)
_AT_ONCE = 1 << 13
"""Bytes that a damage may cost."""
_ZEROS_OF_UTF16 = 0.4
_PARTS = 8
_TIME = -1
"""The number of the column of the time; those of channels are counted from 0."""
_BY_HAND = 64
"""Lines that are not worth another try."""
_MOST_LABELS = 10_000
"""Different texts in a column, beyond which they are no names and not kept."""
_NULLS = sorted({*MISSING, *(text.upper() for text in MISSING), "NaN", "None"})


class TextBlocks:
    """A text file to be gone through once.

    Raises RecordingError when it cannot be opened, is no text, or (while going through it) a line is too long
    for any table.
    """

    def __init__(self, path: Path, encoding: str | None):
        """encoding: Python's name for how it is written; None: it is found."""
        self.path, self.complete = path, True
        try:
            # Closed by whoever has gone through it.
            self._stream = gzip.open(path, "rb") if path.suffix == ".gz" else path.open("rb")  # noqa: SIM115
        except OSError as error:
            raise RecordingError(f"cannot open the recording {path}: {error.strerror or error}") from error
        self._encoding = encoding

    def __iter__(self) -> Iterator[bytes]:
        """The blocks, each of which ends with a line's end."""
        rest, counted = b"", 1
        for piece in self._pieces():
            end = piece.rfind(b"\n") + 1
            block, rest = rest + piece[:end], (piece[end:] if end else rest + piece)
            longest = max(map(len, block.split(b"\n"))) if len(block) > LONGEST_LINE else 0
            if max(longest, len(rest)) > LONGEST_LINE:
                raise RecordingError(
                    f"{self.path} is no table of numbers: after line {counted} comes one of more than "
                    f"{LONGEST_LINE} bytes"
                )
            if end:
                counted += block.count(b"\n")
                yield block
        if rest:
            yield rest + b"\n"

    def _pieces(self) -> Iterator[bytes]:
        with closing(self._stream) as stream:
            head = self._read(stream, HEAD)
            if head.startswith(b"PK\x03\x04"):
                raise RecordingError(f"{self.path} is no text but an archive or a workbook: export it as CSV")
            encoding = self._encoding or _encoding(head)
            utf8 = codecs.lookup(encoding).name == "utf-8"
            decoder = codecs.getincrementaldecoder(encoding)(errors="replace")
            # UTF-8 as it is: whole lines stay whole, and what is damaged is the reader's to judge.
            first = head if utf8 else decoder.decode(head).encode()
            old_mac = b"\n" not in first and b"\r" in first
            piece = first
            while piece:
                yield piece.replace(b"\r", b"\n") if old_mac else piece
                raw = self._read(stream, BLOCK)
                piece = raw if utf8 else decoder.decode(raw, final=not raw).encode()

    def _read(self, stream: "BufferedReader | gzip.GzipFile", count: int) -> bytes:
        """So many bytes, fewer at the end; what comes before a damage is kept."""
        pieces, left = list[bytes](), count
        try:
            while left > 0 and (piece := stream.read1(min(left, _AT_ONCE))):
                pieces.append(piece)
                left -= len(piece)
        except gzip.BadGzipFile as error:
            if not pieces and stream.tell() == 0:
                raise RecordingError(f"{self.path} is not a gzip file: {error}") from error
            self._cut(error)
        except (EOFError, OSError, zlib.error) as error:
            self._cut(error)
        return b"".join(pieces)

    def _cut(self, error: Exception) -> None:
        if self.complete:
            logger.warning("%s ends early: %s", self.path, error)
        self.complete = False


def _encoding(head: bytes) -> str:
    for mark, name in _BOMS:
        if head.startswith(mark):
            return name
    half = max(len(head) // 2, 1)
    for name, zeros in (("utf-16-le", head[1::2].count(0)), ("utf-16-be", head[0::2].count(0))):
        if zeros > _ZEROS_OF_UTF16 * half:
            return name
    try:
        head.decode()
    except UnicodeDecodeError as error:
        # A header in UTF-8 above damaged rows stays what it is; one without any sign of it may be either.
        if error.end < len(head) and head[: error.start].isascii():
            return "cp1252"
    return "utf-8"


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
