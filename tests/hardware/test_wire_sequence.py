"""Gaps, doubles, late samples and restarts."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from softfuse.hardware.wire.sequence import REORDERED, Arrival, Place, SequenceWatch

STEP_US = 10_000


def placed(watch: SequenceWatch, *numbers: int, start_us: int = 0) -> list[tuple[Arrival, int]]:
    """What becomes of samples with such numbers, taken every 10 ms."""
    places = [watch.place(number % 2**32, start_us + number * STEP_US) for number in numbers]
    return [(place.arrival, place.missing) for place in places]


FRESH = (Arrival.FRESH, 0)
LATE = (Arrival.LATE, 0)
DUPLICATE = (Arrival.DUPLICATE, 0)
RESTARTED = (Arrival.RESTARTED, 0)


@pytest.mark.parametrize("first", [0, 5, 2**32 - 2])
def test_numbers_in_a_row_are_fresh_over_the_wrap_as_well(first):
    watch = SequenceWatch()
    assert placed(watch, *range(first, first + 200)) == [FRESH] * 200
    assert watch.counts.lost == 0 and watch.counts.fresh == 200


@pytest.mark.parametrize("first", [0, 2**32 - 3])
@pytest.mark.parametrize("gap", [1, 5, 63, 64, 65, 100_000])
def test_a_gap_is_counted_and_told_once(first, gap):
    watch = SequenceWatch()
    numbers = [first, first + 1, first + 2 + gap, first + 3 + gap]
    assert placed(watch, *numbers) == [FRESH, FRESH, (Arrival.FRESH, gap), FRESH]
    assert watch.counts.lost == gap and len(watch._recent) <= REORDERED


def test_a_late_sample_is_no_longer_lost_and_comes_twice_as_a_duplicate():
    watch = SequenceWatch()
    assert placed(watch, 0, 1, 4, 3, 3, 4, 5) == [
        FRESH, FRESH, (Arrival.FRESH, 2), LATE, DUPLICATE, DUPLICATE, FRESH
    ]  # fmt: skip
    counts = watch.counts
    assert (counts.fresh, counts.lost, counts.late, counts.duplicated, counts.restarted) == (4, 1, 1, 2, 0)


def test_a_sample_older_than_the_first_is_late_and_was_never_lost():
    watch = SequenceWatch()
    assert placed(watch, 10, 9, 11) == [FRESH, LATE, FRESH]
    assert watch.counts.lost == 0


@pytest.mark.parametrize("before", [3, 40, 63, 64, 500, 10_000, 2**32 - 1])
def test_a_restart_is_told_from_late_and_doubled_samples(before):
    watch = SequenceWatch()
    # A boot takes a little longer or shorter each time.
    run = range(max(0, before - 300), before)
    assert placed(watch, *run) == [FRESH] * len(run)
    assert placed(watch, 0, 1, 2, start_us=137) == [RESTARTED, FRESH, FRESH]
    assert watch.counts.restarted == 1 and watch.counts.lost == 0


def test_time_that_goes_back_is_a_restart_whatever_the_number():
    watch = SequenceWatch()
    watch.place(100, 5_000_000)
    assert watch.place(700, 4_000_000) == Place(Arrival.RESTARTED, 0)
    assert watch.place(701, 4_000_000).arrival is Arrival.FRESH


def test_a_late_number_with_a_time_out_of_order_is_a_restart():
    watch = SequenceWatch()
    placed(watch, 0, 1, 2, 5)
    assert watch.place(3, 1 * STEP_US).arrival is Arrival.RESTARTED
    watch = SequenceWatch()
    placed(watch, 0, 1, 2, 5)
    assert watch.place(3, 6 * STEP_US).arrival is Arrival.RESTARTED


@given(data=st.data())
def test_any_loss_doubling_and_reordering_is_counted_right(data):
    count = data.draw(st.integers(1, 150))
    first = data.draw(st.sampled_from([0, 1000, 2**32 - 40]))
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    # The first is kept in its place, since numbers are watched from the first that comes.
    sent = [0, *(k for k in range(1, count) if rng.random() > 0.2)]
    arrival = {k: k + rng.random() * data.draw(st.sampled_from([0.0, 1.5, 20.0])) * (k > 0) for k in sent}
    order = sorted(sent, key=lambda k: arrival[k])
    doubled = [k for k in order for _ in range(1 + (rng.random() < 0.1))]
    watch = SequenceWatch()
    seen: set[int] = set()
    newest = -1
    for k in doubled:
        place = watch.place((first + k) % 2**32, (first + k) * STEP_US)
        expected = Arrival.DUPLICATE if k in seen else Arrival.FRESH if k > newest else Arrival.LATE
        assert place.arrival is expected
        assert place.missing == (k - newest - 1 if expected is Arrival.FRESH and newest >= 0 else 0)
        newest = max(newest, k)
        seen.add(k)
    counts = watch.counts
    assert counts.fresh + counts.late + counts.duplicated == len(doubled) and counts.restarted == 0
    assert counts.lost == newest + 1 - len(seen)
    assert len(watch._recent) <= REORDERED
