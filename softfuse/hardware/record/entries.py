"""What a session holds besides chunks: frames, estimates, notices and what is known before them, as JSON too,
with the JSON schemas that it obeys.

A number that is missing or not finite is left out of its object: JSON has no NaN, and Foxglove refuses a
schema in which a field may be either a number or null. Numbers are written with the fewest digits that give
back the same 64 bits. Whatever is read here may come from a damaged or hostile file.
"""

import importlib.metadata
import json
import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float

from softfuse.errors import RecordingError
from softfuse.hardware.stream import Chunk, Level, Notice

Kind = Literal["number", "string"]
FRAME_FIELDS = ("index", "time_s")
"""What every frame has besides its channels, and no channel may be named."""
ESTIMATE_FIELDS = ("frame", "sensed", "time_s", "status", "latency_ms", "end_to_end_ms")
"""What every estimate has besides its columns, and no column may be named."""

MOST_NAMES = 65536
"""Channels, and columns of estimates, of a session."""
LONGEST_JSON = 1 << 20
"""Bytes of the longest object that is written or read."""
LEVELS: dict[str, Level] = {level: level for level in get_args(Level)}
_DIALECT = "https://json-schema.org/draft/2020-12/schema"
_NUMBER = {"type": "number"}


@dataclass(frozen=True, eq=False, slots=True)
class FrameEntry:
    """A frame of all devices: its number from 0, its time [s], and n channels."""

    index: int
    time_s: float
    """In seconds since the epoch, or of the recording that it was converted from; NaN where unknown."""
    values: Float[np.ndarray, " n"]
    """(n,) in the order of the session's channels and the units of their names, NaN where missing."""


@dataclass(frozen=True, slots=True)
class EstimateEntry:
    """What was estimated after a frame, which may stand for several."""

    frame: int
    """The index of the last frame that went in."""
    time_s: float
    """The time of that frame [s], NaN where unknown."""
    host_s: float
    """When the estimate was there, in seconds since the epoch."""
    fields: Mapping[str, float | str | None]
    """The session's columns of estimates; None, NaN or left out where unknown."""
    status: tuple[str, ...] = ()
    latency_ms: float | None = None
    """From the frame to the estimate."""
    end_to_end_ms: float | None = None
    """From the last byte to the estimate."""
    sensed: int | None = None
    """So many frames, the last of which is `frame`, went in since the estimate before; earlier ones that did
    not were overrun. None where unknown: all.
    """


Entry = Chunk | FrameEntry | EstimateEntry | Notice
"""What a session is made of."""


@dataclass(frozen=True)
class SourceInfo:
    """Where a source's bytes come from."""

    url: str
    driver: str


@dataclass(frozen=True)
class SessionInfo:
    """What is known before the first byte; RecordingError for names that a session cannot hold."""

    device: str = ""
    """The device's name."""
    command: str = ""
    """What was run."""
    started: str = ""
    """When, in ISO 8601."""
    channels: tuple[str, ...] = ()
    """Names of the frames' channels, which end with their units."""
    estimates: Mapping[str, Kind] = field(default_factory=dict)
    """Columns of the estimates, and whether they hold numbers or text."""
    sources: tuple[SourceInfo, ...] = ()
    config: bytes | None = None
    """The configuration file, as it was."""
    version: str = field(default_factory=lambda: importlib.metadata.version("softfuse"))
    """The version of softfuse that recorded it."""

    def __post_init__(self) -> None:
        _check_names(self.channels, FRAME_FIELDS, "channel")
        _check_names(tuple(self.estimates), ESTIMATE_FIELDS, "estimates' column")


def _check_names(names: tuple[str, ...], taken: tuple[str, ...], what: str) -> None:
    if len(names) > MOST_NAMES:
        raise RecordingError(f"a session cannot hold {len(names)} {what}s: {MOST_NAMES} at most")
    twice = sorted(name for name, count in Counter(names).items() if count > 1)
    if twice:
        raise RecordingError(f"a session cannot hold the {what} {twice[0]!r} twice: rename or drop one")
    for name in names:
        if name in taken:
            raise RecordingError(f"a session cannot hold a {what} named {name!r}, its own: rename it")
        try:
            name.encode()
        except UnicodeEncodeError as error:
            raise RecordingError(f"the {what} {name!r} cannot be written in UTF-8: rename it") from error


