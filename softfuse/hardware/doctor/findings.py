"""What is found out about this computer: what is installed, what computes (double precision, the solvers, the
cache, the viewer), and a robot's configuration.
"""

import importlib
import importlib.metadata
import os
import platform
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from packaging.requirements import Requirement

from softfuse.errors import ConfigError, SoftfuseError
from softfuse.robot.file import load
from softfuse.robot.settings import RobotSettings

State = Literal["ok", "note", "problem"]
EXTRAS = {
    "viz": "the live view",
    "sweep": "softfuse sweep",
    "mkl": "the solver of Intel's MKL",
    "dev": "the tests",
}
"""Extras, and what needs them."""
_LEAST = 1e-9
"""The largest relative error that the solution of a small system may have."""


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    about: what; state: a note is what may be as it is; said: how it is; remedy: what to do, "" where nothing
    is to be done; measured: the numbers behind it, for machines.
    """

    about: str
    state: State
    said: str
    remedy: str = ""
    measured: dict[str, object] = field(default_factory=dict)

    def as_json(self) -> dict[str, object]:
        """As it is told to machines."""
        told: dict[str, object] = {"about": self.about, "state": self.state, "said": self.said}
        if self.remedy:
            told["remedy"] = self.remedy
        return told | ({"measured": self.measured} if self.measured else {})


def well(findings: Sequence[Finding]) -> bool:
    """Whether there is no problem."""
    return all(finding.state != "problem" for finding in findings)


def check_config(config: Path) -> tuple[RobotSettings | None, list[Finding]]:
    """The settings in a file, None where they are wrong, and what is to be said of them."""
    try:
        settings = load(config)
    except ConfigError as error:
        lines = str(error).split("\n")
        return None, [
            Finding(str(config), "problem", line.removeprefix(f"{config}: "), "correct the file, or its name")
            for line in lines
        ]
    if not settings.sensors:
        return settings, [Finding(str(config), "note", "it has no [sensors]", "add them for live estimates")]
    heard = "" if settings.sources else "; it has no [[source]], --port listens to a device"
    return settings, [Finding(str(config), "ok", f"{settings.robot.name}{heard}")]


def check_installed() -> list[Finding]:
    """Python, softfuse and all that it depends on."""
    findings = [
        Finding("python", "ok", f"{platform.python_version()} on {sys.platform}, {platform.machine()}")
    ]
    try:
        package = importlib.metadata.distribution("softfuse")
    except importlib.metadata.PackageNotFoundError:
        return [
            *findings,
            Finding("softfuse", "problem", "it is not installed", "install it with pip install -e ."),
        ]
    findings.append(Finding("softfuse", "ok", package.version))
    return [*findings, *check_requirements(package.requires or [], installed_version)]


def installed_version(name: str) -> str | None:
    """The version of an installed package, None where there is none."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def check_requirements(
    requirements: Sequence[str], version_of: Callable[[str], str | None]
) -> Iterator[Finding]:
    """One finding for each requirement in the form of PEP 508; what only an extra needs is no problem."""
    for text in requirements:
        requirement = Requirement(text)
        extra = _extra(requirement)
        if extra is None and requirement.marker is not None and not requirement.marker.evaluate():
            continue  # not for this machine
        yield _check(requirement, extra, version_of(requirement.name))


def _check(requirement: Requirement, extra: str | None, version: str | None) -> Finding:
    wanted = f"{requirement.name}{requirement.specifier}"
    install = f"install it with pip install '{wanted}'"
    about = requirement.name if extra is None else f"{requirement.name} [{extra}]"
    if version is None:
        if extra is None:
            return Finding(about, "problem", "it is not installed", install)
        use = EXTRAS.get(extra, f"the extra {extra}")
        return Finding(
            about, "note", f"it is not installed, {use} needs it", f"pip install 'softfuse[{extra}]'"
        )
    if not requirement.specifier.contains(version, prereleases=True):
        return Finding(about, "problem", f"{version} is not {requirement.specifier}", install)
    return Finding(about, "ok", version, measured={"version": version})


def _extra(requirement: Requirement) -> str | None:
    """Which extra needs it, None where softfuse itself does."""
    marker = requirement.marker
    if marker is None or marker.evaluate({"extra": ""}):
        return None
    return next((extra for extra in EXTRAS if marker.evaluate({"extra": extra})), None)


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
