"""The first stage of `softfuse evaluate`: what a virtual test bed does, recorded as a real one would."""

from pathlib import Path

from softfuse.cli.result_folder import put_in_place, writing
from softfuse.cli.terminal import tracked_calls
from softfuse.experiment.build_evaluation import Bed
from softfuse.experiment.recording_file import recorded, write_recording
from softfuse.robot.settings import RobotSettings


def record(settings: RobotSettings, bed: Bed, folder: Path, *, quiet: bool) -> list[Path]:
    """A recording of each thing that is done, in folder/recordings; those that are there are kept, as are
    equilibria in folder/equilibria.

    Raises SolveError when the body cannot be pressed, SoftfuseError when a file cannot be written.
    """
    paths = [folder / "recordings" / f"{name}.csv.gz" for name in bed.names]
    if all(path.exists() for path in paths):
        return paths
    with tracked_calls("pressing the test bed", total=bed.equilibria, quiet=quiet) as solved:
        programmes = bed.plan.programmes(folder / "equilibria", solved=solved)
    assert settings.sensors is not None  # the plan has told
    channels = settings.sensors.channels
    electronics = bed.plan.electronics(bed.seed).taken(
        [programmes[0].channels.index(channel) for channel in channels]
    )
    with writing(folder):
        paths[0].parent.mkdir(exist_ok=True)
        for k, (path, programme) in enumerate(zip(paths, programmes, strict=True)):
            if not path.exists():
                columns = recorded(programme.only(channels), electronics, (bed.seed, k + 1))
                with put_in_place(path) as part:
                    write_recording(part, columns | {"press": (0, 0.0 * columns["press"][1] + k)})
    return paths
