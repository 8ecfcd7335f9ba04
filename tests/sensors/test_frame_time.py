"""The clock of frames: one wrong time costs a frame, a clock that begins anew is believed after a few."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from softfuse.sensors.frame_time import AGREEING, FrameTime, clock_init, clock_of, frame_step

DT = 0.01


@jax.jit
def scanned(times):
    return jax.lax.scan(frame_step, clock_init(), times)[1]


def followed(times) -> FrameTime:
    """What each of some times is worth, compiled."""
    return scanned(jnp.asarray(times, float))


def ticks(n: int, start: float = 0.0) -> np.ndarray:
    return start + DT * np.arange(n)


@given(st.lists(st.floats(1e-4, 0.49), min_size=30, max_size=30), st.floats(-1e3, 1e8))
def test_of_good_times_nothing_changes(steps, start):
    times = start + np.cumsum([0.0, *steps])
    found = followed(times)
    assert found.forward.all() and not found.anew.any()
    np.testing.assert_array_equal(found.now_s, times)
    np.testing.assert_array_equal(found.dt_s, np.diff(times, prepend=times[0]))


@pytest.mark.parametrize("wrong", [1000.0, 1.0, 1e12, -1000.0, -0.015, np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("at", [2, 50, 99])
def test_one_wrong_time_costs_one_frame(wrong, at):
    times = ticks(100)
    times[at] += wrong
    found = followed(times)
    assert np.flatnonzero(~found.forward).tolist() == [at] and not found.anew.any()
    np.testing.assert_allclose(found.dt_s.sum(), 0.99 if at < 99 else 0.98, rtol=1e-12)


@pytest.mark.parametrize("wrong", [1000.0, -1000.0])
@pytest.mark.parametrize("at", [0, 1])
def test_a_wrong_time_at_the_beginning_costs_a_few(wrong, at):
    times = ticks(100)
    times[at] += wrong
    assert (~followed(times).forward).sum() <= AGREEING


@pytest.mark.parametrize(("start", "gap"), [(0.0, DT), (4e3, 3.0 + DT), (1.7e9, 1.7e9)])
def test_a_clock_that_begins_anew_is_believed_when_frames_agree(start, gap):
    times = np.concatenate([ticks(60, 4e3 - 3.6), ticks(60, start)])
    found = followed(times)
    lost = np.flatnonzero(~found.forward)
    assert lost.tolist() == [60, 61] and np.flatnonzero(found.anew).tolist() == [62]
    np.testing.assert_allclose(found.dt_s[62], gap + 2 * DT, rtol=1e-5)
    assert found.dt_s[63] == pytest.approx(DT, abs=1e-6)


def test_wrong_times_among_those_of_a_new_clock_delay_it_only():
    times = np.concatenate([ticks(60, 100.0), ticks(20)])
    times[61], times[63] = np.nan, 1e6
    found = followed(times)
    assert found.forward[66:].all() and found.anew.sum() >= 1


def test_a_slower_clock_is_followed():
    times = np.concatenate([ticks(60), 0.6 + 2.0 * np.arange(1, 20)])
    found = followed(times)
    assert found.forward[63:].all() and found.dt_s[70] == 2.0


def test_a_clock_that_stands_still_passes_no_time():
    found = followed([0.0, 0.01, 0.01, 0.01, 0.01, 0.02])
    assert found.forward.tolist() == [True, True, False, False, False, True]
    np.testing.assert_allclose(found.dt_s, [0, 0.01, 0, 0, 0, 0.01])


@example([*[0.0] * 28, 1.7976931348623157e308, -9.9792015476736e291])
@given(st.lists(st.one_of(st.floats(), st.floats(0, 3)), min_size=30, max_size=30))
def test_steps_are_never_negative_and_a_steady_clock_is_always_found_again(times):
    found = followed([*times, *ticks(10, 5.0)])
    assert np.all(np.asarray(found.dt_s) >= 0) and np.isfinite(found.dt_s).all()
    assert found.forward[-(10 - AGREEING) :].all()
    counted = clock_of(np.array([*times, *ticks(10, 5.0)]))
    assert counted.counts.shape == (len(times) + 10,)


def test_the_step_has_a_derivative_also_at_the_first_frame():
    def last_step(times):
        return jax.lax.scan(frame_step, clock_init(), times)[1].dt_s[-1]

    for times in ([0.0], [0.0, 0.01], [5.0, 5.01, 0.0, 0.01, 0.02], [0.0, np.nan, 0.01]):
        assert np.isfinite(jax.grad(last_step)(jnp.array(times))).all()
    np.testing.assert_allclose(jax.grad(last_step)(jnp.array([0.0, 0.01])), [-1.0, 1.0])
