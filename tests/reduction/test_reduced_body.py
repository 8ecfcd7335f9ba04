"""A reduced body against the full one: projections to rounding, equilibria and estimates within a percent."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body import LINEAR, TAYLOR_HOOD, AbstractBody, Body, mesh_for
from softfuse.equilibrium.dense import Dense
from softfuse.equilibrium.load import Loads
from softfuse.errors import SolveError
from softfuse.estimation.device import Device, compliance, simulate
from softfuse.estimation.estimator import Estimator
from softfuse.estimation.limits import Limits
from softfuse.estimation.step import Observation
from softfuse.material import MooneyRivlin, NeoHookean
from softfuse.mesh.pad import PadGeometry, pad_mesh
from softfuse.mesh.tetmesh import tet_mesh
from softfuse.reduction.basis import Basis
from softfuse.reduction.chart import Chart, ChartSettings, chart
from softfuse.reduction.cubature import Cubature
from softfuse.reduction.mode_points import mode_points
from softfuse.reduction.projection import project
from softfuse.reduction.reduced_body import ReducedBody
from softfuse.reduction.rest_stiffness import rest_stiffness
from softfuse.reduction.sampling import sampled
from softfuse.reduction.snapshots import snapshots

MM = 1e-3
CELL = [
    np.array([x, y, 0.0]) for x in np.linspace(-16 * MM, -8 * MM, 5) for y in np.linspace(-2 * MM, 6 * MM, 5)
]
"""Places of the contact."""
UNSEEN = [((-12.3 * MM, 3.1 * MM), 6.0), ((-9.3 * MM, 0.4 * MM), 7.5), ((-14.9 * MM, 5.2 * MM), 2.2)]
"""Places and forces [N] that nothing was trained on."""


def at(x: float, y: float) -> jax.Array:
    """One place, as a device wants it."""
    return jnp.array([[x, y, 0.0]])


def device_loads(device: Device) -> Callable[[AbstractBody, jax.Array], Loads]:
    """The loads of a device on any body with its nodes, at places (c, 3)."""
    return lambda body, places: replace(device, body=body).loads(places)


class Trained(NamedTuple):
    """The device with a reduced body, and the chart that it is from."""

    device: Device
    chart: Chart


@pytest.fixture(scope="module")
def trained(device: Device) -> Trained:
    """The small device around one place, from eighteen of its equilibria."""
    body = device.body
    assert isinstance(body, Body)
    presses = [jnp.asarray(place)[None] for place in CELL]
    reduced = chart(
        device.linear,
        body,
        device_loads(device),
        around=presses,
        presses=presses[::3],
        levels=np.array([[4.0], [8.0]]),
        watched=np.arange(body.n_nodes),
        settings=ChartSettings(corrections=10, pressures=18),
    )
    return Trained(replace(device, body=reduced.body, linear=Dense.plan(reduced.body)), reduced)


@pytest.fixture(scope="module", params=[TAYLOR_HOOD, LINEAR], ids=lambda element: element.name)
def heavy(request: pytest.FixtureRequest) -> Body:
    """Two materials under gravity."""
    geometry = PadGeometry((60 * MM, 40 * MM, 18 * MM), (20 * MM, 20 * MM, 6 * MM), ((0.0, 0.0),), 6 * MM)
    mesh = mesh_for(request.param, pad_mesh(geometry, 40 * MM, 40 * MM))
    right = mesh.nodes[mesh.tets[:, :4]].mean(axis=1)[:, 0] > 0
    mesh = tet_mesh(mesh.nodes, mesh.tets, region=right)
    laws = [NeoHookean.from_young(0.6e6, 0.49), MooneyRivlin(6e4, 2e4, 2e6)]
    fixed = mesh.nodes[:, 2] < 1e-9
    return Body.from_mesh(
        mesh, laws, fixed, element=request.param, densities=[1080.0, 1200.0], gravity=[1.0, 2.0, -9.81]
    )


def test_with_all_elements_it_is_the_projection_of_the_full_body(heavy: Body) -> None:
    random = np.random.default_rng(3)
    u, c = heavy.n_displacements, heavy.n - heavy.n_displacements
    basis = Basis(random.normal(size=(u, 9)), random.normal(size=(c, 4 if c else 0)))
    count = heavy.volumes.size
    every = Cubature(np.arange(count), np.ones(count), 0.0)
    points = mode_points(heavy, *basis)
    reduced = project(heavy, basis, rest_stiffness(heavy), points, every, np.arange(heavy.n_nodes), 1.0)
    modes = basis.columns
    z = 1e-5 * random.normal(size=reduced.n)
    expected = modes.T @ np.asarray(jax.jit(Body.residual)(heavy, jnp.asarray(modes @ z)))
    found = np.asarray(jax.jit(ReducedBody.residual)(reduced, jnp.asarray(z)))
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    stiff = modes.T @ np.asarray(
        jax.jit(lambda b, z, x: b.tangent_action(z)(x))(heavy, jnp.asarray(modes @ z), jnp.asarray(modes))
    )
    tangents = np.asarray(jax.jit(ReducedBody.element_tangents)(reduced, jnp.asarray(z)))[0]
    np.testing.assert_allclose(tangents, stiff, rtol=1e-8, atol=1e-9 * np.abs(stiff).max())
    np.testing.assert_allclose(
        reduced.displacement(jnp.asarray(z)), heavy.displacement(jnp.asarray(modes @ z)), atol=1e-15
    )
    ratios = jax.jit(Body.volume_ratios)(heavy, jnp.asarray(modes @ z))
    found = np.sort(np.ravel(reduced.volume_ratios(jnp.asarray(z))))
    np.testing.assert_allclose(found, np.sort(np.ravel(ratios)), rtol=1e-12)
    assert float(reduced.volume) == pytest.approx(float(heavy.volume))


def test_its_tangent_is_the_slope_of_its_residual(trained: Trained) -> None:
    body = trained.device.body
    z = jnp.asarray(trained.chart.amplitudes[3])
    slope = jax.jit(jax.jacfwd(ReducedBody.residual, argnums=1))(body, z)
    tangent = jax.jit(ReducedBody.element_tangents)(body, z)[0]
    np.testing.assert_allclose(tangent, slope, atol=1e-9 * float(jnp.abs(slope).max()))
    np.testing.assert_allclose(slope, slope.T, atol=1e-9 * float(jnp.abs(slope).max()))


def test_modes_are_orthonormal_in_stiffness_and_compressibility(trained: Trained) -> None:
    for modes, matrix in zip(
        trained.chart.basis,
        (trained.chart.stiffness.displacement, trained.chart.stiffness.pressure),
        strict=True,
    ):
        np.testing.assert_allclose(modes.T @ (matrix @ modes), np.eye(modes.shape[1]), atol=1e-9)


@pytest.mark.parametrize(("place", "force"), UNSEEN)
def test_unseen_presses_are_within_a_percent_of_the_full_body(device, trained, place, force) -> None:
    exact = simulate(device, at(*place), jnp.array([force]))
    found = simulate(trained.device, at(*place), jnp.array([force]))
    shape = device.body.displacement(exact.state.z)
    missed = trained.device.body.displacement(found.state.z) - shape
    assert float(jnp.max(jnp.abs(missed))) < 1e-2 * float(jnp.max(jnp.abs(shape)))
    volumes = device.reading(exact.state)
    assert float(jnp.max(jnp.abs(trained.device.reading(found.state) - volumes))) < 1e-2 * float(
        jnp.max(jnp.abs(volumes))
    )
    assert trained.device.body.n < 0.03 * device.body.n
    assert len(trained.chart.cubature.parts) < 0.1 * device.body.volumes.size


def test_its_compliance_is_that_of_the_full_body_and_the_slope_of_its_own_readings(device, trained) -> None:
    (place, force), h = UNSEEN[0], 1e-4
    drive = jnp.array([force])
    own = compliance(trained.device, at(*place), drive)
    exact = compliance(device, at(*place), drive)
    np.testing.assert_allclose(own, exact, atol=2e-2 * float(jnp.max(jnp.abs(exact))))
    above, below = (
        trained.device.reading(simulate(trained.device, at(*place), drive + d).state) for d in (h, -h)
    )
    np.testing.assert_allclose(own[:, 0], (above - below) / (2 * h), rtol=1e-4, atol=1e-12)


def test_the_estimator_finds_forces_with_it_unchanged(device, trained) -> None:
    (place, force), limits = UNSEEN[1], Limits(jnp.zeros(1), jnp.array([12.0]), jnp.array([1e-6]))
    reading = device.reading(simulate(device, at(*place), jnp.array([force])).state)
    estimator = Estimator(trained.device, limits, at(*place))
    seen = Observation(reading, jnp.full(device.readings, 1e9), at(*place))
    for _ in range(8):
        found = estimator.update(seen)
    assert found.drive[0] == pytest.approx(force, rel=1e-2)
    assert float(found.report.unbalanced) < 1e-3


def test_forces_on_nodes_that_nothing_watches_are_not_lost_without_a_word(device, trained) -> None:
    body = device.body
    top = np.unique(np.asarray(device.contact.disc.surface.faces))
    some, basis = Cubature(np.arange(20), np.ones(20), 0.0), trained.chart.basis
    reduced = project(
        device.body, basis, trained.chart.stiffness, mode_points(device.body, *basis), some, top, 1.0
    )
    below = np.setdiff1d(np.arange(body.n_nodes), top)[:2]
    z = jnp.asarray(trained.chart.amplitudes[0])
    moved = np.asarray(reduced.watched(z))
    np.testing.assert_allclose(moved[top], np.asarray(reduced.displacement(z))[top], atol=1e-18)
    assert np.isnan(moved[below]).all()
    force = jnp.ones((2, 3, 1))
    assert np.isfinite(reduced.spread(jnp.asarray(top[:2]), force)).all()
    assert np.isnan(reduced.spread(jnp.asarray(below), force)).any()


def test_spreading_forces_is_the_transpose_of_watching(trained: Trained) -> None:
    body, random = trained.device.body, np.random.default_rng(2)
    nodes = jnp.asarray(random.integers(0, body.n_nodes, (5, 4)))
    forces, z = jnp.asarray(random.normal(size=(5, 4, 3, 1))), jnp.asarray(random.normal(size=body.n))
    work = jnp.sum(forces[..., 0] * body.watched(z)[nodes])
    np.testing.assert_allclose(body.spread(nodes, forces)[:, 0] @ z, work, rtol=1e-9)


def test_snapshots_end_where_the_body_cannot_carry_the_load(device) -> None:
    levels = np.array([[3.0], [4000.0], [5.0]])
    found = snapshots(device.linear, device.body, device_loads(device), [at(-12 * MM, 3 * MM)], levels)
    assert found.found.tolist() == [[True, False, False]]
    exact = simulate(device, at(-12 * MM, 3 * MM), jnp.array([3.0])).state.z
    np.testing.assert_allclose(device.body.motion(found.states[0]), device.body.motion(exact), atol=1e-9)


def test_a_state_at_rest_is_refused(device, trained) -> None:
    still = trained.chart.amplitudes * (np.arange(len(trained.chart.amplitudes)) != 4)[:, None]
    with pytest.raises(SolveError, match="training state 4 is the body at rest"):
        sampled(mode_points(device.body, *trained.chart.basis), still, tolerance=1e-2, most=10)
