"""softfuse testbed: press a body at places and force levels with a stage, and record everything."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from softfuse.cli.options import Quiet
from softfuse.cli.progress import tracked
from softfuse.cli.sources import session_info
from softfuse.cli.terminal import say, stderr, termination_interrupts
from softfuse.hardware.stage.gcode import Firmware, open_stage
from softfuse.hardware.stream import HostClock, Notice
from softfuse.hardware.testbed.gathering import ForceAxis, Gathering
from softfuse.hardware.testbed.plan import moves, places_wanted, planned, press
from softfuse.hardware.testbed.procedure import PressSettings
from softfuse.robot.file import load

_USUAL = PressSettings()


def testbed(
    config: Annotated[Path, typer.Argument(help="Configuration of the robot, with its sources (TOML).")],
    stage: Annotated[str, typer.Option(help="Port of the stage.")],
    out: Annotated[list[Path], typer.Option(help="File to record to, .mcap or .csv; may be repeated.")],
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
    depth_limit: Annotated[float, typer.Option(help="Never deeper, in mm.")] = 1e3 * _USUAL.depth_limit,
    clearance: Annotated[float, typer.Option(help="Height above the top to travel at, in mm.")] = (
        1e3 * _USUAL.clearance
    ),
    step: Annotated[float, typer.Option(help="Longest step down, in mm.")] = 1e3 * _USUAL.longest_step,
    press_speed: Annotated[float, typer.Option(help="Speed of a step, in mm/s.")] = 1e3 * _USUAL.press_speed,
    travel_speed: Annotated[float, typer.Option(help="Speed between places, in mm/s.")] = (
        1e3 * _USUAL.travel_speed
    ),
    hold: Annotated[float, typer.Option(help="How long a level is held, in s.")] = _USUAL.hold,
    rest: Annotated[float, typer.Option(help="How long the body rests after a press, in s.")] = _USUAL.rest,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only say what would move; opens no port, writes nothing.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Press a body with a stage at places and force levels, record everything; goes on where it stopped."""
    settings, axis = load(config), ForceAxis(force_channel, force_sign)
    how = PressSettings.of(
        force or (),
        force_limit,
        depth_limit=1e-3 * depth_limit,
        clearance=1e-3 * clearance,
        longest_step=1e-3 * step,
        travel_speed=1e-3 * travel_speed,
        press_speed=1e-3 * press_speed,
        hold=hold,
        rest=rest,
    )
    x, y, z = (1e-3 * value for value in origin)
    plan = planned(places_wanted(settings, places_in, places), out, (x, y, z), how)
    if dry_run:
        say(*moves(plan))
        return
    if not plan.places:
        say(f"all {plan.wanted} places are pressed already", quiet=quiet)
        return
    gathering = Gathering(settings, axis, HostClock(), tell=_tell)
    stage_of = partial(open_stage, stage, stage_baud, firmware, plan.workspace)
    info_of = partial(session_info, settings, settings.sources, estimates={})
    with termination_interrupts(), gathering.recording(stage_of, out, info_of) as opened:
        presses = press(plan, gathering, opened, home=home)
        for done in tracked(presses, "pressing", total=len(plan.places), quiet=quiet):
            say(str(done), quiet=quiet)
    say(f"recorded to {gathering.written}", quiet=quiet)


def _tell(notice: Notice) -> None:
    if notice.level != "info":
        where = "" if notice.source is None else f"source {notice.source}: "
        say(f"{notice.level}: {where}{notice.text}", console=stderr)
