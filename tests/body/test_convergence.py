"""How fast the error falls with the mesh, and which elements lock near ν = 0.5: manufactured solutions.

A map x(X) is made the solution by its displacements on the boundary and the dead body force
b = −Div P(∂x/∂X). The error is ‖u_h − u‖ in L2 over the unit cube, integrated with 125 points a tetrahedron;
it must fall as h² (linear elements) and h³ (quadratic). The vortex u = curl(ψ e_z) keeps the volume, so its
stress does not grow with λ: an element that follows it worse as ν → 0.5 locks.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body import LINEAR, QUADRATIC, TAYLOR_HOOD, Body, mesh_for
from softfuse.body.shape import linear, quadratic
from softfuse.material import NeoHookean


def _bend(x):
    """Large strains, with volume changes of a few percent (far more, and ν = 0.49 would mean cavitation)."""
    s = jnp.sin(2.0 * x)
    sheared = jnp.array([x[0] + 0.12 * s[1] * s[2], x[1] + 0.12 * jnp.cos(2.0 * x[0]) * s[2], x[2]])
    return sheared + jnp.array([0.0, 0.0, 0.02]) * jnp.prod(s)


def _vortex(x):
    """Small, so that the second-order change of volume times λ stays far below the shear stress."""
    across = jax.grad(lambda y: 1e-6 * jnp.prod(jnp.sin(jnp.pi * y) ** 2))(x)
    return x + jnp.array([across[1], -across[0], 0.0])


def _gauss(n: int = 5) -> tuple[np.ndarray, np.ndarray]:
    """Conical product rule: barycentric points (n³, 4), weights (n³,) of sum 1, exact to degree 2n − 3."""
    t, w = np.polynomial.legendre.leggauss(n)
    t, w = 0.5 * (t + 1), 0.5 * w
    a, b, c = np.meshgrid(t, t, t, indexing="ij")
    x, y, z = a, b * (1 - a), c * (1 - a) * (1 - b)
    weight = 6 * np.einsum("i,j,k->ijk", w, w, w) * (1 - a) ** 2 * (1 - b)
    return np.stack([1 - x - y - z, x, y, z], axis=-1).reshape(-1, 4), weight.ravel()


POINTS, WEIGHTS = _gauss()


@jax.jit
def _by_map(law, points, which):
    """Displacement, body force [N/m³] and pressure of each map at points (p, 3)."""

    def state(mapping, x):
        def stress(y):
            return jax.grad(law.energy)(jax.jacfwd(mapping)(y))

        force = -jnp.trace(jax.jacfwd(stress)(x), axis1=1, axis2=2)
        return mapping(x) - x, force, law.lame * law.dilatation(jax.jacfwd(mapping)(x))

    return jax.lax.switch(
        which, [jax.vmap(lambda x, m=mapping: state(m, x)) for mapping in (_bend, _vortex)], points
    )


@pytest.fixture(scope="module")
def errors(irregular, equilibrate) -> Callable[..., tuple[float, float]]:
    """errors(element, n, ν, map): L2 errors of displacement and pressure over the norms of the exact ones."""

    def measure(element, n, poisson, which):
        law = NeoHookean.from_young(1.0, poisson)
        mesh = mesh_for(element, irregular(n))
        body = Body.from_mesh(mesh, [law], np.arange(len(mesh.nodes)) == 0, element=element)
        corners = mesh.nodes[mesh.tets[:, :4]]
        points = np.einsum("qa,eai->eqi", POINTS, corners)
        u, force, p = (np.asarray(v) for v in _by_map(law, points.reshape(-1, 3), which))
        u, force, p = u.reshape(points.shape), force.reshape(points.shape), p.reshape(points.shape[:2])
        volume = np.asarray(body.weights).sum(axis=1)[:, None] * WEIGHTS
        values = np.asarray(linear(POINTS) if element.order == 1 else quadratic(POINTS))
        index = np.asarray(body.displacement_index)
        load = np.zeros(body.n + 1)
        np.add.at(load, index[mesh.tets], np.einsum("eq,qa,eqi->eai", volume, values, force))
        nodal, _, level = (np.asarray(v) for v in _by_map(law, mesh.nodes, which))
        start = np.zeros(body.n + 1)
        start[index] = nodal
        if element.pressures:
            corners_of = np.asarray(body.element_unknowns)[:, 30:]
            start[corners_of] = level[mesh.tets[:, :4]] / float(body.pressure_unit)
        boundary = np.any((mesh.nodes == 0.0) | (mesh.nodes == 1.0), axis=1)
        held = np.zeros(body.n + 1, bool)
        held[index[boundary]] = True
        z = equilibrate(body, start[:-1], np.flatnonzero(~held[:-1]), load[:-1], tolerance=1e-13)
        found = np.einsum("qa,eai->eqi", values, np.asarray(body.displacement(jnp.asarray(z)))[mesh.tets])
        missed = np.sqrt(np.sum(volume[..., None] * (found - u) ** 2) / np.sum(volume[..., None] * u**2))
        if not element.pressures:
            return missed, np.nan
        corner = float(body.pressure_unit) * z[np.asarray(body.element_unknowns)[:, 30:]]
        gap = np.einsum("qa,ea->eq", POINTS, corner) - p
        return missed, np.sqrt(np.sum(volume * gap**2) / np.sum(volume * p**2))

    return measure


@pytest.mark.slow
@pytest.mark.parametrize(
    ("element", "poisson", "which", "sizes", "slope"),
    [
        (LINEAR, 0.3, 0, (3, 4, 6), 2.0),
        (QUADRATIC, 0.3, 0, (3, 4, 6), 3.0),
        (TAYLOR_HOOD, 0.3, 0, (3, 4, 6), 3.0),
        (TAYLOR_HOOD, 0.49, 1, (5, 6, 8), 3.0),  # the vortex is smaller: coarser meshes do not see it
    ],
    ids=lambda v: getattr(v, "name", str(v)),
)
def test_slope_of_the_error(errors, element, poisson, which, sizes, slope) -> None:
    missed = np.array([errors(element, n, poisson, which) for n in sizes])
    fitted = -np.polyfit(np.log(sizes), np.log(missed[:, 0]), 1)[0]
    assert abs(fitted - slope) < 0.15
    if element.pressures:
        assert -np.polyfit(np.log(sizes), np.log(missed[:, 1]), 1)[0] > 1.8


@pytest.mark.slow
def test_taylor_hood_does_not_lock_where_linear_does(errors) -> None:
    mixed = [errors(TAYLOR_HOOD, 4, poisson, 1)[0] for poisson in (0.3, 0.49, 0.4999)]
    plain = [errors(LINEAR, 6, poisson, 1)[0] for poisson in (0.3, 0.49, 0.4999)]
    assert max(mixed) < 1.1 * mixed[0] < 0.12
    assert plain[0] < 0.35
    assert plain[2] > 0.9
