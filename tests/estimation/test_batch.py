"""A batch is each of its problems alone, on one device, in steps, and split over several."""

import json
import os
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.errors import SolveError
from softfuse.estimation.batch import batched
from softfuse.estimation.step import Observation, exact_steps
from softfuse.functional.chart import facing
from softfuse.mechanics.model import Model, simulate

MM = 1e-3
PRESSED_AT = MM * np.array([(-17, 0, 0), (-14, 3, 0), (12, -2, 0), (14, -3, 0), (0, 0, 0)])
PLACES = jnp.asarray(facing(PRESSED_AT[:, None], (0, 0, -1)))
FORCES = jnp.array([[2.0], [6.0], [0.5], [4.0], [0.0]])
ON_SEVERAL = """
import json, runpy, sys
import jax, jax.numpy as jnp
shared = runpy.run_path(sys.argv[1])
from softfuse.estimation.batch import batched
from softfuse.mechanics.model import simulate
device = shared["two_cavity_device"](shared["LINEAR"], shared["Dense"], 0.3)
places, forces = (jnp.array(each) for each in json.loads(sys.argv[2]))
def read(device, at):
    return device.reading(simulate(device, *at).state)
found = batched(read, device, (places, forces), at_once=1)
print(json.dumps([jax.device_count(), found.tolist()]))
"""


def _read(device: Model, at: tuple[jax.Array, jax.Array]) -> jax.Array:
    return device.reading(simulate(device, *at).state)


@pytest.fixture(scope="module")
def alone(plain_device: Model) -> np.ndarray:
    """Volume changes (5, 2) m³ of each press by itself."""
    return np.array([_read(plain_device, at) for at in zip(PLACES, FORCES, strict=True)])


@pytest.mark.slow
@pytest.mark.parametrize("at_once", [2, 64])
def test_batch_of_equilibria_is_each_alone(plain_device: Model, alone: np.ndarray, at_once: int) -> None:
    found = batched(_read, plain_device, (PLACES, FORCES), at_once=at_once)
    np.testing.assert_allclose(found, alone, rtol=1e-9, atol=1e-9 * np.abs(alone).max())


@pytest.mark.slow
def test_batch_split_over_devices_is_each_alone(alone: np.ndarray) -> None:
    """Five presses on three devices: one has less to do, and other numbers of iterations."""
    flags = os.environ.get("XLA_FLAGS", "") + " --xla_force_host_platform_device_count=3"
    shared = Path(__file__).parents[1] / "conftest.py"
    given = json.dumps([PLACES.tolist(), FORCES.tolist()])
    ended = subprocess.run(
        [sys.executable, "-c", ON_SEVERAL, shared, given],
        env=os.environ | {"XLA_FLAGS": flags},
        capture_output=True,
        text=True,
        check=False,
    )
    assert not ended.returncode, ended.stderr
    devices, found = json.loads(ended.stdout)
    assert devices == 3
    np.testing.assert_allclose(found, alone, rtol=1e-9, atol=1e-9 * np.abs(alone).max())


@pytest.mark.slow
def test_batch_of_estimates_is_each_alone(plain_device: Model, alone: np.ndarray, one) -> None:
    """Estimates from rest, one of which needs the force's bound."""
    whitening = jnp.tile(1e9 * jnp.eye(alone.shape[1]), (len(PLACES), 1, 1))
    seen = Observation(jnp.asarray(alone).at[4].set(1e-9), whitening, PLACES)
    rest = plain_device.rest_state(PLACES[0])

    def estimate(shared, seen):
        device, limits, rest = shared
        after, report = exact_steps(device, limits, rest, seen, steps=8)
        return after.drive, report.kkt

    drive, kkt = batched(estimate, (plain_device, one, rest), seen)
    each = [
        estimate((plain_device, one, rest), jax.tree.map(lambda leaf, k=k: leaf[k], seen)) for k in (1, 4)
    ]
    np.testing.assert_allclose(drive[np.array([1, 4])], [drives for drives, _ in each], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(drive[:4], FORCES[:4], rtol=1e-4)
    assert drive[4] == 0.0 and np.max(kkt) < 1e-9


def test_gradient_of_a_batch_is_the_sum_of_each() -> None:
    matrices = jnp.eye(3) + 0.1 * jnp.asarray(np.random.default_rng(2).normal(size=(5, 3, 3)))

    def solved(right, matrix):
        return jnp.sum(jnp.linalg.solve(matrix, right) ** 2)

    right = jnp.arange(1.0, 4.0)
    found = jax.grad(lambda r, m: jnp.sum(batched(solved, r, m, at_once=2)), (0, 1))(right, matrices)
    wanted = jax.grad(lambda r, m: sum(solved(r, one) for one in m), (0, 1))(right, matrices)
    for one, other in zip(found, wanted, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12)


@pytest.mark.parametrize("forces", [FORCES[:0], FORCES[:3]])
def test_batch_of_unequal_arrays_or_none_is_refused(plain_device: Model, forces) -> None:
    with pytest.raises(SolveError, match="equal length"):
        batched(_read, plain_device, (PLACES[: 2 * len(forces)], forces))
