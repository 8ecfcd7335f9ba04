"""From bytes to messages and values."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softfuse.hardware.wire.decoder import MOST_DEVICES, Decoder
from softfuse.hardware.wire.description import Channel, Description, Layout, RawType
from softfuse.hardware.wire.message import (
    AskMessage,
    DescriptionMessage,
    Header,
    SampleMessage,
    TextMessage,
    encode,
    pack,
)


def device_of(scale: float) -> Description:
    """A device with three channels."""
    return Description("pad", tuple(Channel(f"c{k}", RawType.I16, scale, 0.0) for k in range(3)))


def described(number: int, description: Description) -> bytes:
    return pack(encode(DescriptionMessage(Header(number, 0, 0), description)))


def sample(number: int, description: Description, values: list[float], *, sequence: int = 0) -> bytes:
    layout = Layout(description)
    content = layout.content(np.array(values))
    return pack(encode(SampleMessage(Header(number, sequence, 10), layout.number, content)))


@settings(max_examples=60)
@given(data=st.data())
def test_any_messages_come_back_from_any_pieces(data, messages, pieces_of):
    sent = data.draw(st.lists(messages, max_size=5))
    # Random contents of random descriptions need not fit; these samples stay undescribed.
    sent = [m for m in sent if not isinstance(m, DescriptionMessage)] + [
        m for m in sent if isinstance(m, DescriptionMessage)
    ]
    stream = b"".join(pack(encode(message)) for message in sent)
    decoder = Decoder()
    received = []
    for k, piece in enumerate(data.draw(pieces_of(stream))):
        arrived = decoder.feed(piece, float(k))
        assert {one.host_s for one in arrived} <= {float(k)}
        received += arrived
    assert [one.message for one in received] == sent
    counts = decoder.counts
    assert counts.line.packets == len(sent) and counts.malformed == 0


@given(data=st.data())
def test_any_sample_of_any_described_device_has_its_values(data, descriptions, contents_of):
    description = data.draw(descriptions)
    content = data.draw(contents_of(description))
    message = SampleMessage(Header(3, 9, 9), description.layout(), content)
    decoder = Decoder()
    decoder.feed(described(3, description), 0.0)
    (received,) = decoder.feed(pack(encode(message)), 1.0)
    np.testing.assert_array_equal(received.values, Layout(description).values(content))


@given(
    bodies=st.lists(st.binary(max_size=60), max_size=8), start=st.sampled_from([b"", b"\1", b"\1\1", b"\1\2"])
)
def test_any_bodies_with_the_right_crc_are_accounted_for(bodies, start):
    decoder = Decoder()
    decoder.feed(described(0, device_of(1.0)), 0.0)
    received = decoder.feed(b"".join(pack(start + body) for body in bodies), 0.0)
    counts = decoder.counts
    refused = counts.malformed + counts.unknown_version + counts.unknown_kind
    assert len(received) + 1 + refused == counts.line.packets == len(bodies) + 1


def test_a_sample_before_its_description_is_handed_on_without_values():
    device, decoder = device_of(0.5), Decoder()
    early, _, late = decoder.feed(
        sample(1, device, [1, 2, 3]) + described(1, device) + sample(1, device, [1, 2, np.nan]), 0.0
    )
    assert early.values is None and early.message.content
    np.testing.assert_array_equal(late.values, [1, 2, np.nan])
    assert (decoder.counts.samples, decoder.counts.undescribed) == (2, 1)


def test_a_device_that_changes_is_read_by_its_new_description_only():
    old, new, decoder = device_of(0.5), device_of(2.0), Decoder()
    stream = described(1, old) + described(1, new) + sample(1, old, [1, 2, 3]) + sample(1, new, [2, 4, 6])
    *_, stale, fresh = decoder.feed(stream, 0.0)
    assert stale.values is None and fresh.values.tolist() == [2, 4, 6]
    assert decoder.descriptions == {1: new}


def test_devices_on_one_line_are_told_apart():
    decoder = Decoder()
    stream = described(1, device_of(0.5)) + described(2, device_of(2.0))
    stream += sample(2, device_of(2.0), [2, 4, 6]) + sample(1, device_of(0.5), [1, 2, 3])
    *_, two, one = decoder.feed(stream, 0.0)
    assert (two.message.header.device, two.values.tolist()) == (2, [2, 4, 6])
    assert (one.message.header.device, one.values.tolist()) == (1, [1, 2, 3])


@pytest.mark.parametrize(
    ("body", "count"),
    [
        (b"", "malformed"),
        (b"\x01", "malformed"),
        (b"\x02", "unknown_version"),
        (b"\x02\x02" + bytes(30), "unknown_version"),
        (b"\x01\x09" + bytes(30), "unknown_kind"),
        (b"\x01\x01" + bytes(30), "malformed"),
        (b"\x01\x04" + bytes(15), "malformed"),
    ],
)
def test_messages_that_cannot_be_read_have_their_count(body, count):
    decoder = Decoder()
    assert decoder.feed(pack(body), 0.0) == []
    assert getattr(decoder.counts, count) == 1 and decoder.counts.line.packets == 1


def test_a_sample_that_does_not_fit_its_layout_is_malformed():
    device, decoder = device_of(1.0), Decoder()
    decoder.feed(described(1, device), 0.0)
    message = SampleMessage(Header(1, 0, 0), device.layout(), b"\x07" + bytes(5))
    assert decoder.feed(pack(encode(message)), 0.0) == []
    assert decoder.counts.malformed == 1


def test_as_many_devices_as_are_remembered():
    decoder = Decoder()
    for number in range(MOST_DEVICES):
        decoder.feed(described(number, device_of(1.0)), 0.0)
    decoder.feed(described(0, device_of(1.0)) + described(60000, device_of(1.0)), 0.0)
    assert len(decoder.descriptions) == MOST_DEVICES
    assert 0 in decoder.descriptions and 60000 in decoder.descriptions and 1 not in decoder.descriptions


def test_remarks_and_questions_pass_and_an_interruption_forgets_a_begun_packet_only():
    device, decoder = device_of(1.0), Decoder()
    remark = TextMessage(Header(1, 0, 0), "Kabel ab – ?")
    decoder.feed(described(1, device) + pack(encode(remark))[:5], 0.0)
    decoder.discard_partial()
    stream = (
        pack(encode(remark)) + pack(encode(AskMessage(Header(65535, 0, 0)))) + sample(1, device, [1, 2, 3])
    )
    text, ask, last = decoder.feed(stream, 0.0)
    assert text.message == remark and ask.message == AskMessage(Header(65535, 0, 0))
    assert last.values.tolist() == [1, 2, 3] and decoder.counts.line.bytes_discarded == 5
