"""Channels and types of raw values."""

import struct

import pytest

from softfuse.errors import WireError
from softfuse.hardware.wire.description import Channel, RawType


@pytest.mark.parametrize(
    ("number", "size", "lowest", "highest"),
    [
        (1, 1, 0, 255),
        (2, 1, -128, 127),
        (3, 2, 0, 65535),
        (4, 2, -32768, 32767),
        (5, 4, 0, 4294967295),
        (6, 4, -2147483648, 2147483647),
        (7, 4, -3.4028234663852886e38, 3.4028234663852886e38),
        (8, 8, -1.7976931348623157e308, 1.7976931348623157e308),
    ],
)
def test_types_and_their_ranges(number, size, lowest, highest):
    kind = RawType(number)
    assert (kind.size, *kind.range) == (size, lowest, highest)
    for end in (lowest, highest):
        packed = struct.pack("<" + kind.code, end)
        assert len(packed) == size and struct.unpack("<" + kind.code, packed) == (end,)


def test_scale_and_offset_are_those_that_the_wire_can_carry():
    channel = Channel("flow0_V", RawType.U16, 0.1, 1 / 3)
    assert channel.scale == 0.10000000149011612 and channel.offset == 0.3333333432674408
    assert channel == Channel("flow0_V", RawType.U16, channel.scale, channel.offset)


@pytest.mark.parametrize(
    ("name", "scale", "offset", "word"),
    [
        ("", 1.0, 0.0, "1 to 255 bytes"),
        ("é" * 128, 1.0, 0.0, "256"),
        ("a,b", 1.0, 0.0, "commas"),
        ("a\nb", 1.0, 0.0, "printable"),
        ("\x1b[2J", 1.0, 0.0, "printable"),
        (" a", 1.0, 0.0, "spaces"),
        ('a"b', 1.0, 0.0, "quotes"),
        ("\ud800", 1.0, 0.0, "UTF-8"),
        ("time_s", 1.0, 0.0, "rename"),
        ("a", 0.0, 0.0, "scale 0"),
        ("a", 1e-60, 0.0, "scale 0"),
        ("a", 1e39, 0.0, "scale 1e+39"),
        ("a", float("nan"), 0.0, "scale nan"),
        ("a", 1.0, float("inf"), "offset inf"),
    ],
)
def test_channels_that_cannot_be_are_refused_in_one_line(name, scale, offset, word):
    with pytest.raises(WireError) as error:
        Channel(name, RawType.U8, scale, offset)
    assert word in str(error.value) and "\n" not in str(error.value) and str(error.value).isprintable()


def test_the_longest_name_and_a_name_with_a_space_inside():
    assert Channel("é" * 127 + "e", RawType.U8, 1.0, 0.0).name.endswith("e")
    assert Channel("base left", RawType.U8, -1e-45, -0.0).scale < 0.0
