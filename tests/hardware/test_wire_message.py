"""Messages and their bodies."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from softfuse.errors import WireError
from softfuse.hardware.wire.message import AskMessage, Header, SampleMessage, TextMessage, decode, encode


@given(data=st.data())
def test_any_message_comes_back(data, messages):
    message = data.draw(messages)
    assert decode(encode(message)) == message


@given(data=st.data())
def test_any_body_is_a_message_to_the_byte_or_refused(data, messages):
    body = bytearray(encode(data.draw(messages)))
    for _ in range(data.draw(st.integers(1, 3))):
        body[data.draw(st.integers(0, len(body) - 1))] = data.draw(st.integers(0, 255))
    body = bytes(body[: data.draw(st.one_of(st.just(len(body)), st.integers(0, len(body))))])
    try:
        message = decode(body)
    except WireError as error:
        assert "\n" not in str(error)
    else:
        assert encode(message) == body


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (b"", "0 bytes, a header has 16"),
        (b"\x01\x02" + bytes(13), "15 bytes"),
        (b"\x02\x02" + bytes(14), "version 2"),
        (b"\x01\x05" + bytes(14), "unknown kind 5"),
        (b"\x01\x00" + bytes(14), "unknown kind 0"),
        (b"\x01\x02" + bytes(15), "payload of a sample has 1 bytes"),
        (b"\x01\x03" + bytes(14) + b"\xff", "not UTF-8"),
        (b"\x01\x04" + bytes(15), "no payload"),
    ],
)
def test_bodies_that_are_no_messages_say_why(body, words):
    with pytest.raises(WireError, match=words):
        decode(body)


@pytest.mark.parametrize(
    "message",
    [
        AskMessage(Header(65536, 0, 0)),
        AskMessage(Header(0, 2**32, 0)),
        AskMessage(Header(0, 0, -1)),
        SampleMessage(Header(0, 0, 0), 65536, b""),
    ],
)
def test_numbers_that_do_not_fit_are_refused(message):
    with pytest.raises(WireError, match="does not fit"):
        encode(message)


def test_the_longest_text_and_one_byte_more():
    header = Header(0, 0, 0)
    assert len(encode(TextMessage(header, "x" * 16368))) == 16384
    with pytest.raises(WireError, match="16385 bytes"):
        encode(TextMessage(header, "x" * 16369))
