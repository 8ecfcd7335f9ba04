"""What is found out about what computes: double precision, the solvers, the cache, the viewer."""

import importlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from softfuse.errors import SoftfuseError
from softfuse.hardware.doctor.finding import Finding

_LEAST = 1e-9
"""The largest relative error that the solution of a small system may have."""


def check_devices() -> list[Finding]:
    """Whether each device that JAX has computes in double precision."""
    import jax

    findings = []
    for device in jax.devices("cpu") + [d for d in jax.devices() if d.platform != "cpu"]:
        about = f"jax on {device.platform}:{device.id}"
        with jax.default_device(device):
            third = jax.numpy.asarray(1.0) / 3.0
            error = abs(float(third * 3.0 - 1.0)) + abs(float(third) - 1.0 / 3.0)
        if third.dtype == np.float64 and error < 1e-15:
            findings.append(Finding(about, "ok", f"float64, {device.device_kind}"))
        else:
            remedy = "unset JAX_ENABLE_X64, or set it to 1; mechanics needs double precision"
            findings.append(Finding(about, "problem", f"{third.dtype}, off by {error:.1g}", remedy))
    if all(device.platform == "cpu" for device in jax.devices()) and os.path.exists("/dev/nvidia0"):
        findings.append(
            Finding("jax on gpu", "note", "there is a GPU that JAX does not use", "pip install 'jax[cuda13]'")
        )
    return findings


def check_solvers() -> list[Finding]:
    """Whether each solver solves the tangent of a small strained block as a dense one does."""
    import equinox as eqx
    import jax

    from softfuse.body import QUADRATIC, TAYLOR_HOOD, Body, Element, mesh_for
    from softfuse.material import NeoHookean
    from softfuse.mechanics.linear_solver import AbstractLinearSolver
    from softfuse.mechanics.multifrontal import Multifrontal
    from softfuse.mechanics.sparse import SparseCholesky, SparseLU
    from softfuse.mesh.kuhn import kuhn_grid
    from softfuse.mesh.orientation import oriented
    from softfuse.mesh.tetmesh import tet_mesh

    planes = np.array([0.0, 0.01, 0.02]), np.array([0.0, 0.01]), np.array([0.0, 0.01])
    grid = kuhn_grid(planes, np.ones((2, 1, 1), bool), (0, 0, 0))
    block = oriented(tet_mesh(grid.nodes, grid.tets))

    def error_of(kind: type[AbstractLinearSolver], element: Element) -> float:
        mesh = mesh_for(element, block)
        body = Body.from_mesh(
            mesh, [NeoHookean.from_young(1e5, 0.45)], mesh.nodes[:, 2] == 0.0, element=element
        )
        random = np.random.default_rng(0)
        z = 1e-4 * random.normal(size=body.n) * (np.arange(body.n) < body.n_displacements)
        solution = random.normal(size=(body.n, 2))
        rhs = jax.jit(lambda b, z, x: b.tangent_action(z)(x))(body, z, solution)

        @eqx.filter_jit
        def solved(solver, z, rhs):
            return solver.solve(solver.factor(body.element_tangents(z)), rhs)

        found = np.asarray(solved(kind.plan(body), z, rhs))
        # The displacements: how well a pressure is determined depends on the mesh.
        part = slice(0, body.n_displacements)
        return float(np.abs(found - solution)[part].max() / np.abs(solution[part]).max())

    return [
        _solver(name, lambda kind=kind, element=element: error_of(kind, element))
        for name, kind, element in (
            ("solver", Multifrontal, TAYLOR_HOOD),
            ("solver CHOLMOD", SparseCholesky, QUADRATIC),
            ("solver KLU", SparseLU, TAYLOR_HOOD),
        )
    ]


def _solver(name: str, error_of: Callable[[], float]) -> Finding:
    remedy = "reinstall jax, jaxlib and sparsax in the versions that pip chooses for softfuse"
    try:
        error = error_of()
    except (ImportError, RuntimeError, SoftfuseError) as failure:
        return Finding(name, "problem", f"it does not run: {failure}", remedy)
    if not error < _LEAST:
        return Finding(name, "problem", f"the solution is off by {error:.1g}", remedy)
    return Finding(name, "ok", f"right to {error:.1g}", measured={"error": error})


def check_cache() -> Finding:
    """Where compiled programs are kept, and whether they can be."""
    import jax

    if not jax.config.values["jax_enable_compilation_cache"]:
        told = "compiled programs are not kept, as JAX_ENABLE_COMPILATION_CACHE says"
        return Finding("cache", "note", told)
    folder = jax.config.values["jax_compilation_cache_dir"]
    if not folder:
        told = "compiled programs are not kept, every start compiles anew"
        remedy = "make the user's cache folder writable, or set JAX_COMPILATION_CACHE_DIR"
        return Finding("cache", "problem", told, remedy)
    if "://" in str(folder):
        return Finding("cache", "note", f"{folder}, not tried")
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"softfuse")
    except OSError as error:
        told = f"{folder} cannot be written ({error.strerror or error}), every start compiles anew"
        remedy = "give it to your user, or set JAX_COMPILATION_CACHE_DIR to a folder of yours"
        return Finding("cache", "problem", told, remedy)
    size = sum(path.stat().st_size for path in Path(folder).glob("*") if path.is_file())
    return Finding("cache", "ok", f"{folder}, {1e-6 * size:.0f} MB", measured={"bytes": size})


def check_viewer() -> Finding:
    """Whether the live view is there and can be loaded."""
    try:
        rerun = importlib.import_module("rerun")
    except ModuleNotFoundError:
        return Finding("viewer", "note", "it is not installed", "pip install 'softfuse[viz]' for --view")
    except (ImportError, OSError) as error:
        return Finding("viewer", "problem", f"it cannot be loaded: {error}", "pip install -U 'softfuse[viz]'")
    return Finding("viewer", "ok", f"rerun {rerun.__version__}")
