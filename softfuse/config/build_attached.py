"""From settings to the loads that are always on a body, and to the points of it that are watched."""

from collections.abc import Sequence

import numpy as np

from softfuse.body.base import AbstractBody
from softfuse.config.attached import surface_tolerance
from softfuse.config.device import DeviceConfig
from softfuse.errors import ConfigError
from softfuse.functional.cavity import Cavity
from softfuse.functional.material_points import MaterialPoints
from softfuse.mechanics.load import AbstractLoad


def build_attached(
    config: DeviceConfig, body: AbstractBody, cavities: Sequence[Cavity]
) -> tuple[AbstractLoad, ...]:
    """The cables in their order, then the gas that is sealed in the cavities, on a body at rest.

    Raises ConfigError with the key's path for a guide outside the body or cavities of another mesh.
    """
    attached: list[AbstractLoad] = []
    for k, cable in enumerate(config.cables):
        with config.told(f"cable[{k}]"):
            attached.append(cable.load(body))
    if config.gas is not None:
        with config.told("gas"):
            attached.append(config.gas.load(body, cavities))
    return tuple(attached)


def build_points(config: DeviceConfig, body: AbstractBody) -> MaterialPoints:
    """The points of [[point]] in their order, none or more; ConfigError for one outside the body."""
    with config.told("point"):
        points = np.array([point.at for point in config.points])
        return MaterialPoints.embedded(body, points, within=surface_tolerance(body))


def build_centreline(config: DeviceConfig, body: AbstractBody) -> MaterialPoints:
    """The points of [centreline] from base to tip; ConfigError without any, or for one outside the body."""
    if config.centreline is None:
        raise ConfigError(f"{config.path}: centreline: missing, needed to tell how the body bends")
    with config.told("centreline.points"):
        points = np.array(config.centreline.points)
        return MaterialPoints.embedded(body, points, within=surface_tolerance(body))
