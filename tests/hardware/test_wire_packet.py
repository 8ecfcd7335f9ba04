"""Packets found again in streams, whatever happened to them."""

from hypothesis import given
from hypothesis import strategies as st

from softfuse.hardware.wire.message import LONGEST_PACKET, Unpacker, pack

BODIES = st.lists(st.one_of(st.binary(max_size=80), st.binary(min_size=250, max_size=260)), max_size=6)


@given(body=st.one_of(st.binary(max_size=600), st.binary(min_size=252, max_size=256).map(bytes)))
def test_a_packet_has_one_zero_at_its_end(body):
    packet = pack(body)
    assert packet.index(0) == len(packet) - 1 and len(packet) <= len(body) + 2 + (len(body) + 2) // 254 + 2


@given(data=st.data(), bodies=BODIES)
def test_any_bodies_come_back_from_any_pieces(data, bodies, pieces_of):
    unpacker = Unpacker()
    stream = b"".join(map(pack, bodies))
    assert [body for piece in data.draw(pieces_of(stream)) for body in unpacker.feed(piece)] == bodies
    assert unpacker.counts.packets == len(bodies) and unpacker.counts.bytes_discarded == 0


@given(data=st.data(), stream=st.binary(max_size=200))
def test_any_bytes_are_accounted_for_and_pieces_do_not_matter(data, stream, pieces_of):
    packets = data.draw(st.lists(st.binary(max_size=20).map(pack), max_size=3))
    stream = b"".join([stream, *packets, stream[: len(stream) // 2]])
    whole, cut = Unpacker(), Unpacker()
    bodies = whole.feed(stream)
    assert [body for piece in data.draw(pieces_of(stream)) for body in cut.feed(piece)] == bodies
    assert cut.counts == whole.counts
    whole.discard_partial()
    counts = whole.counts
    taken = sum(len(pack(body)) - 1 for body in bodies)
    # A body can be written in COBS in two ways, where a block of 254 bytes ends it; not in so few bytes.
    assert taken + counts.bytes_discarded + stream.count(0) == len(stream)
    some = [piece for piece in stream.split(b"\0")[:-1] if piece]
    assert len(some) == counts.packets + counts.crc_failures + counts.cobs_failures + counts.oversized


def test_each_failure_has_its_count_and_the_next_packet_is_found():
    good = pack(b"good")
    wrong_crc = bytes([good[0], good[1] ^ 1]) + good[2:]
    for bad, count in (
        (wrong_crc, "crc_failures"),
        (b"\x09abc\0", "cobs_failures"),
        (b"\x02a\0", "crc_failures"),
    ):
        unpacker = Unpacker()
        assert unpacker.feed(bad + good) == [b"good"]
        assert getattr(unpacker.counts, count) == 1 and unpacker.counts.packets == 1
        assert unpacker.counts.bytes_discarded == len(bad) - 1


def test_the_longest_packet_is_held_and_a_longer_one_is_not():
    longest = pack(bytes([1]) * 16384)
    assert len(longest) == LONGEST_PACKET + 1
    assert Unpacker().feed(longest) == [bytes([1]) * 16384]
    unpacker = Unpacker()
    assert unpacker.feed(pack(bytes([1]) * 16385)) == [] and unpacker.counts.oversized == 1
    unpacker = Unpacker()
    for _ in range(1000):
        assert unpacker.feed(b"\x01" * 1000) == []
        assert len(unpacker._partial) <= LONGEST_PACKET
    assert unpacker.feed(b"\0" + pack(b"good")) == [b"good"]
    assert unpacker.counts.oversized == 1 and unpacker.counts.bytes_discarded == 1_000_000


def test_a_partial_packet_is_forgotten_after_an_interruption():
    unpacker = Unpacker()
    good = pack(b"good")
    unpacker.feed(good[:4])
    unpacker.discard_partial()
    assert unpacker.feed(good) == [b"good"] and unpacker.counts.bytes_discarded == 4
