"""softfuse evaluate: the evaluation of Navarro et al. 2020 on a virtual test bed, beside their figures."""

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from softfuse.cli.interruption import termination_interrupts
from softfuse.cli.result_folder import claim, put_in_place, writing
from softfuse.cli.terminal import Quiet, busy, counted, printable, stdout, tracked_calls
from softfuse.cli.version import installed_version
from softfuse.experiment.paper.bed import Bed, build_bed
from softfuse.experiment.recording_file import write_recording
from softfuse.report.calibrated import calibrated_robot
from softfuse.report.evaluation import EVERY, estimated, evaluation
from softfuse.report.evaluation_page import write_evaluation
from softfuse.report.page import table
from softfuse.report.recorded import read_sensors
from softfuse.robot.digest import digest
from softfuse.robot.file import load
from softfuse.robot.robot import Robot, build_robot


def evaluate(
    config: Annotated[Path, typer.Argument(help="Configuration of a robot of the paper's kinds (TOML).")],
    out: Annotated[Path, typer.Option(help="Folder for the results; an evaluation in it is continued.")],
    grid: Annotated[int, typer.Option(help="Presses on so many times so many places.", min=2, max=30)] = 10,
    seed: Annotated[int, typer.Option(help="Another body with other sensors.", min=0)] = 1,
    quiet: Quiet = False,
) -> None:
    """Press a virtual robot as the paper did, estimate, and write tables and figures; continues an
    evaluation.
    """
    settings = load(config)
    given = {"config": digest(settings), "grid": str(grid), "seed": str(seed)}
    identity = {"softfuse": installed_version(), **given}
    claim(out, "evaluation.json", "an evaluation", identity, parts="estimates/*/*.npz")
    with busy("building", quiet=quiet):
        bed, robots = build_bed(settings, grid=grid, seed=seed), {"as drawn": build_robot(settings)}
    with termination_interrupts(), ExitStack() as shown:

        def begin(what: str, total: int):
            shown.close()  # one display at a time
            return shown.enter_context(tracked_calls(what, total=total, quiet=quiet))

        with tracked_calls("pressing the test bed", total=bed.equilibria, quiet=quiet) as solved:
            recordings = _recorded(bed, out, solved)
        if bed.fitted_to:
            robots["calibrated"] = _calibrated(robots["as drawn"], recordings[: bed.fitted_to], out, quiet)
        found = {
            way: estimated(
                robot,
                recordings[bed.fitted_to :],
                out / "estimates" / way.replace(" ", "_"),
                lambda total, way=way: begin(f"estimating {way}", total),
            )
            for way, robot in robots.items()
        }
    with busy("writing the report", quiet=quiet), writing(out):
        whole = evaluation(robots["as drawn"], found)
        written = write_evaluation(out, f"{settings.robot.name}: evaluation", whole, _sections(bed))
    if not quiet:
        lines = [f"{each.title}\n{each.text}" for each in whole.tables]
        lines.append(f"written to {out}: report.html and {len(written) - 1} tables and figures")
        stdout.print(printable("\n\n".join(lines)), markup=False, highlight=False, soft_wrap=True)


def _recorded(bed: Bed, out: Path, solved) -> list[Path]:
    """A recording of each thing that is done, those that are there kept, as are equilibria."""
    paths = [out / "recordings" / f"{name}.csv.gz" for name in bed.names]
    if not all(path.exists() for path in paths):
        played = bed.played(out / "equilibria", solved)
        with writing(out):
            paths[0].parent.mkdir(exist_ok=True)
            for k, (path, each) in enumerate(zip(paths, played, strict=True)):
                with put_in_place(path) as part:
                    columns = each.recording(bed.seed, k + 1)
                    write_recording(part, columns | {"press": (0, 0.0 * columns["press"][1] + k)})
    return paths


def _calibrated(robot: Robot, recordings: list[Path], out: Path, quiet: bool) -> Robot:
    """The robot fitted to all samples of some recordings, fitted.toml, with the files beside it."""
    fitted = out / "fitted.toml"
    if not all(fitted.with_suffix(suffix).exists() for suffix in (".toml", ".npz", ".html")):
        read = [read_sensors(robot.settings, path) for path in recordings]
        with counted("calibrating", "done", quiet=quiet) as done:
            calibrated_robot(robot, read, fitted, seen=lambda work: done)
    return build_robot(load(fitted))


def _sections(bed: Bed) -> list[tuple[str, str]]:
    """Headings and HTML of what the test bed is."""
    rows = [*bed.robot.told.items(), ("estimates", f"of each {EVERY}th frame, and of each sample")]
    fitted = f"Fitted to {bed.fitted_to} presses that are not among these: "
    more = [("Calibration", f'<p>{fitted}<a href="fitted.html">report</a>.</p>')] if bed.fitted_to else []
    return [("The test bed", table(("", ""), rows)), *more]