def frame_schema(info: SessionInfo) -> bytes:
    """The schema of a session's frames."""
    fields = {
        "index": {"type": "integer", "minimum": 0, "description": "number of the frame, from 0"},
        "time_s": {"type": "number", "description": "time of the frame [s], left out where unknown"},
        **{name: _NUMBER for name in info.channels},
    }
    return _schema("A frame; channels that were not read are left out", fields, ["index"])


def estimate_schema(info: SessionInfo) -> bytes:
    """The schema of a session's estimates."""
    fields = {
        "frame": {"type": "integer", "minimum": 0, "description": "index of the last frame that went in"},
        "sensed": {"type": "integer", "minimum": 1, "description": "so many, up to that one, went in"},
        "time_s": {"type": "number", "description": "time of that frame [s]"},
        **{name: {"type": kind} for name, kind in info.estimates.items()},
        "status": {"type": "array", "items": {"type": "string"}},
        "latency_ms": {"type": "number", "description": "from the frame to the estimate"},
        "end_to_end_ms": {"type": "number", "description": "from the last byte to the estimate"},
    }
    return _schema("An estimate; what is unknown is left out", fields, ["frame", "status"])


def notice_schema() -> bytes:
    """The schema of notices."""
    fields = {
        "level": {"type": "string", "enum": list(LEVELS)},
        "source": {"type": "integer", "minimum": 0, "description": "left out when about all"},
        "text": {"type": "string"},
    }
    return _schema("Something that people should know", fields, ["level", "text"])


def _schema(title: str, properties: dict[str, Any], required: list[str]) -> bytes:
    schema = {
        "$schema": _DIALECT,
        "title": title,
        "type": "object",
        "properties": properties,
        "required": required,
        "additionalProperties": False,
    }
    return json.dumps(schema, ensure_ascii=False).encode()


class FrameFormat:
    """Writes and reads the frames of n channels."""

    def __init__(self, channels: tuple[str, ...]) -> None:
        self._channels = channels
        self._keys = [f",{json.dumps(name, ensure_ascii=False)}:" for name in channels]

    def write(self, entry: FrameEntry) -> bytes:
        """The frame's JSON; ValueError when it has not the session's n channels."""
        numbers = [
            key + repr(value)
            for key, value in zip(self._keys, entry.values.tolist(), strict=True)
            if math.isfinite(value)
        ]
        time = f',"time_s":{float(entry.time_s)!r}' if math.isfinite(entry.time_s) else ""
        return f'{{"index":{entry.index:d}{time}{"".join(numbers)}}}'.encode()

    def read(self, data: bytes) -> FrameEntry:
        """The frame in a JSON text; RecordingError when it holds none."""
        found = parse_object(data)
        values = np.array([_number(found, name) for name in self._channels], dtype=float)
        return FrameEntry(_index(found, "index"), _number(found, "time_s"), values)


