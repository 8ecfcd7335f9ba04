"""What a session holds besides chunks and notices: frames, estimates, and what is known before them."""

import importlib.metadata
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Float

from softfuse.errors import RecordingError

Kind = Literal["number", "string"]
FRAME_FIELDS = ("index", "time_s")
"""What every frame has besides its channels, and no channel may be named."""
ESTIMATE_FIELDS = ("frame", "sensed", "time_s", "status", "latency_ms", "end_to_end_ms")
"""What every estimate has besides its columns, and no column may be named."""

MOST_NAMES = 65536
"""Channels, and columns of estimates, of a session."""


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
