"""A table of readings that is gone through once, in blocks of frames: time and a column for each channel."""

import logging
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import NoReturn

import numpy as np
from jaxtyping import Int

from softfuse.errors import RecordingError
from softfuse.hardware.table.dialect import Dialect, find_dialect, find_time, time_column, time_name
from softfuse.hardware.table.form import number
from softfuse.hardware.table.long import Pivot, Readings, long_columns
from softfuse.hardware.table.rows import Block, RowReader, TextBlocks
from softfuse.robot.recording import RecordingSettings

logger = logging.getLogger(__name__)

TIME = "time_s"
_LISTED = 40


class Table:
    """A table whose header has been read; without the column of the time where none is wanted (`timed`)."""

    def __init__(self, path: Path, required: Sequence[str], told: RecordingSettings, *, timed: bool = True):
        """required: names of channels of which every row should have a number.

        Raises RecordingError, which says what is missing and what there is, when the file cannot be read, has
        no header, names a channel twice, lacks one that is required or was told, or the time.
        """
        self.path, self._told = path, told
        self._text = TextBlocks(path, told.encoding)
        blocks = iter(self._text)
        first = next(blocks, b"")
        if not first.strip():
            raise RecordingError(f"the recording {path} is empty: its first line must name the columns")
        wanted = {*told.columns, *required, told.time, told.id, told.value}
        dialect = find_dialect(first, told, wanted, time_name if timed else lambda _: False)
        if not dialect.names:
            raise RecordingError(f"{path} starts with numbers: its first line must name the columns")
        self._line = dialect.start + 1
        self._blocks = chain(first.split(b"\n", dialect.start)[dialect.start :], blocks)
        place = find_time(dialect.names, told) if timed else None
        self._per_second = 1.0
        # The time and a column that a rate makes up for are no channels; only the time is read.
        read_time = place if told.rate is None else None
        if read_time is not None:
            self._per_second = self._unit(dialect, read_time)
        elif timed and told.rate is None:
            self._refuse([told.time or TIME], dialect.names)
        self._long: _Long | None = None
        long = self._long_places(dialect, place, required)
        if long is not None:
            self._reader = RowReader(dialect, read_time, long, long[1:])
            head = [*self._rows(next(self._blocks, b""))]
            self._long = _Long(self._reader, told, head, required)
            self._head, self.channels = head, tuple(self._long.channels)
            return
        self._head = []
        named = [(k, name) for k, name in enumerate(dialect.names) if name and k != place]
        self.channels = tuple(told.columns.get(name, name) for _, name in named)
        """The names of the channels."""
        lacking = [name for name in told.columns if name not in dialect.names]
        made = {told.columns[name] for name in lacking}
        lacking += [name for name in required if name not in self.channels and name not in made]
        if lacking:
            self._refuse(lacking, dialect.names)
        twice = sorted({name for name in self.channels if self.channels.count(name) > 1})
        if twice:
            raise RecordingError(
                f"the recording {path} names the column {twice[0]!r} twice: rename or drop one"
            )
        needed = [k for (k, _), name in zip(named, self.channels, strict=True) if name in set(required)]
        self._reader = RowReader(dialect, read_time, [k for k, _ in named], needed)

    @property
    def complete(self) -> bool:
        """False where a compressed file turned out to end early."""
        return self._text.complete

    @property
    def labels(self) -> dict[int, list[str]]:
        """The texts that have been found so far, by the channel's number."""
        found = {} if self._long is not None else self._reader.labels
        return {c: list(texts) for c, texts in found.items()}

    @property
    def worded(self) -> frozenset[int]:
        """The channels of whose first fields some are texts and none is a number, by number."""
        return frozenset(() if self._long is not None else self._reader.worded)

    def blocks(self) -> Iterator[Block]:
        """The frames; RecordingError where a line is too long for any table, or at the end of a long table
        without a channel that is required.
        """
        count = 0
        for block in self._untimed():
            if self._told.rate is not None:
                block.time_s = (count + np.arange(len(block.line))) / self._told.rate
            count += len(block.line)
            yield block

    def _untimed(self) -> Iterator[Block]:
        for rows in chain(self._head, chain.from_iterable(map(self._rows, self._blocks))):
            rows.time_s = rows.time_s / self._per_second
            yield rows if self._long is None else self._long.block(rows)
        if self._long is not None:
            yield self._long.end()
            if self._long.absent:
                self._refuse(self._long.absent, [n for n in self.channels if n not in self._long.absent])

    def _rows(self, block: bytes) -> Iterator[Block]:
        line, self._line = self._line, self._line + block.count(b"\n")
        yield from self._reader.read(block, line) if block else ()

    def _unit(self, dialect: Dialect, place: int) -> float:
        """Units of the time per second."""
        sampled = (number(row[place], dialect.decimal) for row in dialect.sample if place < len(row))
        first = [np.nan if value is None else value for value in sampled]
        name = dialect.names[place]
        if first and not np.isfinite(first).any():
            text = dialect.sample[0][place] if place < len(dialect.sample[0]) else ""
            raise RecordingError(
                f"the recording {self.path} has no numbers in the column {name!r} of the time but {text!r}: "
                'name another by time = "...", or tell the rate, in [recording]'
            )
        found = time_column(place, name, dialect.units, first, self._told)
        if found.remark is not None:
            logger.warning("%s: %s in [recording]", self.path, found.remark)
        return found.per_second

    def _long_places(
        self, dialect: Dialect, time: int | None, required: Sequence[str]
    ) -> tuple[int, int] | None:
        """The fields of channel and value where a row is a reading, else None."""
        told = self._told
        if told.layout == "wide":
            return None
        names = dialect.names
        found = long_columns(names, {"id": told.id, "value": told.value}, time)
        if told.layout == "long" or told.id is not None:
            if found is None:
                columns = told.id or "id", told.value or "value"
                self._refuse([name for name in columns if name not in names] or columns, names)
            return found
        if found is None or any(name in names for name in (*required, *told.columns)):
            return None
        ids = [row[found[0]] for row in dialect.sample if found[0] < len(row)]
        return found if 2 * len(set(ids)) <= len(ids) else None

    def _refuse(self, missing: Sequence[str], names: Sequence[str]) -> NoReturn:
        """Raise the error of columns that are not there."""
        listed = ", ".join(repr(name) for name in missing)
        noun = "column" if len(missing) == 1 else "columns"
        there = [name for name in names if name]
        message = f"the recording {self.path} lacks the {noun} {listed}; it has: {', '.join(there[:_LISTED])}"
        if len(there) > _LISTED:
            message += f" and {len(there) - _LISTED} more"
        if len(there) == 1:
            message += "; is that one column? If not, tell the separator, in [recording]"
        elif list(missing) == [self._told.time or TIME]:
            message += '; name the time by time = "...", or tell the rate, in [recording]'
        raise RecordingError(message)


