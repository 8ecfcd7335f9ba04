"""The touch decision."""

import jax
import jax.numpy as jnp
import numpy as np
from made_sensors import touch_detector

from softfuse.sensors.crossed.touch import touch_init, touch_update

DETECTOR = touch_detector()


@jax.jit
def run(strength, flow):
    def step(state, frame):
        state = touch_update(DETECTOR, state, *frame)
        return state, (state.near, state.touching)

    return jax.lax.scan(step, touch_init(), (strength, flow))[1]


def decide(strength, flow: float | np.ndarray = 0.0):
    strength = jnp.asarray(strength, float)
    near, touching = run(strength, jnp.broadcast_to(jnp.asarray(flow, float), strength.shape))
    return np.asarray(near), np.asarray(touching)


def edges(touching):
    return int(np.sum(touching[1:] & ~touching[:-1])), int(np.sum(~touching[1:] & touching[:-1]))


def test_a_press_is_one_touch_and_proximity_is_none():
    ramp = np.concatenate([np.zeros(20), np.geomspace(10, 7000, 60), np.full(100, 7500.0)])
    near, touching = decide(np.concatenate([ramp, ramp[::-1]]))
    assert edges(touching) == (1, 1)
    assert np.argmax(near) < np.argmax(touching)
    near, touching = decide(np.concatenate([np.zeros(20), np.full(200, 2000.0), np.zeros(20)]))
    assert near[100] and not touching.any() and not near[-1]


def test_noise_at_either_threshold_does_not_flicker():
    rng = np.random.default_rng(0)
    level = np.concatenate([np.full(300, 3000.0), np.full(300, 7000.0), np.full(300, 4200.0), np.zeros(50)])
    _, touching = decide(level + 40.0 * rng.standard_normal(level.size))
    assert edges(touching) == (1, 1)


def test_single_spikes_neither_begin_nor_end_a_touch():
    level = np.zeros(100)
    level[50:52] = 9000.0
    assert not decide(level)[1].any()
    level = np.concatenate([np.zeros(10), np.full(200, 7000.0)])
    level[100:102] = 0.0
    level[150] = 60000.0
    assert edges(decide(level)[1]) == (1, 0)


def test_a_weak_object_that_squeezes_gas_out_is_a_touch():
    level = np.concatenate([np.zeros(20), np.full(100, 900.0), np.zeros(30)])
    flow = np.concatenate([np.zeros(40), np.full(30, 20.0), np.zeros(80)])
    near, touching = decide(level, flow)
    assert edges(touching) == (1, 1)
    assert 40 <= np.argmax(touching) <= 44
    assert not decide(np.zeros(150), flow)[1].any()


def test_after_a_release_the_thing_must_come_back_to_touch_again():
    level = np.concatenate([np.full(50, 8000.0), np.full(50, 4000.0), np.full(50, 7000.0), np.zeros(20)])
    assert edges(decide(np.concatenate([np.zeros(5), level]))[1]) == (2, 2)
