"""softfuse testbed: press a body at places and force levels with a stage, and record everything."""

import math
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from softfuse.cli.interruption import termination_interrupts
from softfuse.cli.sources import session_info
from softfuse.cli.terminal import Quiet, printable, stderr, stdout, tracked
from softfuse.cli.testbed_files import Outputs, done_already
from softfuse.cli.testbed_plan import Plan, moves
from softfuse.cli.testbed_sensors import Sensors
from softfuse.errors import ConfigError, HardwareError
from softfuse.hardware.source.connection import remedy
from softfuse.hardware.source.serial_port import open_serial
from softfuse.hardware.stage.gcode import GcodeStage
from softfuse.hardware.stage.grbl import Grbl
from softfuse.hardware.stage.marlin import Marlin
from softfuse.hardware.stage.workspace import Workspace
from softfuse.hardware.stream import HostClock, Notice
from softfuse.hardware.testbed.bench import Bench, Pressed, workspace_of
from softfuse.hardware.testbed.gathering import ForceAxis
from softfuse.hardware.testbed.places import grid, read_places
from softfuse.hardware.testbed.procedure import PressSettings
from softfuse.robot.file import load
from softfuse.robot.robot import require_sensors
from softfuse.robot.settings import RobotSettings

_DEFAULTS = PressSettings()
_LIMIT = 1.3
"""The force limit over the highest level, where none is given."""


class Firmware(StrEnum):
    """What the stage is controlled by."""

    GRBL = "grbl"
    MARLIN = "marlin"


