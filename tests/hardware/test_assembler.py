"""Frames of all channels out of samples of several devices."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softfuse.hardware.live.pipeline import MOST_WAITING, PATIENCE_S, Assembler

WANTED = ("a", "b", "c")


def test_one_device_gives_a_frame_for_each_sample_in_the_wanted_order() -> None:
    assembler = Assembler(WANTED)
    assert assembler.describe(0, ("c", "other", "a", "b")) == [] and assembler.missing == []
    (frame,) = assembler.add(0, 5.0, np.array([3.0, 9.0, 1.0, 2.0]), 5.1)
    assert frame.time_s == 5.0 and frame.arrived_s == 5.1
    np.testing.assert_array_equal(frame.values, [1.0, 2.0, 3.0])


def test_what_no_device_gives_is_missing_and_nan() -> None:
    assembler = Assembler(WANTED)
    assembler.describe(0, ("a", "b"))
    assert assembler.missing == ["c"]
    (frame,) = assembler.add(0, 0.0, np.array([1.0, 2.0]), 0.0)
    np.testing.assert_array_equal(frame.values, [1.0, 2.0, np.nan])


def test_other_devices_are_interpolated_to_the_time_of_the_one_with_most_channels() -> None:
    assembler = Assembler(WANTED)
    assembler.describe(7, ("c",))
    assembler.describe(8, ("a", "b"))
    assert assembler.add(7, 0.000, np.array([10.0]), 0.0) == []
    assert assembler.add(8, 0.010, np.array([1.0, 2.0]), 0.0) == [], "the other's next sample has not come"
    (frame,) = assembler.add(7, 0.040, np.array([14.0]), 0.05)
    assert frame.time_s == 0.010 and frame.arrived_s == 0.05
    np.testing.assert_allclose(frame.values, [1.0, 2.0, 11.0], rtol=1e-12)


def test_a_device_that_has_gone_holds_nothing_up_and_is_nan_after_a_while() -> None:
    assembler = Assembler(WANTED)
    assembler.describe(0, ("a", "b"))
    assembler.describe(1, ("c",))
    assembler.add(1, 0.0, np.array([5.0]), 0.0)
    frames = []
    for k in range(1, 30):
        frames += assembler.add(0, 0.01 * k, np.array([k, k]), 0.01 * k)
    assert [round(100 * frame.time_s) for frame in frames] == list(range(1, len(frames) + 1))
    assert frames[-1].time_s >= 0.29 - PATIENCE_S - 0.0101, "it waits no longer than it has patience"
    held = [frame.values[2] for frame in frames]
    assert held[0] == 5.0 and np.isnan(held[-1])
    assert {frame.time_s <= PATIENCE_S for frame in frames if frame.values[2] == 5.0} == {True}


def test_across_a_long_silence_nothing_is_invented() -> None:
    assembler = Assembler(WANTED)
    assembler.describe(0, ("a", "b"))
    assembler.describe(1, ("c",))
    assembler.add(1, 0.0, np.array([0.0]), 0.0)
    assembler.add(0, 1.0, np.zeros(2), 1.0)
    (frame,) = assembler.add(1, 2.0, np.array([100.0]), 2.0)
    assert frame.time_s == 1.0 and np.isnan(frame.values[2])


def test_a_channel_that_two_devices_give_stays_the_first_ones() -> None:
    assembler = Assembler(WANTED)
    assembler.describe(0, ("a", "b", "c"))
    assert assembler.describe(1, ("b", "z")) == ["b"]
    assert assembler.add(1, 0.0, np.array([9.0, 9.0]), 0.0) == []
    (frame,) = assembler.add(0, 0.0, np.array([1.0, 2.0, 3.0]), 0.0)
    np.testing.assert_array_equal(frame.values, [1.0, 2.0, 3.0])


def test_a_device_may_describe_itself_anew() -> None:
    assembler = Assembler(WANTED)
    assembler.describe(0, ("a", "b", "c"))
    assembler.describe(0, ("c", "b", "a"))
    (frame,) = assembler.add(0, 0.0, np.array([1.0, 2.0, 3.0]), 0.0)
    np.testing.assert_array_equal(frame.values, [3.0, 2.0, 1.0])


def test_a_sample_that_is_not_newer_makes_no_frame() -> None:
    assembler = Assembler(("a",))
    assembler.describe(0, ("a",))
    assert len(assembler.add(0, 1.0, np.ones(1), 1.0)) == 1
    assert assembler.add(0, 1.0, np.ones(1), 1.0) == [] == assembler.add(0, 0.5, np.ones(1), 1.0)


def test_samples_before_a_description_are_left_out() -> None:
    assert Assembler(("a",)).add(3, 0.0, np.ones(1), 0.0) == []


@settings(max_examples=60)
@given(st.lists(st.tuples(st.integers(0, 2), st.floats(1e-4, 0.03)), min_size=1, max_size=200))
def test_frames_come_in_order_once_each_and_never_pile_up(steps: list[tuple[int, float]]) -> None:
    assembler = Assembler(WANTED)
    names = (("a",), ("b",), ("c",))
    for device in range(3):
        assembler.describe(device, names[device])
    now, paces, frames = 0.0, 0, []
    for device, step in steps:
        now += step
        paces += device == 0
        frames += assembler.add(device, now, np.array([now]), now)
    times = [frame.time_s for frame in frames]
    assert times == sorted(set(times)) and len(times) <= paces
    for frame in frames:
        known = frame.values[np.isfinite(frame.values)]
        # Linear in time, these interpolate to the frame's own time; held values are older, never newer.
        assert np.all(known <= frame.time_s + PATIENCE_S) and np.all(known >= frame.time_s - PATIENCE_S)
        assert frame.values[0] == pytest.approx(frame.time_s)
    assert paces - len(frames) <= MOST_WAITING
