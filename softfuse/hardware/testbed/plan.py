"""What a test bed is going to do: which places, which of them are done already, and the moves in words."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from softfuse.errors import ConfigError, HardwareError
from softfuse.hardware.stage.gcode import GcodeStage, Workspace
from softfuse.hardware.testbed.bench import Bench, Origin, Pressed, workspace_of
from softfuse.hardware.testbed.files import done_already
from softfuse.hardware.testbed.gathering import Gathering
from softfuse.hardware.testbed.places import Point, grid, read_places
from softfuse.hardware.testbed.procedure import PressSettings
from softfuse.robot.robot import require_sensors
from softfuse.robot.settings import RobotSettings

_COMING_S = 5.0
"""How long the channels have to come before anything moves [s]: opening its port resets many a board, which
needs two seconds to start, and the channels are known by a description that comes from time to time only."""
_FIRST_S = 0.5
"""For how long the force has to come after that [s]."""


@dataclass(frozen=True)
class Plan:
    """places: that are still to be pressed [m]; wanted: how many there are with those that are done; first:
    the number of the first press; origin: of the body's coordinates in those of the stage [m]; workspace:
    where the stage may go.
    """

    places: list[Point]
    wanted: int
    first: int
    origin: Origin
    settings: PressSettings
    workspace: Workspace


def planned(wanted: Sequence[Point], files: Sequence[Path], origin: Origin, settings: PressSettings) -> Plan:
    """The presses at those of the places [m] that some file lacks.

    Raises ConfigError for an origin that is not finite, HardwareError for places where no stage may go,
    RecordingError for files of another kind, or that cannot be read.
    """
    if not all(map(math.isfinite, origin)):
        shown = " ".join(f"{1e3 * value:g}" for value in origin)
        raise ConfigError(f"the origin {shown} mm: give three finite numbers")
    places, first = done_already(files, wanted, len(settings.levels))
    workspace = workspace_of(settings, wanted, origin)
    return Plan(places, len(wanted), first, origin, settings, workspace)


def places_wanted(config: RobotSettings, count: tuple[int, int], file: Path | None) -> list[Point]:
    """The places [m] in a file, else so many in x and in y over the workspace of the configuration's disc.

    Raises RecordingError for a file without places, ConfigError where there is no such workspace.
    """
    if file is not None:
        return read_places(file)
    require_sensors(config)
    within = config.contact().within
    if within is None:
        raise ConfigError(
            f"{config.path}: contact: one in a flat workspace is needed for a grid; or give --places"
        )
    if min(count) < 1:
        raise ConfigError(f"a grid of {count[0]} by {count[1]} places has none: give 1 or more of each")
    return grid(within.x, within.y, count)


def moves(plan: Plan) -> Iterator[str]:
    """The moves, a line each press, in the stage's coordinates."""
    settings, (x0, y0, z0) = plan.settings, plan.origin
    levels = ", ".join(f"{level:g}" for level in settings.levels)
    yield (
        f"{len(plan.places)} of {plan.wanted} places to press, at {levels} N; never beyond "
        f"{settings.force_limit:g} N nor {1e3 * settings.depth_limit:g} mm deep"
    )
    up, near, down = (
        1e3 * (z0 + height) for height in (settings.clearance, settings.approach, -settings.depth_limit)
    )
    for number, (x, y) in enumerate(plan.places, start=plan.first):
        yield (
            f"press {number} at ({1e3 * x:.2f}, {1e3 * y:.2f}) mm: "
            f"G1 X{1e3 * (x0 + x):.4f} Y{1e3 * (y0 + y):.4f} Z{up:.4f} F{60e3 * settings.travel_speed:.0f}; "
            f"tare; G1 Z{near:.4f} F{60e3 * settings.travel_speed:.0f}; "
            f"down by {1e3 * settings.longest_step:g} mm or less, F{60e3 * settings.press_speed:.0f}, "
            f"to Z{down:.4f} at most; G1 Z{up:.4f} F{60e3 * settings.retreat_speed:.0f}"
        )


def press(plan: Plan, gathering: Gathering, stage: GcodeStage, *, home: bool) -> Iterator[Pressed]:
    """Press the places of a plan with a stage that is recorded, after seeking its end switches where told so;
    each press when it is done.

    Raises HardwareError where the channels do not come, before anything moves, and as `Bench.press`.
    """
    missing = gathering.missing(_COMING_S)
    if missing:
        raise HardwareError(
            f"the channels {', '.join(missing)} do not come: look with softfuse doctor, nothing has moved"
        )
    gathering.reading(_FIRST_S)
    stage.connect()
    if home:
        stage.home()
    yield from Bench(stage, gathering, plan.settings, plan.origin).press(plan.places, plan.first)
