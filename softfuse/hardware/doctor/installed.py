"""What is found out about what is installed."""

import importlib.metadata
import platform
import sys
from collections.abc import Callable, Iterator, Sequence

from packaging.requirements import Requirement

from softfuse.hardware.doctor.finding import Finding

EXTRAS = {
    "viz": "the live view",
    "sweep": "softfuse sweep",
    "mkl": "the solver of Intel's MKL",
    "dev": "the tests",
}
"""Extras, and what needs them."""


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
