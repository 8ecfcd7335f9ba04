"""From a design plan and its robot's config to the problem that is searched, and back to a config."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import tomlkit
from jaxtyping import Array, Float
from tomlkit.items import AoT

from softfuse.design.cable_route import CableRoute
from softfuse.design.chamber_count import OWN, channel_edits, kept_chambers, with_chambers
from softfuse.design.electrode_pitch import ElectrodePitch, touched
from softfuse.design.limits import Limit
from softfuse.design.objective import AbstractMeasure, Answers
from softfuse.design.plan import DesignPlan, LimitSettings, ParameterSettings
from softfuse.design.problem import Problem, Walls, untouched
from softfuse.design.search import SearchSettings
from softfuse.errors import ConfigError, MeshError
from softfuse.functional.material_points import MaterialPoints
from softfuse.io.quantity import millimetres
from softfuse.mechanics.model import Model
from softfuse.mesh.block import Block, Fineness
from softfuse.mesh.files import write_mesh
from softfuse.robot.chamber_shapes import written_centre, written_shape
from softfuse.robot.file import edit, moved, saved
from softfuse.robot.layout.layout import Parameter, TiedLayout
from softfuse.robot.layout.layout_mesh import LayoutMesh
from softfuse.robot.mesh import robot_mesh
from softfuse.robot.press_plan import SweepPlan
from softfuse.robot.press_series import build_series, places_of
from softfuse.robot.robot import build_robot
from softfuse.robot.settings import RobotSettings

ShownUnits = Mapping[str, tuple[str, float]]
"""By SI unit, the unit that people read and how many of it are one; others are read as they are."""


def build_layout(plan: DesignPlan, config: RobotSettings) -> TiedLayout:
    """The layout of a plan, with parameters that are 0 as drawn.

    Raises ConfigError when the robot's body is no block.
    """
    numbers = {cavity.name: k for k, cavity in enumerate(plan.cavities)}

    def parameter(settings: ParameterSettings) -> Parameter:
        adds = {
            (numbers[tie.cavity], tie.value): tie.times for tie in settings.adds if tie.cavity is not None
        }
        low, high = settings.bounds
        return Parameter(settings.name, 0.0, low, high, settings.unit, settings.usual_change, adds)

    drawn = [(cavity.shape, cavity.values(cavity.centre)) for cavity in plan.cavities]
    return TiedLayout.of(_outside(plan, config), drawn, [parameter(each) for each in plan.parameters])


def build_problem(plan: DesignPlan, config: RobotSettings) -> Problem:
    """The problem of a plan without its limits, which need the robot as it is: see `build_limits`.

    Raises ConfigError as `build_layout` does, or when places and measures do not suit the robot.
    """
    config = with_chambers(plan, config)
    if config.body.element == "linear":
        raise ConfigError(
            f'{config.path}: body.element: walls of any shape need "taylor-hood" or "quadratic" elements'
        )
    layout = build_layout(plan, config)
    numbers = {cavity.name: k for k, cavity in enumerate(plan.cavities)}
    special = {_numbered(name, numbers): thickness for name, thickness in plan.walls.special.items()}
    places, names = build_places(plan, config)
    fronts = () if plan.front is None else (plan.front.of,)
    wanted = (plan.objective, *(limit.of for limit in plan.limits), *fronts)
    electrodes = any(each.by_electrodes for each in wanted)

    route, pitch = CableRoute.of(plan, config), ElectrodePitch.of(plan, config)

    def build(mesh: LayoutMesh, theta: Float[np.ndarray, " p"]) -> Model:
        routed = route.configured(config, theta)
        return build_robot(routed, robot_mesh(routed, mesh.mesh(theta), mesh.walls)).model

    return Problem(
        layout=layout,
        fineness=_fineness(plan, config),
        build=build,
        places=places,
        noise=_noise(config, plan),
        objective=plan.objective.build(plan.path, names),
        walls=Walls(plan.walls.thickness, special),
        # What presses on an electrode is felt in the same way all over it.
        by_place=not names and any(each.by_place for each in wanted),
        watch=lambda model: _watched(config, model),
        follow=route.on_model,
        guides=lambda theta: jnp.concatenate([jnp.zeros((0, 3)), *route.guides(theta)]),
        touched=touched(plan, config, pitch, places) if electrodes else untouched,
    )


def limits_of(plan: DesignPlan) -> tuple[LimitSettings, ...]:
    """The limits of a plan, then what its front limits, as yet without one."""
    return plan.limits if plan.front is None else (*plan.limits, plan.front.unlimited)


def build_limits(
    plan: DesignPlan, config: RobotSettings, own: Answers, settings: Sequence[LimitSettings]
) -> tuple[Limit, ...]:
    """Limits, those in parts of the robot's own by its answers as it is."""

    def limit(settings: LimitSettings, measure: AbstractMeasure) -> Limit:
        is_now = float(measure(own))
        low = -np.inf if settings.at_least is None else settings.at_least * is_now
        high = np.inf if settings.at_most is None else settings.at_most * is_now
        return Limit(measure, low, high if settings.most is None else settings.most)

    return tuple(map(limit, settings, limit_measures(plan, config, settings)))


def limit_measures(
    plan: DesignPlan, config: RobotSettings, settings: Sequence[LimitSettings]
) -> tuple[AbstractMeasure, ...]:
    """What limits are of."""
    _, names = build_places(plan, config)
    return tuple(each.of.build(plan.path, names) for each in settings)