class EstimateFormat:
    """Writes and reads the estimates of a session's columns."""

    def __init__(self, columns: Mapping[str, Kind]) -> None:
        self._columns = dict(columns)

    def write(self, entry: EstimateEntry) -> bytes:
        """The estimate's JSON; ValueError for a field that is no column of the session or not of its kind."""
        unknown = sorted(entry.fields.keys() - self._columns.keys())
        if unknown:
            raise ValueError(f"the session has no column of estimates named {unknown[0]!r}")
        found: dict[str, Any] = {"frame": int(entry.frame)}
        _put(found, "sensed", entry.sensed)
        _put(found, "time_s", entry.time_s)
        for name, kind in self._columns.items():
            value = entry.fields.get(name)
            if value is None:
                continue
            if (kind == "string") != isinstance(value, str):
                raise ValueError(f"the column {name!r} of the estimates holds a {kind}, not {value!r}")
            _put(found, name, value)
        found["status"] = [str(status) for status in entry.status]
        _put(found, "latency_ms", entry.latency_ms)
        _put(found, "end_to_end_ms", entry.end_to_end_ms)
        return _dump(found)

    def read(self, data: bytes, host_s: float) -> EstimateEntry:
        """The estimate in a JSON text, which was there at host_s [s]; RecordingError when it holds none.

        Its fields are all the session's columns, None where unknown.
        """
        found = parse_object(data)
        status = found.get("status", [])
        if not isinstance(status, list):
            raise RecordingError("the status of an estimate is no list")
        return EstimateEntry(
            frame=_index(found, "frame"),
            time_s=_number(found, "time_s"),
            host_s=host_s,
            fields={
                name: _text(found, name) if kind == "string" else _known(found, name)
                for name, kind in self._columns.items()
            },
            status=tuple(_clean(word) for word in status if isinstance(word, str)),
            latency_ms=_known(found, "latency_ms"),
            end_to_end_ms=_known(found, "end_to_end_ms"),
            sensed=_index(found, "sensed") if "sensed" in found else None,
        )


def write_notice(notice: Notice) -> bytes:
    """The notice's JSON."""
    about = {} if notice.source is None else {"source": int(notice.source)}
    return _dump({"level": notice.level, **about, "text": notice.text})


def read_notice(data: bytes, host_s: float) -> Notice:
    """The notice in a JSON text of the host's time host_s [s]; RecordingError when it holds none."""
    found = parse_object(data)
    level, text = LEVELS.get(str(found.get("level"))), _text(found, "text")
    if level is None or text is None:
        raise RecordingError("a notice lacks its level or its text")
    return Notice(host_s, _index(found, "source") if "source" in found else None, level, text)


def parse_object(data: bytes) -> dict[str, Any]:
    """The JSON object in a text; RecordingError when it is none, is too long or too deep."""
    found = parse_json(data)
    if not isinstance(found, dict):
        raise RecordingError("an entry is no JSON object")
    return found


def parse_json(data: bytes) -> Any:
    """The JSON value in a text; RecordingError when it is none, is too long or too deep."""
    if len(data) > LONGEST_JSON:
        raise RecordingError(f"an entry has {len(data)} bytes, more than the {LONGEST_JSON} that are read")
    try:
        return json.loads(data, parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        raise RecordingError(f"an entry is not JSON: {error}") from error


def _no_number(name: str) -> float:
    raise RecordingError(f"{name} is not JSON")


def _put(found: dict[str, Any], name: str, value: float | str | None) -> None:
    """Add what is known; whole numbers stay whole."""
    if isinstance(value, str):
        found[name] = value
    elif value is not None and math.isfinite(value):
        found[name] = int(value) if isinstance(value, int | np.integer) else float(value)


def _dump(found: dict[str, Any]) -> bytes:
    # A device's text may hold half a surrogate pair, which UTF-8 has no bytes for.
    return json.dumps(found, ensure_ascii=False, allow_nan=False).encode(errors="replace")


def _number(found: dict[str, Any], name: str) -> float:
    """The finite number of a field, NaN where it is missing or no such number."""
    value = found.get(name)
    if not isinstance(value, int | float) or isinstance(value, bool):
        return math.nan
    try:
        value = float(value)
    except OverflowError:
        return math.nan
    return value if math.isfinite(value) else math.nan


def _known(found: dict[str, Any], name: str) -> float | None:
    """The number of a field, whole where it was written so, None where it is missing."""
    value, number = found.get(name), _number(found, name)
    if math.isnan(number):
        return None
    return value if isinstance(value, int) else number


def _text(found: dict[str, Any], name: str) -> str | None:
    value = found.get(name)
    return _clean(value) if isinstance(value, str) else None


def _clean(text: str) -> str:
    return text.encode(errors="replace").decode()


def _index(found: dict[str, Any], name: str) -> int:
    value = found.get(name)
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < 1 << 63:
        raise RecordingError(f"an entry has no {name!r} that counts from 0")
    return value