def testbed(
    config: Annotated[Path, typer.Argument(help="Configuration of the device, with its sources (TOML).")],
    stage: Annotated[str, typer.Option(help="Port of the stage.")],
    out: Annotated[
        list[Path],
        typer.Option(help="File to record to: a session (.mcap) or a recording (.csv); may be repeated."),
    ],
    firmware: Annotated[Firmware, typer.Option(help="What controls the stage.")] = Firmware.GRBL,
    stage_baud: Annotated[int, typer.Option(help="Baud rate of the stage.", min=50)] = 115200,
    home: Annotated[bool, typer.Option("--home", help="Seek the stage's end switches first.")] = False,
    origin: Annotated[
        tuple[float, float, float],
        typer.Option(help="Where the stage is when the indenter just touches the middle of the top, in mm."),
    ] = (0.0, 0.0, 0.0),
    places_in: Annotated[
        tuple[int, int], typer.Option("--grid", help="Places over the workspace, in x and y.")
    ] = (10, 10),
    places: Annotated[
        Path | None, typer.Option(help="Places instead: a CSV with the columns x_mm and y_mm.")
    ] = None,
    force: Annotated[list[float] | None, typer.Option(help="A force level, in N; may be repeated.")] = None,
    force_channel: Annotated[str, typer.Option(help="Channel of the force along the indenter.")] = "fz_N",
    force_sign: Annotated[int, typer.Option(help="1, or -1 where pressing makes it fall.")] = 1,
    force_limit: Annotated[
        float | None,
        typer.Option(help="Stop beyond this force, in N; by default 1.3 times the highest level."),
    ] = None,
    depth_limit: Annotated[float, typer.Option(help="Never deeper than this, in mm.")] = (
        1e3 * _DEFAULTS.depth_limit
    ),
    clearance: Annotated[float, typer.Option(help="Height above the top to travel at, in mm.")] = (
        1e3 * _DEFAULTS.clearance
    ),
    step: Annotated[float, typer.Option(help="Longest step down, in mm.")] = 1e3 * _DEFAULTS.longest_step,
    press_speed: Annotated[float, typer.Option(help="Speed of a step, in mm/s.")] = 1e3
    * _DEFAULTS.press_speed,
    travel_speed: Annotated[float, typer.Option(help="Speed between places, in mm/s.")] = (
        1e3 * _DEFAULTS.travel_speed
    ),
    hold: Annotated[float, typer.Option(help="How long a level is held, in s.")] = _DEFAULTS.hold,
    rest: Annotated[float, typer.Option(help="How long the body is left alone after a press, in s.")] = (
        _DEFAULTS.rest
    ),
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only say what would move; opens no port, writes nothing.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Press a body with a stage at places and force levels, record everything; goes on where it stopped."""
    settings = load(config)
    if force_sign not in (-1, 1):
        raise ConfigError(f"--force-sign {force_sign}: give 1, or -1 where pressing makes the force fall")
    if not all(map(math.isfinite, origin)):
        raise ConfigError(
            f"--origin {origin[0]:g} {origin[1]:g} {origin[2]:g}: give three finite numbers, in mm"
        )
    levels = tuple(force) if force else _DEFAULTS.levels
    clearance_m = 1e-3 * clearance
    press = PressSettings(
        levels=levels,
        force_limit=_LIMIT * max(levels) if force_limit is None else force_limit,
        depth_limit=1e-3 * depth_limit,
        clearance=clearance_m,
        approach=min(_DEFAULTS.approach, clearance_m),
        longest_step=1e-3 * step,
        finest_step=min(_DEFAULTS.finest_step, 1e-3 * step),
        travel_speed=1e-3 * travel_speed,
        press_speed=1e-3 * press_speed,
        hold=hold,
        rest=rest,
    )
    wanted = grid(*_workspace(settings), _counted(places_in)) if places is None else read_places(places)
    x, y, z = origin
    done = done_already(out, wanted, len(levels))
    plan = Plan(done.remaining, len(wanted), done.next_press, (1e-3 * x, 1e-3 * y, 1e-3 * z), press)
    # Of what is checked before anything moves, and needs no stage.
    workspace = workspace_of(press, wanted, plan.origin)
    if dry_run:
        stdout.print("\n".join(moves(plan)), markup=False, highlight=False, soft_wrap=True)
        return
    if not plan.places:
        _say(f"all {len(wanted)} places are pressed already", quiet=quiet)
        return
    clock = HostClock()
    sensors = Sensors(settings, ForceAxis(force_channel, force_sign), clock, tell=_tell)
    try:
        with termination_interrupts():
            sensors.open()
            stage_of = _stage(stage, stage_baud, firmware, workspace)
            try:
                info = session_info(settings, settings.sources, sensors.gathering.channels, {})
                outputs = Outputs(out, info, clock, _tell)
                sensors.start(outputs)
                _press(stage_of, sensors, plan, home=home, quiet=quiet)
            finally:
                stage_of.close()
    finally:
        sensors.stop()
    _say(f"recorded to {', '.join(map(str, sensors.written))}", quiet=quiet)
    if sensors.lost:
        raise HardwareError(f"{sensors.lost} entries could not be recorded: look at the disk")


def _press(stage: GcodeStage, sensors: Sensors, plan: Plan, *, home: bool, quiet: bool) -> None:
    sensors.wait()
    stage.connect()
    if home:
        stage.home()
    bench = Bench(stage, sensors.gathering, plan.settings, plan.origin)
    presses = bench.press(plan.places, plan.first, sensors.remark)
    for done in tracked(presses, "pressing", total=len(plan.places), quiet=quiet):
        _say(_described(done), quiet=quiet)


def _described(done: Pressed) -> str:
    x, y = done.at
    samples = ", ".join(f"{force:.2f} N {1e3 * depth:.2f} mm deep" for force, depth in done.samples)
    return f"press {done.press} at ({1e3 * x:.2f}, {1e3 * y:.2f}) mm: {samples}"


def _stage(url: str, baud: int, firmware: Firmware, workspace: Workspace) -> GcodeStage:
    try:
        port = open_serial(url, baud)
    except OSError as error:
        raise HardwareError(remedy(url, error)) from error
    dialect = Grbl() if firmware is Firmware.GRBL else Marlin()
    return GcodeStage(port, dialect, workspace)


def _workspace(config: RobotSettings) -> tuple[tuple[float, float], tuple[float, float]]:
    require_sensors(config)
    within = config.contact().within
    if within is None:
        raise ConfigError(
            f"{config.path}: contact: one in a flat workspace is needed for a grid; or give --places"
        )
    return within.x, within.y


def _counted(places: tuple[int, int]) -> tuple[int, int]:
    if min(places) < 1:
        raise ConfigError(f"a grid of {places[0]} by {places[1]} places has none: give 1 or more of each")
    return places


def _tell(notice: Notice) -> None:
    if notice.level != "info":
        where = "" if notice.source is None else f"source {notice.source}: "
        text = printable(where + notice.text)
        stderr.print(f"{notice.level}: {text}", markup=False, highlight=False, soft_wrap=True)


def _say(text: str, *, quiet: bool) -> None:
    if not quiet:
        stdout.print(printable(text), markup=False, highlight=False, soft_wrap=True)
