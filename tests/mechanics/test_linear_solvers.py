"""Every linear solver solves the tangent of a strained body as numpy does, and says when it cannot."""

import importlib.util
import os
import subprocess
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body import QUADRATIC, TAYLOR_HOOD, Body, mesh_for
from softfuse.errors import SolveError
from softfuse.material import NeoHookean
from softfuse.mechanics import Multifrontal, tangent_inverse
from softfuse.mechanics.dense import Dense
from softfuse.mechanics.dissection import dissect
from softfuse.mechanics.pardiso import Pardiso
from softfuse.mechanics.sparse import SparseCholesky, SparseLU
from softfuse.mesh.tetmesh import tet_mesh

_tangents = jax.jit(Body.element_tangents)
_solved = eqx.filter_jit(lambda solver, tangents, rhs: solver.solve(solver.factor(tangents), rhs))


def _assembled(body: Body, tangents) -> np.ndarray:
    """K (n, n) by numpy, element by element."""
    matrix = np.zeros((body.n + 1, body.n + 1))
    for unknowns, part in zip(np.asarray(body.element_unknowns), np.asarray(tangents), strict=True):
        matrix[np.ix_(unknowns, unknowns)] += part
    return matrix[:-1, :-1]


@pytest.fixture(scope="module")
def body(box) -> Body:
    """A Taylor-Hood body that is cut several times: 144 tets, some 700 unknowns."""
    mesh = mesh_for(TAYLOR_HOOD, box(*(0.02 * np.linspace(0.0, 1.0, k) ** 1.1 for k in (5, 4, 3))))
    return Body.from_mesh(mesh, [NeoHookean.from_young(1e5, 0.49)], mesh.nodes[:, 2] == 0.0)


@pytest.fixture(scope="module")
def stiff(body) -> Body:
    """The same mesh with quadratic displacement elements, for Cholesky."""
    mesh = tet_mesh(body.rest, body.tets)
    return Body.from_mesh(mesh, [NeoHookean.from_young(1e5, 0.3)], mesh.nodes[:, 2] == 0.0, element=QUADRATIC)


@pytest.mark.parametrize(
    "kind, which",
    [
        (Multifrontal, "body"),
        (Dense, "body"),
        (SparseLU, "body"),
        (Multifrontal, "stiff"),
        (SparseCholesky, "stiff"),
    ],
)
def test_solves_several_right_hand_sides_as_numpy_does(kind, which, request, generic) -> None:
    body = request.getfixturevalue(which)
    tangents = _tangents(body, generic(body, 0))
    rhs = np.random.default_rng(1).normal(size=(body.n, 3))
    exact = np.linalg.solve(_assembled(body, tangents), rhs)
    x = np.asarray(_solved(kind.plan(body), tangents, rhs))
    np.testing.assert_allclose(x, exact, rtol=0, atol=1e-9 * np.abs(exact).max())
    displacements = slice(0, body.n_displacements)
    np.testing.assert_allclose(
        x[displacements], exact[displacements], rtol=0, atol=1e-9 * np.abs(exact[displacements]).max()
    )