class _Long:
    """Rows of readings as frames of the channels that are required or come among the first rows."""

    def __init__(
        self, reader: RowReader, told: RecordingSettings, head: Sequence[Block], required: Sequence[str]
    ):
        self._reader, self._told = reader, told
        names = [self._name(text) for rows in head for text in self._texts(rows)]
        self.channels = list(dict.fromkeys([*names, *required]))
        self._number = {name: c for c, name in enumerate(self.channels)}
        self._pivot = Pivot(len(self.channels))
        self._unknown = set[str]()
        self.absent = [name for name in required if name not in names]
        """Channels that are required and have not come yet."""

    def block(self, rows: Block) -> Block:
        channel = np.full(len(rows.line), -1)
        for text, at in self._texts(rows).items():
            name = self._name(text)
            channel[at] = self._number.get(name, -1)
            if name in self.absent:
                self.absent.remove(name)
            if name not in self._number and name not in self._unknown:
                self._unknown.add(name)
                logger.warning(
                    "the channel %r, which first comes in line %d, is left out", name, rows.line[at][0]
                )
        read = Readings(rows.time_s, channel, rows.values[1], rows.line, rows.malformed)
        return self._pivot.add(read)

    def end(self) -> Block:
        return self._pivot.end()

    def _name(self, text: str) -> str:
        return self._told.columns.get(text, text)

    def _texts(self, rows: Block) -> dict[str, Int[np.ndarray, " k"]]:
        """The channels' texts in some rows, in the order of their coming, and in which rows each stands."""
        numbers = rows.values[0]
        texts = list(self._reader.labels.get(0, {}))
        codes = rows.labels.get(0, np.full(len(rows.line), -1))
        found = {texts[code]: np.flatnonzero(codes == code) for code in np.unique(codes[codes >= 0])}
        for value in np.unique(numbers[np.isfinite(numbers)]):
            found[f"{value:g}"] = np.flatnonzero(numbers == value)
        return dict(sorted(found.items(), key=lambda one: one[1][0]))
