"""The estimate step, full and reduced, over the mesh and over the contacts; and its gradient.

A reduced pad is one chart of a cell, taught here; the contact stays in it.
"""

import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from live_frames import wait_until_compiled
from suite_pads import CONFIGS, MESHES, PLACES, megabytes, pad, press, time_frames

from softfuse.estimation.bounds import limits_of, step_settings
from softfuse.estimation.estimator import Estimator
from softfuse.estimation.step import Observation, exact_steps
from softfuse.mechanics.model import simulate
from softfuse.robot.file import load
from softfuse.robot.reduced import Teacher, build_regions
from softfuse.robot.robot import build_robot
from softfuse.rom.basis import rest_stiffness
from softfuse.rom.reduced_model import reduced_model

FRAMES = 200
LARGEST = max(MESHES)


def _time_estimates(benchmark, model, limits, frames, settings=None, **said) -> None:
    estimator = Estimator(model, limits, jnp.asarray(frames[0].places), *([settings] if settings else []))
    for seen in frames[:3]:
        estimator.update(seen)
    wait_until_compiled(estimator)
    estimator.reset()
    memory = megabytes(estimator.live.first.arrays, estimator.live.first.rest)
    time_frames(benchmark, estimator.update, frames, memory_MB=memory, compile_s=estimator.compile_s, **said)


@pytest.mark.parametrize("nodes", MESHES)
def test_full_step(benchmark, nodes: int) -> None:
    model = pad(nodes).model
    frames = press(model, 1, FRAMES)
    _time_estimates(benchmark, model, pad(nodes).limits(), frames, nodes=nodes, unknowns=model.body.n)


@pytest.mark.parametrize("contacts", [2, 3, 4])
def test_full_step_of_several_contacts(benchmark, contacts: int) -> None:
    model = pad(4391).model
    frames = press(model, contacts, FRAMES)
    said = {"nodes": 4391, "contacts": contacts}
    _time_estimates(benchmark, model, pad(4391).limits(contacts), frames, **said)


@pytest.mark.parametrize("nodes", MESHES)
def test_reduced_step(benchmark, nodes: int) -> None:
    robot, model = pad(nodes).robot, pad(nodes).model
    regions, stiffness = build_regions(robot.settings), rest_stiffness(model.body)
    number = regions.find(PLACES[0])
    assert number is not None
    # Where the chart is good: not at the edge of its cell, which the contact would leave.
    frames = press(model, 1, 10 * FRAMES, place=regions[number].at(np.zeros(2)))
    started = time.perf_counter()
    chart = Teacher(robot, stiffness, regions).chart(number)
    teaching = time.perf_counter() - started
    small = reduced_model(model, stiffness, chart, np.zeros((0, 3, 3)))
    said = {"nodes": nodes, "unknowns": small.body.n, "teaching_s": teaching}
    _time_estimates(benchmark, small, pad(nodes).limits(), frames, **said)


def test_full_step_of_the_finger(benchmark) -> None:
    robot = build_robot(load(CONFIGS / "finger.toml"))
    model, limits = robot.model, limits_of(robot)
    place = jnp.asarray([*robot.settings.places.values()])[7:8]
    drive = model.rest_state(place).drive.at[2].set(2.0).at[0].set(0.5)
    state = simulate(model, place, drive).state
    reading, whitening = np.asarray(model.reading(state)), 0.1 * np.eye(model.n_readings)
    whitening[0, 0] = 2e4
    ramp = np.minimum(np.linspace(0.0, 1.25, 40), 1.0)
    frames = [Observation.on_host(share * reading, whitening, np.asarray(place)) for share in ramp]
    said = {"nodes": model.body.n_nodes, "unknowns": model.body.n}
    _time_estimates(benchmark, model, limits, frames, step_settings(robot), **said)


@pytest.mark.parametrize("nodes", [nodes for nodes in MESHES if nodes < LARGEST])
@pytest.mark.parametrize("what", ["estimate", "gradient"])
def test_exact_step(benchmark, nodes: int, what: str) -> None:
    """A step with a new factor, and its force with the gradient in all that it is computed from: rest nodes,
    materials, readings and weights, the place, the limits and the state before.
    """
    model, place = pad(nodes).model, jnp.asarray(PLACES[:1])
    before, now = (simulate(model, place, jnp.array([force])).state for force in (5.0, 5.5))
    seen = Observation(model.reading(now), 1e9 * jnp.eye(model.n_readings), place)
    inputs, rest = eqx.partition((model, pad(nodes).limits(), before, seen), eqx.is_inexact_array)
    indices, static = eqx.partition(rest, eqx.is_array)

    def force(inputs, indices):
        after, _ = exact_steps(*eqx.combine(inputs, indices, static), steps=1)
        return after.drive[0]

    program = jax.jit(force if what == "estimate" else jax.value_and_grad(force))
    jax.block_until_ready(program(inputs, indices))
    benchmark.pedantic(lambda: jax.block_until_ready(program(inputs, indices)), rounds=9)
    count = sum(leaf.size for leaf in jax.tree.leaves(inputs))
    benchmark.extra_info.update(nodes=nodes, inputs=count)
