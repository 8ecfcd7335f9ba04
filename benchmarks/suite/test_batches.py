"""Estimates and equilibria a second in batches, on all of JAX's devices, reduced and full."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from suite_pads import PLACES, pad

from softfuse.estimation.batch import batched
from softfuse.estimation.step import Observation, exact_steps
from softfuse.functional.chart import moved
from softfuse.mechanics.model import Model, simulate
from softfuse.robot.reduced import Teacher, build_regions
from softfuse.rom.basis import rest_stiffness
from softfuse.rom.cells import Cells
from softfuse.rom.reduced_model import reduced_model

NODES = 2115
AT_ONCE = {"reduced": 64, "full": 4}


REGIONS = build_regions(pad(NODES).config)
NUMBER = REGIONS.find(PLACES[0])
assert isinstance(REGIONS, Cells) and NUMBER is not None
CENTRE = REGIONS[NUMBER].at(np.zeros(2))


@pytest.fixture(scope="module")
def models() -> dict[str, Model]:
    """A pad, full and reduced in the cell of the first place."""
    full = pad(NODES).model
    stiffness = rest_stiffness(full.body)
    chart = Teacher(pad(NODES).config, full, stiffness, REGIONS).chart(NUMBER)
    return {"full": full, "reduced": reduced_model(full, stiffness, chart, np.zeros((0, 3, 3)))}


def _estimate(shared, seen):
    model, limits, before = shared
    after, _ = exact_steps(model, limits, before, seen, steps=4)
    return after.drive


def _read(model, at):
    return model.reading(simulate(model, *at).state)


@pytest.mark.parametrize(
    "body, count", [("reduced", n) for n in (1, 16, 64, 1024)] + [("full", 1), ("full", 8)]
)
@pytest.mark.parametrize("what", ["estimates", "equilibria"])
def test_batch(benchmark, models: dict[str, Model], body: str, count: int, what: str) -> None:
    model, random = models[body], np.random.default_rng(3)
    places = jnp.asarray(moved(CENTRE, random.uniform(-1e-3, 1e-3, (count, 1, 3))[..., :2]))
    forces = jnp.asarray(random.uniform(2.0, 6.0, (count, 1)))
    read = batched(_read, models["reduced"], (places, forces))
    if what == "equilibria":
        function, shared, many = _read, model, (places, forces)
    else:
        # As live: from a state some newtons away, not from rest in one step.
        before = simulate(model, jnp.asarray(CENTRE)[None], jnp.array([4.0])).state
        function, shared = _estimate, (model, pad(NODES).limits(), before)
        many = Observation(read, jnp.tile(1e9 * jnp.eye(read.shape[1]), (len(read), 1, 1)), places)

    def solve():
        return jax.block_until_ready(batched(function, shared, many, at_once=AT_ONCE[body]))

    found = solve()
    if what == "estimates" and body == "reduced":
        np.testing.assert_allclose(found, forces, rtol=1e-3)
    benchmark.pedantic(solve, rounds=3)
    rate = count / benchmark.stats.stats.median
    benchmark.extra_info.update(count=count, a_second=rate, devices=jax.device_count())
