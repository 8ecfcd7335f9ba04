"""From a plan and a config to the cases of a sweep, and to the device that is pressed in them."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain, combinations, islice, product

import numpy as np
from jaxtyping import Float

from softfuse.body.body import Body
from softfuse.errors import ConfigError
from softfuse.functional.chart import facing
from softfuse.mechanics.cable import PulledCable, ShortenedCable
from softfuse.mechanics.model import Model
from softfuse.mechanics.reading import AbstractReading, AnswerReading, ShapeReading
from softfuse.robot.contacts import ContactSettings, WorkspaceSettings
from softfuse.robot.laws import materials_of
from softfuse.robot.press_plan import (
    DiscPlaces,
    ElectrodePlaces,
    GridPlaces,
    ListedPlaces,
    RandomPlaces,
    SweepPlan,
)
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


MOST_CASES = 1_000_000
_TRIES = 10_000
"""Draws of random places for a case, until they are far enough apart."""

Disc = tuple[float, float]
Sets = list[tuple[Disc, ...]] | list[tuple[str, ...]]


def build_series(plan: SweepPlan, config: RobotSettings) -> list[Series]:
    """The series of a plan, one after the other; the number of each first case counts from 0.

    Raises ConfigError with the plan's file and key when the plan does not suit the device.
    """
    levels = _cable_levels(plan, config)
    forces = plan.forces.all
    sets: Sets = _place_sets(plan, config)
    _check_count(plan, len(plan.modulus_factors) * math.prod(map(len, levels)) * len(sets) * len(forces))
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
    model, count, drives = robot.model, len(shortened), robot.addresses.drives
    cables = [
        ShortenedCable.of(cable, model.body) if by_length and isinstance(cable, PulledCable) else cable
        for cable, by_length in zip(model.actuators[:count], shortened, strict=True)
    ]
    readings: list[AbstractReading] = [AnswerReading((drives[each.name],)) for each in robot.settings.cables]
    readings += [ShapeReading(part.cavity) for part in robot.parts.chambers.values()]
    readings += [AnswerReading((drives[name],)) for name, part in robot.parts.chambers.items() if part.sealed]
    return replace(model, actuators=(*cables, *model.actuators[count:]), readings=tuple(readings))


def with_moduli(device: Model, config: RobotSettings, factor: float) -> Model:
    """A device of a config with all moduli of all materials multiplied by a factor."""
    scaled = tuple(each.model_copy(update=each.stiffness_times(factor)) for each in config.body.materials)
    settings = config.body.model_copy(update={"materials": scaled})
    materials = materials_of(settings)
    assert isinstance(device.body, Body)  # as devices are built from configurations
    body = device.body.with_materials(materials)
    # As if it had been built of these materials.
    return replace(device, body=replace(body, pressure_unit=factor * body.pressure_unit))


def _check_count(plan: SweepPlan, cases: int) -> None:
    if cases > MOST_CASES:
        raise ConfigError(f"{plan.path}: these are {cases} cases: plan at most {MOST_CASES}")


def _cable_levels(plan: SweepPlan, config: RobotSettings) -> list[tuple[float, ...]]:
    names = [cable.name for cable in config.cables]
    levels: dict[str, tuple[float, ...]] = dict.fromkeys(names, (0.0,))
    for k, cable in enumerate(plan.cables):
        key = f"{plan.path}: cable[{k}].name"
        if cable.name not in names:
            known = f"its cables are {_quoted(names)}" if names else "it has none"
            raise ConfigError(f'{key}: {config.path} has no cable "{cable.name}", {known}')
        if cable.name in [other.name for other in plan.cables[:k]]:
            raise ConfigError(f'{key}: the cable "{cable.name}" is given twice')
        levels[cable.name] = cable.all
    return list(levels.values())


def _place_sets(plan: SweepPlan, config: RobotSettings) -> Sets:
    places, contact = plan.places, config.contact()
    match contact.within, places:
        case None, ElectrodePlaces():
            return _electrode_sets(places, plan, config)
        case None, _:
            raise ConfigError(
                f'{plan.path}: places.type: this device is pressed at its electrodes: give "electrodes"'
            )
        case _, ElectrodePlaces():
            raise ConfigError(
                f'{plan.path}: places.type: this is pressed in a workspace: give "grid", "random" or "list"'
            )
        case within, RandomPlaces():
            _check_count(plan, len(plan.contacts) * places.count * len(plan.forces.all))
            apart = _apart(places, contact)
            return list(chain.from_iterable(_random(places, plan, within, apart, c) for c in plan.contacts))
        case within, GridPlaces() | ListedPlaces():
            return _sets_apart(places, plan, within, _apart(places, contact))
    raise AssertionError("every contact has its kinds of places")


def _electrode_sets(places: ElectrodePlaces, plan: SweepPlan, config: RobotSettings) -> list[tuple[str, ...]]:
    known = list(config.places)
    names = known if places.names is None else places.names
    for k, name in enumerate(names):
        key = f"{plan.path}: places.names[{k}]"
        if name not in known:
            raise ConfigError(f'{key}: there is no electrode "{name}": give some of {_quoted(known)}')
        if name in names[:k]:
            raise ConfigError(f'{key}: the electrode "{name}" is given twice')
    if plan.contacts[-1] > len(names):
        raise ConfigError(f"{plan.path}: contacts: {plan.contacts[-1]} at once on {len(names)} electrodes")
    return list(chain.from_iterable(combinations(names, c) for c in plan.contacts))


def _sets_apart(
    places: GridPlaces | ListedPlaces, plan: SweepPlan, within: WorkspaceSettings, apart: float
) -> list[tuple[Disc, ...]]:
    if isinstance(places, GridPlaces):
        (x, y), (across, along) = _ranges(places, plan, within), places.count
        every = [(a, b) for b in _spread(y, along) for a in _spread(x, across)]
    else:
        every = list(places.at)
        _check_listed(every, plan, within)
    if max(math.comb(len(every), c) for c in plan.contacts) > MOST_CASES:
        raise ConfigError(
            f"{plan.path}: places: {plan.contacts[-1]} contacts on {len(every)} places are too many sets: "
            'give fewer, or type = "random"'
        )
    sets: list[tuple[Disc, ...]] = []
    for c in plan.contacts:
        found = [each for each in combinations(every, c) if _are_apart(each, apart)]
        if not found:
            raise ConfigError(f"{plan.path}: places: no {c} of them are {1e3 * apart:g} mm apart")
        sets += found
    return sets


def _random(
    places: RandomPlaces, plan: SweepPlan, within: WorkspaceSettings, apart: float, contacts: int
) -> Iterator[tuple[Disc, ...]]:
    x, y = _ranges(places, plan, within)
    low, size = np.array([x[0], y[0]]), np.array([x[1] - x[0], y[1] - y[0]])
    generator = np.random.Generator(np.random.PCG64([places.seed, contacts]))

    def draw() -> tuple[Disc, ...]:
        return tuple((a, b) for a, b in (low + size * generator.random((contacts, 2))).tolist())

    for _ in range(places.count):
        tries = (draw() for _ in range(_TRIES))
        found = list(islice((each for each in tries if _are_apart(each, apart)), 1))
        if not found:
            raise ConfigError(
                f"{plan.path}: places.apart: {contacts} places {1e3 * apart:g} mm apart do not fit: "
                "give fewer contacts or a smaller distance"
            )
        yield found[0]


def _ranges(
    places: GridPlaces | RandomPlaces, plan: SweepPlan, within: WorkspaceSettings
) -> tuple[Disc, Disc]:
    """Of x and of y; within the workspace."""
    ranges = []
    for axis in ("x", "y"):
        allowed, given = getattr(within, axis), getattr(places, axis)
        if given is not None and (given[0] < allowed[0] or given[1] > allowed[1]):
            raise ConfigError(
                f"{plan.path}: places.{axis}: beyond contact.workspace, {_millimetres(allowed)}"
            )
        ranges.append(allowed if given is None else given)
    return ranges[0], ranges[1]


def _check_listed(places: list[Disc], plan: SweepPlan, within: WorkspaceSettings) -> None:
    for k, place in enumerate(places):
        key = f"{plan.path}: places.at[{k}]"
        for value, axis in zip(place, "xy", strict=True):
            low, high = allowed = getattr(within, axis)
            if not low <= value <= high:
                raise ConfigError(f"{key}: {axis} is beyond contact.workspace, {_millimetres(allowed)}")
        if place in places[:k]:
            raise ConfigError(f"{key}: this place is given twice")


def _apart(places: DiscPlaces, contact: ContactSettings) -> float:
    return 2 * contact.radius if places.apart is None else places.apart


def _are_apart(places: tuple[Disc, ...], least: float) -> bool:
    # Neighbours of a grid are often as far apart as is asked, but for rounding.
    return all(math.dist(a, b) >= least * (1 - 1e-9) for a, b in combinations(places, 2))


def _spread(ends: Disc, count: int) -> list[float]:
    return [0.5 * (ends[0] + ends[1])] if count == 1 else np.linspace(*ends, count).tolist()


def _millimetres(span: Disc) -> str:
    return f"{1e3 * span[0]:g} to {1e3 * span[1]:g} mm"


def _quoted(names: list[str]) -> str:
    return ", ".join(f'"{name}"' for name in names)
