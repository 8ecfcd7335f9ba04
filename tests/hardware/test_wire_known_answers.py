"""The protocol to the byte, written out by hand: it cannot change unnoticed."""

import numpy as np
import pytest

from softfuse.hardware.wire.decoder import Decoder
from softfuse.hardware.wire.description import Channel, Description, Layout, RawType
from softfuse.hardware.wire.message import (
    AskMessage,
    DescriptionMessage,
    Header,
    SampleMessage,
    TextMessage,
    decode,
    encode,
    pack,
)

ARM = Description("arm", (Channel("f_V", RawType.U16, 0.5, -1.0),))
"""Device 7 of the specification's example."""

DESCRIBED_BODY = bytes.fromhex(
    "01 01 0700 00000000 40420f0000000000"  # version, kind, device, sequence, 1,000,000 µs
    "03 61726d"  # "arm"
    "0100"  # one channel
    "03 0000003f 000080bf 03 665f56"  # u16, scale 0.5, offset -1, "f_V"
)
SAMPLE_BODY = bytes.fromhex(
    "01 02 0700 00000000 50690f0000000000"  # 1,010,000 µs
    "d1b3"  # layout
    "01"  # channel 0 was read
    "0201"  # 258
)


def crc_by_bits(data: bytes) -> int:
    """CRC-16/IBM-3740 as the polynomial division that it is."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ (0x1021 if crc & 0x8000 else 0)
            crc &= 0xFFFF
    return crc


def cobs_by_blocks(data: bytes) -> bytes:
    """COBS as its definition has it: a zero is added, then each block up to a zero becomes its length and
    itself; 254 bytes without a zero become 255 and themselves, without any zero.
    """
    encoded, rest = b"", data + b"\0"
    while rest:
        block = rest[:254].split(b"\0")[0]
        encoded += bytes([len(block) + 1]) + block
        rest = rest[254:] if len(block) == 254 else rest[len(block) + 1 :]
        if len(block) == 254 and rest == b"\0":
            break
    return encoded


def test_the_check_value_of_the_crc():
    assert crc_by_bits(b"123456789") == 0x29B1


def test_a_description_to_the_byte():
    message = DescriptionMessage(Header(7, 0, 1_000_000), ARM)
    assert encode(message) == DESCRIBED_BODY
    assert decode(DESCRIBED_BODY) == message
    assert ARM.layout() == crc_by_bits(DESCRIBED_BODY[16:]) == 0xB3D1


def test_a_sample_to_the_byte():
    message = SampleMessage(Header(7, 0, 1_010_000), 0xB3D1, bytes.fromhex("01 0201"))
    assert encode(message) == SAMPLE_BODY
    assert decode(SAMPLE_BODY) == message
    layout = Layout(ARM)
    assert layout.number == 0xB3D1
    assert layout.content(np.array([128.0])) == bytes.fromhex("01 0201")
    np.testing.assert_array_equal(layout.values(bytes.fromhex("01 0201")), [0.5 * 258 - 1])


def test_a_remark_and_a_question_to_the_byte():
    remark = bytes.fromhex("01 03 0700 feffffff 0000000001000000 c3a9")
    assert encode(TextMessage(Header(7, 2**32 - 2, 2**32), "é")) == remark
    question = bytes.fromhex("01 04 ffff 00000000 0000000000000000")
    assert encode(AskMessage(Header(65535, 0, 0))) == question


def test_the_packets_on_the_line_to_the_byte():
    assert pack(DESCRIBED_BODY) == bytes.fromhex(
        "04 010107 01 01 01 01 04 40420f 01 01 01 01 06 0361726d 01 02 03 01 01 02 3f 01 09 80bf03665f56 54ff"
        "00"
    )
    assert pack(SAMPLE_BODY) == bytes.fromhex(
        "04 010207 01 01 01 01 04 50690f 01 01 01 01 08 d1b3 01 0201 f169 00"
    )
    for body in (DESCRIBED_BODY, SAMPLE_BODY, b"", bytes(300), bytes([1] * 252), bytes([1] * 600)):
        expected = cobs_by_blocks(body + crc_by_bits(body).to_bytes(2, "little")) + b"\0"
        assert pack(body) == expected


@pytest.mark.parametrize(
    ("data", "encoded"),
    [
        (b"", "01"),
        (b"\0", "01 01"),
        (b"\x11\x22\x00\x33", "03 1122 02 33"),
        (b"\x11" * 254, "ff" + "11" * 254),
        (b"\x11" * 255, "ff" + "11" * 254 + "02 11"),
        (b"\x11" * 254 + b"\0", "ff" + "11" * 254 + "01 01"),
    ],
)
def test_the_blocks_of_cobs(data, encoded):
    assert cobs_by_blocks(data) == bytes.fromhex(encoded)


def test_the_decoder_reads_these_packets():
    decoder = Decoder()
    stream = pack(DESCRIBED_BODY) + pack(SAMPLE_BODY)
    described, sample = decoder.feed(stream, 5.0)
    assert described.message.description == ARM and described.values is None
    assert sample.host_s == 5.0 and sample.values.tolist() == [128.0]
    assert decoder.descriptions == {7: ARM}
