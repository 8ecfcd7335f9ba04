"""What the tests of the wire share: arbitrary descriptions and messages, and streams cut into pieces."""

from collections.abc import Callable

import pytest
from hypothesis import strategies as st

from softfuse.hardware.wire.description import Channel, Description, Layout, RawType
from softfuse.hardware.wire.message import (
    AskMessage,
    DescriptionMessage,
    Header,
    Message,
    SampleMessage,
    TextMessage,
)

NAMES = st.text(
    st.characters(codec="utf-8", categories=("L", "N", "P", "S"), exclude_characters=",;\"'"),
    min_size=1,
    max_size=12,
).filter(lambda name: name != "time_s")
SINGLES = st.floats(width=32, allow_nan=False, allow_infinity=False)
CHANNELS = st.builds(Channel, NAMES, st.sampled_from(RawType), SINGLES.filter(bool), SINGLES)
DESCRIPTIONS = st.builds(
    Description,
    NAMES,
    st.lists(CHANNELS, min_size=1, max_size=20, unique_by=lambda channel: channel.name).map(tuple),
)
HEADERS = st.builds(
    Header, st.integers(0, 65534), st.integers(0, 2**32 - 1), st.one_of(st.just(0), st.integers(0, 2**64 - 1))
)


@st.composite
def contents(draw: st.DrawFn, description: Description) -> bytes:
    """Any presence of the channels and any raw values."""
    count = len(description.channels)
    size = (count + 7) // 8
    presence = draw(st.one_of(st.just((1 << count) - 1), st.integers(0, (1 << count) - 1)))
    raw = Layout(description).size - size
    return presence.to_bytes(size, "little") + draw(st.binary(min_size=raw, max_size=raw))


@st.composite
def samples(draw: st.DrawFn, description: Description) -> SampleMessage:
    """Any sample of a device so described."""
    return SampleMessage(draw(HEADERS), description.layout(), draw(contents(description)))


MESSAGES = st.one_of(
    st.builds(DescriptionMessage, HEADERS, DESCRIPTIONS),
    DESCRIPTIONS.flatmap(samples),
    st.builds(TextMessage, HEADERS, st.text(st.characters(codec="utf-8"), max_size=300)),
    st.builds(AskMessage, HEADERS),
)


@pytest.fixture(scope="session")
def descriptions() -> st.SearchStrategy[Description]:
    """Any description of up to 20 channels."""
    return DESCRIPTIONS


@pytest.fixture(scope="session")
def messages() -> st.SearchStrategy[Message]:
    """Any message."""
    return MESSAGES


@pytest.fixture(scope="session")
def contents_of() -> Callable[[Description], st.SearchStrategy[bytes]]:
    """Any content of a description's samples."""
    return contents


@pytest.fixture(scope="session")
def pieces_of() -> Callable[[bytes], st.SearchStrategy[list[bytes]]]:
    """A stream cut anywhere into any number of pieces, empty ones included."""

    def cut(stream: bytes) -> st.SearchStrategy[list[bytes]]:
        places = st.lists(st.integers(0, len(stream)), max_size=12).map(sorted)
        return places.map(lambda at: [stream[a:b] for a, b in zip([0, *at], [*at, len(stream)], strict=True)])

    return cut
