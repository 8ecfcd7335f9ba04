"""Descriptions: round trips, and payloads that are none."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from softfuse.errors import WireError
from softfuse.hardware.wire.description import Channel, Description, RawType, parse_description
from softfuse.hardware.wire.message import DescriptionMessage, Header, decode, encode

TWO = Description("pad", (Channel("a", RawType.U8, 1.0, 0.0), Channel("b_V", RawType.F32, 2.0, -1.0)))


@given(data=st.data())
def test_any_description_comes_back(data, descriptions):
    description = data.draw(descriptions)
    assert parse_description(description.payload()) == description
    assert 0 <= description.layout() < 2**16


@given(payload=st.binary(max_size=60))
def test_any_bytes_are_a_description_to_the_byte_or_refused(payload):
    try:
        description = parse_description(payload)
    except WireError as error:
        assert "\n" not in str(error)
    else:
        assert description.payload() == payload


@given(data=st.data())
def test_a_damaged_description_is_another_or_refused(data, descriptions):
    payload = bytearray(data.draw(descriptions).payload())
    payload[data.draw(st.integers(0, len(payload) - 1))] ^= data.draw(st.integers(1, 255))
    try:
        again = parse_description(bytes(payload))
    except WireError:
        return
    assert again.payload() == payload


def test_every_shortened_or_lengthened_description_is_refused():
    payload = TWO.payload()
    for size in range(len(payload)):
        with pytest.raises(WireError, match="ends after|1 to"):
            parse_description(payload[:size])
    with pytest.raises(WireError, match="1 bytes more"):
        parse_description(payload + b"\0")


@pytest.mark.parametrize(
    ("at", "byte", "word"),
    [(4, 0, "within a channel|bytes more"), (6, 9, "unknown type 9"), (1, 0xFF, "not UTF-8")],
)
def test_what_is_wrong_with_a_description_is_said(at, byte, word):
    payload = bytearray(TWO.payload())
    payload[at] = byte
    with pytest.raises(WireError, match=word):
        parse_description(bytes(payload))


def test_a_device_without_a_name_is_refused():
    with pytest.raises(WireError, match="1 to 255 bytes, this one has 0"):
        parse_description(b"\0" + TWO.payload()[4:])


def test_channels_of_one_name_none_and_too_many_are_refused():
    one = Channel("a", RawType.U8, 1.0, 0.0)
    with pytest.raises(WireError, match="two channels 'a'"):
        Description("pad", (one, one))
    with pytest.raises(WireError, match="0 channels"):
        Description("pad", ())
    with pytest.raises(WireError, match="513 channels"):
        Description("pad", tuple(Channel(f"c{k}", RawType.U8, 1.0, 0.0) for k in range(513)))


def test_the_largest_device_fits_into_a_body_and_longer_names_are_refused():
    def named(length: int) -> DescriptionMessage:
        channels = [Channel(f"{k:0{length}d}", RawType.F64, 1.0, 0.0) for k in range(512)]
        return DescriptionMessage(Header(1, 0, 0), Description("x" * 40, tuple(channels)))

    assert decode(encode(named(21))) == named(21)
    with pytest.raises(WireError, match="16384 are possible"):
        encode(named(22))
