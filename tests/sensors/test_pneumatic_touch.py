"""Touches that electrodes do not see: begun by flowing gas, ended when it has come back."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.sensors.base import Hint, VolumeChange
from softfuse.sensors.pneumatic_touch import (
    PneumaticDetector,
    PneumaticState,
    pneumatic_init,
    pneumatic_update,
)

DETECTOR = replace(PneumaticDetector.usual(), longest_s=jnp.asarray(2.0))
DT = 0.01
STILL, OUT, IN = np.zeros(2), np.array([30.0, 0.0]), np.array([-30.0, 5.0])


def run(
    state: PneumaticState, frames: int, flow: np.ndarray, lacking_mm3: float, *, valid=True, near=False
) -> PneumaticState:
    """So many frames of one flow [sigma], while the first cavity lacks so much air."""
    volume = VolumeChange(jnp.array([-1e-9 * lacking_mm3, 0.0]), jnp.array([valid, True]))
    hint = Hint(jnp.asarray(flow), jnp.ones(2, bool), jnp.zeros(2, bool))
    for _ in range(frames):
        state = pneumatic_update(DETECTOR, state, jnp.asarray(DT), hint, volume, jnp.asarray(near))
    return state


@pytest.fixture(scope="module")
def squeezed() -> PneumaticState:
    """Squeezed by 100 mm³, then held."""
    return run(run(pneumatic_init(), 10, OUT, 100.0), 50, STILL, 100.0)


def test_outflow_begins_a_touch_and_stillness_does_not_end_it(squeezed: PneumaticState) -> None:
    assert not run(pneumatic_init(), 2, OUT, 1.0).touching
    assert run(pneumatic_init(), 3, OUT, 1.0).touching
    assert squeezed.touching
    np.testing.assert_allclose(squeezed.largest_m3, 1e-7)


def test_it_ends_when_the_air_has_come_back(squeezed: PneumaticState) -> None:
    half = run(run(squeezed, 10, IN, 60.0), 20, STILL, 60.0)
    assert half.touching
    assert run(half, 10, IN, 10.0).touching  # still flowing
    assert not run(run(half, 10, IN, 10.0), 3, STILL, 10.0).touching


def test_air_that_came_back_unmeasured_ends_it_when_still(squeezed: PneumaticState) -> None:
    """A fast release clips the flow sensor: the volume stays behind."""
    released = run(squeezed, 10, IN, 60.0, valid=False)
    assert released.touching
    assert not run(released, 3, STILL, 60.0, valid=False).touching
    # A fast press that was clipped does not end.
    pressed = run(run(squeezed, 5, OUT, 200.0, valid=False), 20, STILL, 200.0, valid=False)
    assert pressed.touching


def test_electrodes_take_over(squeezed: PneumaticState) -> None:
    assert not run(squeezed, 1, STILL, 100.0, near=True).touching
    assert not run(pneumatic_init(), 20, OUT, 100.0, near=True).touching


def test_inflow_begins_nothing() -> None:
    assert not run(pneumatic_init(), 20, IN, -10.0).touching


def test_an_outflow_without_end_is_given_up_until_it_ends() -> None:
    endless = run(pneumatic_init(), 210, OUT, 1000.0)
    assert not endless.touching
    assert not run(endless, 100, OUT, 1000.0).touching
    assert run(run(endless, 5, STILL, 0.0), 5, OUT, 1.0).touching
