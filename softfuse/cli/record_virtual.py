"""softfuse record-virtual: a recording of a robot that is not there, with the truth."""

from pathlib import Path
from typing import Annotated

import platformdirs
import typer

from softfuse.cli.options import Quiet, out_file
from softfuse.cli.progress import busy, tracked_calls
from softfuse.cli.terminal import say, termination_interrupts
from softfuse.experiment.equilibria import RobotSolver
from softfuse.experiment.performance import performance, random_episodes
from softfuse.experiment.recording_file import write_recording
from softfuse.experiment.virtual_robot import MakingErrors, virtual_robot
from softfuse.io.result_folder import put_in_place
from softfuse.robot.file import load
from softfuse.robot.robot import require_sensors


def record_virtual(
    config: Annotated[Path, typer.Argument(help="Configuration of the robot (TOML).")],
    out: Annotated[Path, out_file(help="File to write: .csv or .csv.gz.")],
    presses: Annotated[int, typer.Option(min=1, help="So many, each at a place of its own.")] = 10,
    seed: Annotated[int, typer.Option(min=0, help="Other places, forces and noise.")] = 1,
    body: Annotated[
        int, typer.Option(min=0, help="Another robot of the same drawing, with other sensors.")
    ] = 1,
    quiet: Quiet = False,
) -> None:
    """Make a robot that is off its drawing as real ones are, press and drive it, and record."""
    settings = load(config)
    require_sensors(settings)
    with termination_interrupts():
        with busy("making the robot", quiet=quiet):
            robot = virtual_robot(settings, MakingErrors(seed=body))
            episodes = random_episodes(robot, presses, seed=seed)
            total = sum(map(RobotSolver(robot).count, episodes))
        with tracked_calls("pressing", total=total, quiet=quiet) as solved:
            folder = platformdirs.user_cache_path("softfuse") / "virtual"
            played = performance(robot, episodes, folder=folder, solved=solved)
        with put_in_place(out) as part:
            write_recording(part, played.recording(body, seed))
    written = f"{out} holds {len(played.frames.time_s)} frames of {presses} presses"
    say(written, *(f"{what}: {how}" for what, how in robot.told.items()), quiet=quiet)
