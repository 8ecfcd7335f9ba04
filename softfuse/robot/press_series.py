"""From a plan and a config to the cases of a sweep, and to the robot that is pressed in them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from softfuse.errors import ConfigError
from softfuse.functional.chart import facing
from softfuse.functional.workspace import nearest_places
from softfuse.mechanics.model import Model
from softfuse.mechanics.reading import AbstractReading, AnswerReading, ShapeReading
from softfuse.robot.names import named_places
from softfuse.robot.press_plan import Middle, SweepPlan, check_count
from softfuse.robot.robot import Robot
from softfuse.robot.settings import RobotSettings

Driven = Literal["shortening", "tension", "pressure"]
"""What is prescribed of an actuator."""


@dataclass(frozen=True)
class Series:
    """What is the same in some cases, and the forces or depths in which they differ.

    number: of the first case; modulus_factor: of all moduli; driven: the shortening [m], tension [N] or gauge
    pressure [Pa] of each of the actuators that `driven_of` names; places: of each contact, coordinates [m],
    see `press_plan.Middle`, or the name of an electrode; levels: ascending, of each contact [N or m].
    """

    number: int
    modulus_factor: float
    driven: tuple[float, ...]
    places: tuple[Middle | str, ...]
    levels: tuple[float, ...]


def build_series(plan: SweepPlan, config: RobotSettings) -> list[Series]:
    """The series of a plan, one after the other; the number of each first case counts from 0.

    Raises ConfigError with the plan's file and key when the plan does not suit the robot.
    """
    driven = _driven_levels(plan, config)
    levels = plan.levels
    sets: Sequence[tuple[Middle | str, ...]] = [()] if plan.places is None else plan.places.sets(plan, config)
    count = math.prod(map(len, driven)) * len(sets) * len(levels)
    check_count(plan, len(plan.modulus_factors) * count)
    every = product(plan.modulus_factors, product(*driven), sets)
    return [
        Series(k * len(levels), factor, values, places, levels)
        for k, (factor, values, places) in enumerate(every)
    ]


def places_of(
    config: RobotSettings,
    series: Series,
    contact: str | None = None,
    surface: tuple[Float[np.ndarray, "k 3"], Int[np.ndarray, "f c"]] | None = None,
) -> Float[np.ndarray, "c 3 3"]:
    """The places (c, 3, 3) of a contact in a series; `surface`: nodes (k, 3) m at rest and outward faces (f,
    3 or 6), of a contact that may be anywhere on it.
    """
    if not series.places:
        return np.zeros((0, 3, 3))
    found = config.contact(contact)
    named = named_places(config, found.name)
    points = [place for place in series.places if not isinstance(place, str)]
    if not points:
        return np.array([named[place] for place in series.places if isinstance(place, str)])
    if found.direction is not None:
        return facing(np.array([(*point, 0.0) for point in points]), found.direction)
    assert surface is not None  # the plan has told
    return nearest_places(*surface, np.array(points))


def driven_of(plan: SweepPlan, config: RobotSettings) -> dict[str, Driven]:
    """What is prescribed of each cable, and of each chamber that is driven; raises ConfigError for others in
    the plan.
    """
    cables, chambers = [[each.name for each in named] for named in (plan.cables, plan.chambers)]
    pressurised = [each.name for each in config.chambers if each.gas == "driven"]
    _check_names(plan, "cable", cables, [each.name for each in config.cables], config)
    _check_names(plan, "chamber", chambers, pressurised, config)
    by_length = {cable.name for cable in plan.cables if cable.shortening is not None}
    found: dict[str, Driven] = {}
    for cable in config.cables:
        found[cable.name] = "shortening" if cable.name in by_length else "tension"
    for name in pressurised:
        found[name] = "pressure"
    return found


def swept_model(
    robot: Robot, driven: Mapping[str, Driven], contact: str | None = None, *, by_depth: bool = False
) -> Model:
    """The model of a robot whose actuators are driven so, and of which one contact may press, by its depth or
    its force; its readings are those of its parts: what answers each cable, the change of volume of each
    chamber, the pressure of sealed gas.

    Raises ConfigError for a contact that has no depth.
    """
    drives, cables = robot.addresses.drives, robot.settings.cables
    by_length = [name for name, what in driven.items() if what == "shortening"]
    contacts = robot.model.contacts
    if contacts and (contact is not None or len(contacts) == 1):
        chosen = robot.settings.contact(contact)
        kind = contacts[robot.settings.contacts.index(chosen)]
        deep = kind.at_depth() if by_depth else kind
        if deep is None:
            raise ConfigError(
                f'{robot.settings.path}: contact "{chosen.name}" is not rigid and has no depth: give forces'
            )
        contacts = (deep,)
    readings: list[AbstractReading] = [AnswerReading((drives[each.name],)) for each in cables]
    readings += [ShapeReading(part.cavity) for part in robot.parts.chambers.values()]
    readings += [AnswerReading((drives[name],)) for name, part in robot.parts.chambers.items() if part.sealed]
    return replace(
        robot.model,
        contacts=contacts,
        slots=(),
        actuators=robot.shortened(by_length),
        readings=tuple(readings),
    )


def with_moduli(model: Model, config: RobotSettings, factor: float) -> Model:
    """A robot of a config with all moduli of all materials multiplied by a factor."""
    scaled = (each.model_copy(update=each.stiffness_times(factor)) for each in config.body.materials)
    body = model.body.full.with_materials([each.material() for each in scaled])
    # As if it had been built of these materials.
    return replace(model, body=replace(body, pressure_unit=factor * body.pressure_unit))


def _driven_levels(plan: SweepPlan, config: RobotSettings) -> list[tuple[float, ...]]:
    """Of each actuator in the order of `driven_of`; what is not in the plan stays as it is at rest."""
    levels: dict[str, tuple[float, ...]] = dict.fromkeys(driven_of(plan, config), (0.0,))
    for cable in plan.cables:
        given = cable.shortening or cable.tension
        assert given is not None  # its settings have told
        levels[cable.name] = given.all
    limits = {each.name: (each.lowest, each.highest) for each in config.chambers}
    for k, chamber in enumerate(plan.chambers):
        levels[chamber.name] = chamber.pressure.all
        low, high = limits[chamber.name]
        if levels[chamber.name][0] < low or (high is not None and levels[chamber.name][-1] > high):
            raise ConfigError(
                f'{plan.path}: chamber[{k}].pressure: beyond what "{chamber.name}" may be driven to, '
                f"{1e-3 * low:g} to {1e-3 * (high or 0.0):g} kPa"
            )
    return list(levels.values())


def _check_names(
    plan: SweepPlan, key: str, names: Sequence[str], known: Sequence[str], config: RobotSettings
) -> None:
    for k, name in enumerate(names):
        at = f"{plan.path}: {key}[{k}].name"
        if name not in known:
            quoted = ", ".join(f'"{each}"' for each in known)
            there = f"it could be {quoted}" if known else "it has none"
            raise ConfigError(f'{at}: {config.path} has no {key} "{name}" that is driven, {there}')
        if name in names[:k]:
            raise ConfigError(f'{at}: the {key} "{name}" is given twice')
