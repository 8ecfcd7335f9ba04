"""The first stage of `softfuse evaluate`: what a virtual test bed does, recorded as a real one would."""

from pathlib import Path

from softfuse.cli.result_folder import put_in_place, writing
from softfuse.cli.terminal import tracked_calls
from softfuse.experiment.paper.bed import Bed
from softfuse.experiment.recording_file import write_recording


def record(bed: Bed, folder: Path, *, quiet: bool) -> list[Path]:
    """A recording of each thing that is done, in folder/recordings; those that are there are kept, as are
    equilibria in folder/equilibria.

    Raises SolveError when the body cannot be pressed, SoftfuseError when a file cannot be written.
    """
    paths = [folder / "recordings" / f"{name}.csv.gz" for name in bed.names]
    if all(path.exists() for path in paths):
        return paths
    with tracked_calls("pressing the test bed", total=bed.equilibria, quiet=quiet) as solved:
        played = bed.played(folder / "equilibria", solved)
    with writing(folder):
        paths[0].parent.mkdir(exist_ok=True)
        for k, (path, each) in enumerate(zip(paths, played, strict=True)):
            if not path.exists():
                press = {"press": (0, each.frames.episode + k)}
                with put_in_place(path) as part:
                    write_recording(part, each.recording(bed.seed, k + 1) | press)
    return paths