def test_a_factor_serves_as_often_as_needed(body, generic) -> None:
    """Factored and solved in separate programs, and one right-hand side after the other."""
    solver = Multifrontal.plan(body)
    tangents = _tangents(body, generic(body, 0))
    rhs = np.random.default_rng(2).normal(size=(body.n, 3))
    factor = eqx.filter_jit(solver.factor)(tangents)
    one = eqx.filter_jit(solver.solve)
    singly = np.hstack([one(factor, rhs[:, k : k + 1]) for k in range(3)])
    np.testing.assert_allclose(singly, _solved(solver, tangents, rhs), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("kind", [Multifrontal, Dense])
def test_batch_of_tangents(kind, pad, generic) -> None:
    body, _ = pad()
    tangents = jnp.stack([_tangents(body, generic(body, k)) for k in range(3)])
    rhs = np.random.default_rng(3).normal(size=(3, body.n, 1))
    solver = kind.plan(body)
    batch = jax.jit(jax.vmap(lambda t, b: solver.solve(solver.factor(t), b)))(tangents, rhs)
    exact = [np.linalg.solve(_assembled(body, t), b) for t, b in zip(tangents, rhs, strict=True)]
    np.testing.assert_allclose(batch, exact, rtol=0, atol=1e-9 * np.abs(exact).max())


def test_dissection_eliminates_every_unknown_once_and_assembles_every_element_once(body) -> None:
    batches = dissect(
        np.asarray(body.element_unknowns),
        body.element.local_nodes,
        np.asarray(body.tets),
        np.asarray(body.rest),
        body.n,
    )
    pivots = np.concatenate([b.pivots.ravel() for b in batches])
    np.testing.assert_array_equal(np.sort(pivots[pivots < body.n]), np.arange(body.n))
    elements = np.concatenate([b.elements for b in batches])
    np.testing.assert_array_equal(np.sort(elements), np.arange(len(body.tets)))
    assert sum(len(b.pivots) for b in batches) >= 8  # the test body is really cut, again and again
    assert max(b.pivots.shape[1] for b in batches) < body.n / 2


@pytest.mark.parametrize("kind", [Multifrontal, Dense])
def test_a_singular_tangent_gives_no_number(kind, pad, generic) -> None:
    """Elements without stiffness around one corner: its node's rows of K are zero."""
    body, _ = pad()
    corner = int(np.argmax(np.asarray(body.rest).sum(axis=1)))
    around = np.any(np.asarray(body.tets) == corner, axis=1)
    tangents = jnp.where(around[:, None, None], 0.0, _tangents(body, generic(body, 0)))
    assert np.linalg.matrix_rank(_assembled(body, tangents)) < body.n
    x = _solved(kind.plan(body), tangents, np.ones((body.n, 1)))
    assert not np.all(np.isfinite(x))


def test_cholesky_refuses_a_saddle(body) -> None:
    with pytest.raises(SolveError, match="taylor-hood elements is indefinite.*use Multifrontal or SparseLU"):
        SparseCholesky.plan(body)


@pytest.mark.parametrize(
    "kind, which, factor, words",
    [(SparseCholesky, "stiff", -1.0, "not positive definite"), (SparseLU, "body", 0.0, "singular")],
)
def test_sparse_solvers_raise_out_of_jit(kind, which, factor, words, request, generic) -> None:
    body = request.getfixturevalue(which)
    tangents = factor * _tangents(body, generic(body, 0))
    with pytest.raises(jax.errors.JaxRuntimeError, match=words):
        jax.block_until_ready(_solved(kind.plan(body), tangents, np.ones((body.n, 3))))


@pytest.mark.slow
def test_a_stale_factor_is_corrected_by_refinement(pad, generic) -> None:
    """Each refinement shrinks the error by about the factor's distance from the tangent."""
    body, _ = pad()
    solver = Dense.plan(body)
    z = generic(body, 0)
    stale = eqx.filter_jit(solver.factor)(_tangents(body, 0.8 * z))
    rhs = np.random.default_rng(4).normal(size=(body.n, 2))
    exact = np.linalg.solve(_assembled(body, _tangents(body, z)), rhs)
    errors = []
    for refinements in (0, 1, 4):
        inverse = jax.jit(tangent_inverse(solver, stale, body.tangent_action(z), refinements=refinements))
        errors.append(np.linalg.norm(inverse(rhs) - exact) / np.linalg.norm(exact))
    assert 1e-4 < errors[0] < 0.3
    assert errors[1] < 2 * errors[0] ** 2
    assert errors[2] < 10 * errors[0] ** 5


@pytest.mark.slow
def test_derivatives_of_the_inverse(pad, generic) -> None:
    """In the unknowns z and the stiffness: jvp against differences, vjp against jvp."""
    body, _ = pad()
    solver = Dense.plan(body)
    random = np.random.default_rng(5)
    rhs, cotangent = random.normal(size=(2, body.n, 1))
    z, z_dot = generic(body, 0), generic(body, 1)

    def solved(z, factor_of_young):
        law = body.materials[0]
        softer = body.with_materials([NeoHookean(law.mu * factor_of_young, law.lame * factor_of_young)])
        factor = solver.factor(jax.lax.stop_gradient(softer.element_tangents(z)))
        return tangent_inverse(solver, factor, softer.tangent_action(z), refinements=0)(rhs)

    compiled = jax.jit(solved)
    one = jnp.asarray(1.0)
    _, slope = jax.jit(lambda *dot: jax.jvp(solved, (z, one), dot))(z_dot, 0.3 * one)
    h = 1e-5
    difference = (compiled(z + h * z_dot, 1 + 0.3 * h) - compiled(z - h * z_dot, 1 - 0.3 * h)) / (2 * h)
    np.testing.assert_allclose(slope, difference, rtol=0, atol=1e-6 * np.abs(slope).max())
    pulled = jax.jit(lambda bar: jax.vjp(solved, z, one)[1](bar))(cotangent)
    backward = jnp.vdot(pulled[0], z_dot) + 0.3 * pulled[1]
    np.testing.assert_allclose(backward, np.vdot(cotangent, slope), rtol=1e-10)


def test_pardiso_is_right_or_its_extra_is_named(body, generic) -> None:
    if importlib.util.find_spec("pardiso_mkl_jax") is None:
        with pytest.raises(SolveError, match=r"softfuse\[mkl\]"):
            Pardiso.plan(body)
        return
    tangents = _tangents(body, generic(body, 0))
    rhs = np.random.default_rng(1).normal(size=(body.n, 3))
    exact = np.linalg.solve(_assembled(body, tangents), rhs)
    x = np.asarray(_solved(Pardiso.plan(body), tangents, rhs))
    np.testing.assert_allclose(x, exact, rtol=0, atol=1e-9 * np.abs(exact).max())


_AT_ONCE = """
import threading
import jax
import jax.numpy as jnp
jax.config.update("jax_enable_x64", True)
from softfuse.body import TAYLOR_HOOD, Body, mesh_for
from softfuse.mechanics import Multifrontal
from softfuse.material import NeoHookean
from softfuse.mesh.pad import PadGeometry, pad_mesh

geometry = PadGeometry((0.06, 0.04, 0.018), (0.02, 0.02, 0.006), ((0.0, 0.0),), 0.006)
mesh = mesh_for(TAYLOR_HOOD, pad_mesh(geometry, 0.02, 0.02))
body = Body.from_mesh(mesh, [NeoHookean.from_young(6e5, 0.49)], mesh.nodes[:, 2] < 1e-9)
tangents = jax.jit(Body.element_tangents)(body, jnp.zeros(body.n))
plan = Multifrontal.plan(body)
factor = jax.jit(lambda tangents: plan.factor(tangents))
jax.block_until_ready(factor(tangents))

def often():
    for _ in range(10):
        jax.block_until_ready(factor(tangents))

threads = [threading.Thread(target=often) for _ in range(4)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
"""


def test_programs_that_factor_at_once_do_not_wait_for_each_other_for_ever() -> None:
    # LAPACK's own threads would only slow it down.
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    subprocess.run([sys.executable, "-c", _AT_ONCE], check=True, timeout=120, env=environment)
