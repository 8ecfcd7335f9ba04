"""From settings to the loads that are always on a body, and to the points of it that are watched."""

from collections.abc import Sequence

import numpy as np

from softfuse.body.base import AbstractBody
from softfuse.robot.settings import RobotSettings
from softfuse.errors import ConfigError
from softfuse.functional.cavity import Cavity
from softfuse.functional.material_points import MaterialPoints
from softfuse.mechanics.load import AbstractLoad


def build_attached(
    config: RobotSettings, body: AbstractBody, cavities: Sequence[Cavity]
) -> tuple[AbstractLoad, ...]:
    """The cables in their order, then the gas that is sealed in the cavities, on a body at rest.

    Raises ConfigError with the key's path for a guide outside the body or cavities of another mesh.
    """
    attached: list[AbstractLoad] = []
    for k, cable in enumerate(config.cables):
        with config.told(f"cable[{k}].guides"):
            attached.append(cable.load(body))
    if config.gas is not None:
        with config.told("gas"):
            attached.append(config.gas.load(body, cavities))
    return tuple(attached)


def build_points(config: RobotSettings, body: AbstractBody) -> MaterialPoints:
    """The points of [[point]] in their order, none or more; ConfigError for one outside the body."""
    with config.told("point"):
        return MaterialPoints.embedded(body, np.array([point.at for point in config.points]))


def build_centreline(config: RobotSettings, body: AbstractBody) -> MaterialPoints:
    """The points of [centreline] from base to tip; ConfigError without any, or for one outside the body."""
    if config.centreline is None:
        raise ConfigError(f"{config.path}: centreline: missing, needed to tell how the body bends")
    with config.told("centreline.points"):
        return MaterialPoints.embedded(body, np.array(config.centreline.points))
