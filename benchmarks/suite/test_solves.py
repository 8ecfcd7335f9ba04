"""Equilibria and linear-tet steps, ours and what a user would otherwise write: see `peers`."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import peers
import pytest
from sofa_pad import NOWHERE, SOFA_MS, readings, sofa_pad
from suite_pads import MESHES, PLACES, pad

from softfuse.estimation.estimator import Estimator
from softfuse.estimation.limits import Limits
from softfuse.estimation.step import Observation
from softfuse.mechanics.model import simulate

FORCE_N = 5.0
RADIUS_M = 8e-3
WAYS = [
    (way, nodes) for way in ("ours", "superlu", "dense") for nodes in MESHES if way != "dense" or nodes < 2500
]
"""And on which meshes: a dense tangent of a larger one takes minutes to factor."""


def _pushed(nodes: int):
    """The pad under a force shared by the nodes of its top around the first place."""
    model = pad(nodes).model
    rest = np.asarray(model.body.rest)
    near = np.linalg.norm(rest[:, :2] - PLACES[0, 0, :2], axis=1) < RADIUS_M
    return peers.shared_force(model, np.flatnonzero(near & (rest[:, 2] > rest[:, 2].max() - 1e-6)))


@pytest.mark.parametrize("way, nodes", WAYS)
def test_equilibrium(benchmark, way: str, nodes: int) -> None:
    """All to the same residual; the others take the increments of force that ours find they need."""
    model, none, force = _pushed(nodes), NOWHERE, jnp.array([FORCE_N])
    exact = simulate(model, none, force)
    push = np.asarray(model.loads(none).rows(model.body, jnp.zeros(model.body.n)) @ force)
    if way == "ours":
        program = eqx.filter_jit(lambda d: simulate(d, none, force).state.z)

        def solve():
            return np.asarray(program(model))
    else:
        newton = peers.DenseNewton(model.body) if way == "dense" else peers.SparseNewton(model.body)

        def solve():
            return newton.solve(push, increments=int(exact.stats.load_steps))

    # Ours is compiled first; the others' few programs are nothing beside the minutes that they take.
    times = {"rounds": 3, "warmup_rounds": 1} if way == "ours" else {"rounds": 1}
    found = benchmark.pedantic(solve, **times)
    np.testing.assert_allclose(found, exact.state.z, rtol=0, atol=1e-6 * np.abs(exact.state.z).max())
    benchmark.extra_info.update(nodes=nodes, unknowns=model.body.n)


@pytest.mark.parametrize("mesh", SOFA_MS)
@pytest.mark.parametrize("way", ["ours", "superlu"])
def test_linear_tet_step(benchmark, mesh: str, way: str) -> None:
    """One force from four volumes, on linear corotational tets, rising and falling."""
    model, frames = sofa_pad(mesh), 60
    force = 5.0 * np.abs(np.interp(np.arange(frames), [0, frames / 2, frames], [0, 1, 0]))
    whitening = 1e9 * np.eye(model.n_readings)
    seen = [Observation.on_host(each, whitening, NOWHERE) for each in readings(model, force)]
    if way == "ours":
        limits = Limits(jnp.zeros(1), jnp.full(1, 50.0), jnp.zeros(1))
        follow = Estimator(model, limits, jnp.asarray(NOWHERE))
    else:
        follow = peers.PaperStep(model)
    for each in seen:
        follow.update(each)
    follow.reset()
    coming, found = iter(seen), []
    benchmark.pedantic(
        lambda frame: found.append(follow.update(frame).drive[0]),
        setup=lambda: ((next(coming),), {}),
        rounds=frames,
    )
    off = float(np.max(np.abs(np.array(found) - force)))
    benchmark.extra_info.update(nodes=model.body.n_nodes, force_off_N=off)