def shown_units(config: RobotSettings) -> ShownUnits:
    """In which units people read the measures of a robot."""
    pressures = any("pressure" in (each.quantities or ()) for each in config.sensors)
    reading = ("Pa/N", 1.0) if pressures else ("mm³/N", 1e9)
    return {"m": ("mm", 1e3), "m/N": ("mm/N", 1e3), "reading/N": reading}


def search_settings(plan: DesignPlan) -> SearchSettings:
    """How a plan's searches go."""
    look = plan.search
    return SearchSettings(look.legs, look.iterations, look.move, look.improvement)


def searched_config(plan: DesignPlan, config: RobotSettings) -> RobotSettings:
    """The config on whose mesh a plan searches; raises ConfigError where that has no such edges."""
    source = config.body.source
    for name in plan.search.edges:
        if name not in source.edges:
            raise ConfigError(
                f"{plan.path}: search.edges: the mesh of {config.path} has no {name}: it has "
                f"{', '.join(source.edges) or 'none that can be chosen'}"
            )
    return config.meshed(plan.search.edges)


def build_places(plan: DesignPlan, config: RobotSettings) -> tuple[Array, tuple[str, ...]]:
    """The places (s, 3, 3) where the robot is pressed, and the names of electrodes.

    Raises ConfigError when the places do not suit the robot.
    """
    presses = SweepPlan.model_validate(
        {"places": plan.places, "forces": {"values": ["1 N"]}},
        context={"folder": plan.path.parent, "path": plan.path},
    )
    alone = build_series(presses, config)
    names = tuple(place for series in alone for place in series.places if isinstance(place, str))
    contact = config.contact()
    if contact.direction is None and not names:
        raise ConfigError(
            f'{plan.path}: places.type: the contact "{contact.name}" of {config.path} may be anywhere on a '
            "surface: designs are judged by presses in a flat workspace, or on electrodes"
        )
    places = jnp.asarray(np.concatenate([places_of(config, series) for series in alone]))
    return places, names


def _noise(config: RobotSettings, plan: DesignPlan) -> Float[np.ndarray, " k"]:
    each: list[float] = []
    for sensor in config.sensors:
        if sensor.quantities is None:
            raise ConfigError(f'{config.path}: sensor "{sensor.name}": designs know no noise of its kind')
        each += [getattr(plan.noise, quantity) for quantity in sensor.quantities]
    return np.array(each)


def _watched(config: RobotSettings, model: Model) -> MaterialPoints | None:
    line = config.centreline
    points = [point.at for point in config.points] if line is None else line.points
    with config.told("point" if line is None else "centreline.points"):
        return MaterialPoints.embedded(model.body, np.array(points)) if points else None


def _outside(plan: DesignPlan, config: RobotSettings) -> Block:
    source = config.body.source
    try:
        return source.outside()
    except MeshError as error:
        raise ConfigError(
            f"{plan.path}: robot: the body of {config.path} comes from a {source.type}; {error}"
        ) from error


def _fineness(plan: DesignPlan, config: RobotSettings) -> Fineness:
    centre, half = (
        np.array([getattr(cavity, key) for cavity in plan.cavities]) for key in ("centre", "half")
    )
    return config.body.source.fineness(np.stack([centre - half, centre + half], axis=1))


def _numbered(name: str, numbers: dict[str, int]) -> str:
    """ "(-,-), high z" as `wall_names` has it."""
    # "left", but not where it is "left of the middle".
    for cavity, k in sorted(numbers.items(), key=lambda item: -len(item[0])):
        if name.startswith(cavity):
            return f"cavity {k}{name[len(cavity) :]}"
    return name


def save_designed(
    plan: DesignPlan,
    config: RobotSettings,
    mesh: LayoutMesh,
    theta: Float[np.ndarray, " p"],
    target: Path,
) -> RobotSettings:
    """Write the config of the robot whose cavities have parameters (p,), all else and its comments kept, and
    return it: a "layout" where the outside is a block, else a mesh in a file next to it.

    Raises ConfigError when it cannot be written.
    """
    document = moved(config.path, target)
    layout = mesh.layout
    parts = list(zip(layout.shapes, map(np.asarray, layout.values(jnp.asarray(theta))), strict=True))
    source = config.body.source.as_layout()
    if source is None:
        file = target.with_suffix(".vtu")
        write_mesh(file, mesh.mesh(theta))
        source = {"type": "mesh", "file": file.name, "unit": "m"}
    else:
        source["shape"] = _tables([written_shape(*part) for part in parts])
    names = [cavity.name for cavity in plan.cavities]
    document["body"]["source"] = source
    guides = CableRoute.of(plan, config).guides(jnp.asarray(theta))
    for cable, places in zip(document.get("cable", ()), guides, strict=True):
        cable["guides"] = [[millimetres(float(x)) for x in place] for place in places]
    edits = {**channel_edits(plan, config), **ElectrodePitch.of(plan, config).edits(config, theta)}
    if config.estimator.reading_spread is not None:
        # A calibration's, of other cavities.
        edits["estimator", "reading_spread"] = None
    for place, value in edits.items():
        edit(document, place, value, config.path)
    kept = [
        {key: value for key, value in document["chamber"][k].items() if key not in OWN}
        for k in kept_chambers(plan, config)
    ]
    document["chamber"] = _tables(
        [
            {"name": name, "centre": written_centre(*part), **others}
            for name, part, others in zip(names, parts, kept, strict=True)
        ]
    )
    return saved(tomlkit.dumps(document), target)


def _tables(contents: Sequence[dict[str, Any]]) -> AoT:
    tables = tomlkit.aot()
    for content in contents:
        tables.append(tomlkit.item(content))
    tables[-1].add(tomlkit.nl())
    return tables
