"""From settings to the mesh of the body: its nodes and tetrahedra, its cavities, the nodes that are held."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool

from softfuse.errors import ConfigError
from softfuse.mesh.chambers import check_fit, open_void
from softfuse.mesh.groups import group_nodes
from softfuse.mesh.morph import reshaped_cavities
from softfuse.mesh.shell import Shell
from softfuse.mesh.surface import Surface, cavities, outer_surface
from softfuse.mesh.tetmesh import TetMesh, linear, quadratic
from softfuse.robot.body import FixedSettings
from softfuse.robot.settings import RobotSettings

_TOUCH = 1e-6
"""Distance over the extent of the body up to which a node lies within the ranges of [body.fixed]."""


@dataclass(frozen=True, eq=False)
class RobotMesh:
    """Mesh of the element's order, its regions numbered as the materials; cavities; held nodes (n,).

    The cavities are in the order of the configuration, their normals point into the material.
    """

    mesh: TetMesh
    cavities: tuple[Surface, ...]
    fixed: Bool[np.ndarray, " n"]


def build_mesh(config: RobotSettings) -> RobotMesh:
    """The mesh that a configuration describes.

    Raises ConfigError with the key's path when the source gives no valid mesh, it has another number of
    cavities or of regions than the configuration, the cavities as made do not fit, or no node is fixed.
    """
    source, closed = config.body.source, [each for each in config.chambers if each.mouth is None]
    chambers: dict[str, Shell] = {}
    for k, cavity in enumerate(config.chambers):
        if cavity.file is not None:
            with config.told(f"chamber[{k}].file"):
                chambers[cavity.name] = source.chamber(cavity.file)
    drawn = [cavity.centre for cavity in closed]
    with config.told("body.source"):
        mesh = source.mesh(drawn, list(chambers.values()))
        outer_surface(mesh)
    centres, shifts, growths = (
        np.array([getattr(cavity, key) for cavity in closed]).reshape(-1, 3)
        for key in ("centre", "shift", "growth")
    )
    with config.told("chamber"):
        for cavity, wall in zip(closed, cavities(mesh, centres), strict=True):
            if cavity.name in chambers:
                check_fit(mesh, wall, chambers[cavity.name])
        if np.any(shifts) or np.any(growths):
            mesh = reshaped_cavities(mesh, shifts, growths, centres=centres)
        mesh = linear(mesh) if config.body.element == "linear" else quadratic(mesh)
        walls = iter(cavities(mesh, centres + shifts))
    found = []
    for k, cavity in enumerate(config.chambers):
        if cavity.mouth is None:
            found.append(next(walls))
        else:
            with config.told(f"chamber[{k}].mouth"):
                at = (np.array(each) for each in (cavity.centre, cavity.mouth.at, cavity.mouth.outwards))
                found.append(open_void(mesh, *at))
    return robot_mesh(config, mesh, found)


def robot_mesh(config: RobotSettings, mesh: TetMesh, cavities: Sequence[Surface]) -> RobotMesh:
    """A mesh of the element's order and its cavities, in the order of the configuration, as its robot's.

    For a mesh from elsewhere, such as that of a layout. Raises ConfigError when it has another number of
    regions than the configuration, or no node is fixed.
    """
    mesh = _with_numbered_regions(config, mesh)
    return RobotMesh(mesh, tuple(cavities), _fixed_nodes(config, mesh))


def _with_numbered_regions(config: RobotSettings, mesh: TetMesh) -> TetMesh:
    regions, number = np.unique(mesh.region, return_inverse=True)
    materials = len(config.body.materials)
    if len(regions) != materials:
        raise ConfigError(
            f"{config.path}: body.material: {materials} materials for the {len(regions)} regions "
            f"{regions.tolist()} of the mesh: give one [[body.material]] for each"
        )
    return replace(mesh, region=number.astype(np.int32))


def _fixed_nodes(config: RobotSettings, mesh: TetMesh) -> Bool[np.ndarray, " n"]:
    with config.told("body.fixed.group"):
        inside = _within(config.body.fixed, mesh)
    if not inside.any():
        low, high = (1e3 * end(mesh.nodes, axis=0) for end in (np.min, np.max))
        raise ConfigError(
            f"{config.path}: body.fixed: no node of the mesh is in these ranges (and group); it reaches from "
            f"{low.round(3).tolist()} to {high.round(3).tolist()} mm"
        )
    if inside.all():
        raise ConfigError(
            f"{config.path}: body.fixed: all nodes of the mesh are held: narrow the ranges or the group"
        )
    return inside


def _within(fixed: FixedSettings, mesh: TetMesh) -> Bool[np.ndarray, " n"]:
    margin = _TOUCH * np.ptp(mesh.nodes, axis=0).max()
    groups = fixed.group or ()
    inside = np.any([group_nodes(mesh, name) for name in groups], axis=0) if groups else margin >= 0.0
    inside = np.broadcast_to(inside, len(mesh.nodes)).copy()
    for axis, span in enumerate((fixed.x, fixed.y, fixed.z)):
        if span is not None:
            position = mesh.nodes[:, axis]
            inside &= (position >= span[0] - margin) & (position <= span[1] + margin)
    return inside
