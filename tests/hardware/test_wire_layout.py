"""Contents of samples: values to raw values and back."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from softfuse.errors import WireError
from softfuse.hardware.wire.description import Channel, Description, Layout, RawType


def layout_of(*channels: tuple[RawType, float, float]) -> Layout:
    """A layout of such types, scales and offsets."""
    named = [Channel(f"c{k}", *channel) for k, channel in enumerate(channels)]
    return Layout(Description("device", tuple(named)))


@given(data=st.data())
def test_values_are_scale_times_raw_plus_offset_where_read(data, descriptions, contents_of):
    description = data.draw(descriptions)
    content = data.draw(contents_of(description))
    values = Layout(description).values(content)
    at = (len(description.channels) + 7) // 8
    assert values.shape == (len(description.channels),) and values.dtype == np.float64
    for k, channel in enumerate(description.channels):
        (raw,) = struct.unpack_from("<" + channel.type.code, content, at)
        at += channel.type.size
        expected = channel.scale * float(raw) + channel.offset
        if content[k // 8] >> (k % 8) & 1 and np.isfinite(expected):
            assert values[k] == expected
        else:
            assert np.isnan(values[k])


@given(data=st.data())
def test_values_come_back_to_half_a_step_and_what_was_not_read_is_not(data, descriptions):
    description = data.draw(descriptions)
    layout = Layout(description)
    n = len(description.channels)
    part = np.array(data.draw(st.lists(st.floats(0.0, 1.0), min_size=n, max_size=n)))
    read = np.array(data.draw(st.lists(st.booleans(), min_size=n, max_size=n)))
    scale = np.array([channel.scale for channel in description.channels])
    offset = np.array([channel.offset for channel in description.channels])
    # Floats have no end that a device would reach.
    low = np.array([-1e6 if c.type.floating else c.type.range[0] for c in description.channels])
    high = np.array([1e6 if c.type.floating else c.type.range[1] for c in description.channels])
    values = np.where(read, scale * (low + part * (high - low)) + offset, np.nan)
    again = layout.values(layout.content(values))
    step = np.where([c.type.floating for c in description.channels], 1e6 * 2.0**-24, 0.5 + 1e-6)
    size = np.abs(scale) * step + 4 * np.spacing(np.abs(values) + np.abs(offset))
    np.testing.assert_array_equal(np.isnan(again), ~read)
    assert np.all(np.abs(again - values)[read] <= size[read])


def test_values_beyond_a_converter_are_clipped():
    layout = layout_of(
        (RawType.U8, 2.0, 1.0), (RawType.I16, -1.0, 0.0), (RawType.U32, 1.0, 0.0), (RawType.F32, 1.0, 0.0)
    )
    content = layout.content(np.array([1e9, 1e9, -5.0, 1e300]))
    np.testing.assert_array_equal(
        layout.values(content), [2 * 255 + 1, 32768, 0, np.finfo(np.float32).max.astype(float)]
    )
    content = layout.content(np.array([-np.inf, -np.inf, np.inf, np.nan]))
    np.testing.assert_array_equal(layout.values(content), [1, -32767, 2**32 - 1, np.nan])


def test_64_bit_floats_come_back_exactly():
    layout = layout_of(*[(RawType.F64, 1.0, 0.0)] * 3)
    values = np.array([0.1, -1e-300, 1.7e308])
    np.testing.assert_array_equal(layout.values(layout.content(values)), values)


@pytest.mark.filterwarnings("error")
def test_floats_that_are_not_finite_or_become_so_are_not_read():
    layout = layout_of((RawType.F32, 1.0, 0.0), (RawType.F64, 3e38, 0.0), (RawType.F32, 1.0, 0.0))
    signalling = struct.pack("<I", 0x7F800001)
    content = b"\x07" + struct.pack("<fd", np.inf, 1e300) + signalling
    assert np.isnan(layout.values(content)).all()


@pytest.mark.parametrize("count", [1, 7, 8, 9, 16, 20, 512])
def test_presence_of_each_channel_alone(count):
    layout = layout_of(*[(RawType.I8, 1.0, 0.0)] * count)
    for k in {0, count // 2, count - 1}:
        values = np.full(count, np.nan)
        values[k] = -3.0
        content = layout.content(values)
        assert len(content) == layout.size == (count + 7) // 8 + count
        np.testing.assert_array_equal(layout.values(content), values)


def test_contents_of_another_size_and_channels_beyond_the_last_are_refused():
    layout = layout_of((RawType.U16, 1.0, 0.0), (RawType.U8, 1.0, 0.0))
    for content in (b"", b"\x03\0\0", b"\x03\0\0\0\0"):
        with pytest.raises(WireError, match="holds 4 bytes"):
            layout.values(content)
    with pytest.raises(WireError, match="more than 2 channels"):
        layout.values(b"\x07\0\0\0")
    with pytest.raises(WireError, match=r"shape \(3,\)"):
        layout.content(np.zeros(3))
