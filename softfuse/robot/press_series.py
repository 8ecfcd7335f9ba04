"""From a plan and a config to the cases of a sweep, and to the robot that is pressed in them."""

import math
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from jaxtyping import Float

from softfuse.errors import ConfigError
from softfuse.functional.chart import facing
from softfuse.mechanics.model import Model
from softfuse.mechanics.reading import AbstractReading, AnswerReading, ShapeReading
from softfuse.robot.press_plan import SweepPlan, check_count
from softfuse.robot.robot import Robot
from softfuse.robot.settings import RobotSettings


@dataclass(frozen=True)
class Series:
    """What is the same in some cases, and the forces in which they differ.

    number: of the first case; modulus_factor: of all moduli; cables: the shortening [m] or tension [N] of
    each; places: of each contact, x and y [m] of a disc's middle or the name of an electrode; forces:
    ascending, of each contact [N].
    """

    number: int
    modulus_factor: float
    cables: tuple[float, ...]
    places: tuple[tuple[float, float] | str, ...]
    forces: tuple[float, ...]


def build_series(plan: SweepPlan, config: RobotSettings) -> list[Series]:
    """The series of a plan, one after the other; the number of each first case counts from 0.

    Raises ConfigError with the plan's file and key when the plan does not suit the robot.
    """
    levels = _cable_levels(plan, config)
    forces = plan.forces.all
    sets = plan.places.sets(plan, config)
    check_count(plan, len(plan.modulus_factors) * math.prod(map(len, levels)) * len(sets) * len(forces))
    every = product(plan.modulus_factors, product(*levels), sets)
    return [
        Series(k * len(forces), factor, cables, places, forces)
        for k, (factor, cables, places) in enumerate(every)
    ]


def places_of(config: RobotSettings, series: Series) -> Float[np.ndarray, "c 3 3"]:
    """The places (c, 3, 3) of a series."""
    contact, named = config.contact(), config.places
    if contact.direction is not None:
        points = [(*place, 0.0) for place in series.places if not isinstance(place, str)]
        return facing(np.array(points), contact.direction)
    return np.array([named[place] for place in series.places if isinstance(place, str)])


def shortened_cables(plan: SweepPlan, config: RobotSettings) -> tuple[bool, ...]:
    """Of each of the config's cables, whether the plan shortens it; it is pulled otherwise."""
    by_length = {cable.name for cable in plan.cables if cable.shortening is not None}
    return tuple(cable.name in by_length for cable in config.cables)


def swept_model(robot: Robot, shortened: tuple[bool, ...]) -> Model:
    """The model of a robot with those of its cables shortened instead of pulled, whose readings are those of
    its parts: what answers each cable, the change of volume of each chamber, the pressure of sealed gas.
    """
    drives, cables = robot.addresses.drives, robot.settings.cables
    by_length = [cable.name for cable, on in zip(cables, shortened, strict=True) if on]
    readings: list[AbstractReading] = [AnswerReading((drives[each.name],)) for each in cables]
    readings += [ShapeReading(part.cavity) for part in robot.parts.chambers.values()]
    readings += [AnswerReading((drives[name],)) for name, part in robot.parts.chambers.items() if part.sealed]
    return replace(robot.model, actuators=robot.shortened(by_length), readings=tuple(readings))


def with_moduli(model: Model, config: RobotSettings, factor: float) -> Model:
    """A robot of a config with all moduli of all materials multiplied by a factor."""
    scaled = (each.model_copy(update=each.stiffness_times(factor)) for each in config.body.materials)
    body = model.body.full.with_materials([each.material() for each in scaled])
    # As if it had been built of these materials.
    return replace(model, body=replace(body, pressure_unit=factor * body.pressure_unit))


def _cable_levels(plan: SweepPlan, config: RobotSettings) -> list[tuple[float, ...]]:
    names = [cable.name for cable in config.cables]
    levels: dict[str, tuple[float, ...]] = dict.fromkeys(names, (0.0,))
    for k, cable in enumerate(plan.cables):
        key = f"{plan.path}: cable[{k}].name"
        if cable.name not in names:
            quoted = ", ".join(f'"{name}"' for name in names)
            known = f"its cables are {quoted}" if names else "it has none"
            raise ConfigError(f'{key}: {config.path} has no cable "{cable.name}", {known}')
        if cable.name in [other.name for other in plan.cables[:k]]:
            raise ConfigError(f'{key}: the cable "{cable.name}" is given twice')
        levels[cable.name] = cable.all
    return list(levels.values())
