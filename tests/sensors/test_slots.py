"""Which electrodes are followed."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.errors import ConfigError
from softfuse.sensors.contact_places import assign_slots, slots_init


def follow(frames, slots, electrodes=12):
    """Electrodes in the slots, -1 for a free one, after each frame; a frame is {electrode: signal}."""
    signal, touched = np.zeros((len(frames), electrodes)), np.zeros((len(frames), electrodes), bool)
    for i, frame in enumerate(frames):
        for electrode, strength in frame.items():
            signal[i, electrode], touched[i, electrode] = strength, True

    def step(state, frame):
        state = assign_slots(state, *frame)
        return state, jnp.where(state.used, state.electrode, -1)

    scan = jax.jit(lambda s, t: jax.lax.scan(step, slots_init(slots, electrodes), (s, t))[1])
    return np.asarray(scan(signal, touched)).tolist()


def test_the_strongest_come_first_and_the_others_wait():
    assert follow([{3: 900.0, 7: 1500.0, 0: 700.0}], 2) == [[7, 3]]
    assert follow([{3: 900.0}], 3) == [[3, -1, -1]]
    assert follow([{}], 2) == [[-1, -1]]


def test_an_electrode_keeps_its_slot_while_it_is_touched_however_strong_the_others_are():
    frames = [{5: 700.0}, {5: 700.0, 2: 9000.0}, {5: 600.0, 2: 9000.0, 11: 20000.0}, {2: 1.0, 11: 20000.0}]
    assert follow(frames, 2) == [[5, -1], [5, 2], [5, 2], [11, 2]]


def test_a_released_slot_is_free_and_its_electrode_may_come_back_elsewhere():
    frames = [{0: 5.0, 1: 4.0}, {1: 4.0}, {1: 4.0, 9: 3.0}, {9: 3.0}, {0: 5.0, 9: 3.0}, {0: 5.0}]
    assert follow(frames, 2) == [[0, 1], [-1, 1], [9, 1], [9, -1], [9, 0], [-1, 0]]


def test_no_electrode_is_ever_in_two_slots_nor_a_touched_one_left_out_of_a_free_slot():
    rng = np.random.default_rng(0)
    touched = rng.random((400, 6)) < 0.4
    frames = [{e: float(rng.uniform(1, 9)) for e in np.flatnonzero(row)} for row in touched]
    for slots, frame in zip(follow(frames, 3, electrodes=6), frames, strict=True):
        used = [s for s in slots if s >= 0]
        assert len(set(used)) == len(used)
        assert set(used) <= set(frame)
        assert len(used) == min(3, len(frame))


@pytest.mark.parametrize("slots", [0, 13])
def test_a_number_of_contacts_that_cannot_be_is_refused(slots):
    with pytest.raises(ConfigError, match="from 1 to 12"):
        slots_init(slots, 12)
