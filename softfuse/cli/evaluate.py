"""softfuse evaluate: the evaluation of Navarro et al. 2020 on a virtual test bed, beside their figures."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from softfuse.cli.interruption import termination_interrupts
from softfuse.cli.terminal import Quiet, busy, counted, out_folder, printable, stdout, tracked_calls
from softfuse.cli.version import installed_version
from softfuse.experiment.paper.bed import Bed, build_bed
from softfuse.report.calibrated import calibrated_robot
from softfuse.report.evaluated import EVERY, estimates, record
from softfuse.report.evaluation import write_evaluation
from softfuse.report.page import table
from softfuse.report.press_evaluation import PRESSES
from softfuse.report.push_evaluation import PUSHES
from softfuse.report.recorded import read_sensors
from softfuse.report.result_folder import claim
from softfuse.robot.digest import digest
from softfuse.robot.file import load
from softfuse.robot.robot import build_robot
from softfuse.robot.settings import RobotSettings


def evaluate(
    config: Annotated[Path, typer.Argument(help="Configuration of a pad or a finger (TOML).")],
    out: Annotated[Path, out_folder("Folder for the results; an evaluation in it is continued.")],
    grid: Annotated[
        int, typer.Option(help="A pad is pressed at so many times so many places.", min=2, max=30)
    ] = 10,
    seed: Annotated[int, typer.Option(help="Another body with other sensors.", min=0)] = 1,
    quiet: Quiet = False,
) -> None:
    """Press a virtual robot as the paper did, estimate, and write its tables and figures; goes on where it
    stopped.
    """
    settings = load(config)
    bed = build_bed(settings, grid=grid, seed=seed)
    identity = {
        "softfuse": installed_version(),
        "config": digest(settings),
        "grid": str(grid),
        "seed": str(seed),
    }
    claim(out, "evaluation.json", "an evaluation", identity, parts="estimates/*/*.npz")
    evaluator = PUSHES if bed.pushes else PRESSES
    with termination_interrupts():
        with tracked_calls("pressing the test bed", total=bed.equilibria, quiet=quiet) as solved:
            recordings = record(bed, out, solved=solved)
        configs = {"as drawn": config}
        if bed.fitted_to:
            configs["calibrated"] = _calibrated(settings, recordings[: bed.fitted_to], out, quiet=quiet)
        found = {}
        for way, path in configs.items():
            pressed, folder = recordings[bed.fitted_to :], out / "estimates" / way.replace(" ", "_")
            with tracked_calls(f"estimating {way}", total=len(pressed), quiet=quiet) as done:
                found[way] = estimates(load(path), pressed, folder, evaluator, done=done)
    with busy("writing the report", quiet=quiet):
        evaluation = evaluator.evaluation(build_robot(settings), found)
        title = f"{settings.robot.name}: evaluation"
        written = write_evaluation(out, title, evaluation, _sections(bed))
    if not quiet:
        lines = [f"{each.title}\n{each.text}" for each in evaluation.tables]
        lines.append(f"written to {out}: report.html and {len(written) - 1} tables and figures")
        stdout.print(printable("\n\n".join(lines)), markup=False, highlight=False, soft_wrap=True)


def _calibrated(settings: RobotSettings, recordings: Sequence[Path], out: Path, *, quiet: bool) -> Path:
    """The configuration fitted to all samples of some recordings, fitted.toml, with the files beside it."""
    fitted = out / "fitted.toml"
    if not all(fitted.with_suffix(suffix).exists() for suffix in (".toml", ".npz", ".html")):
        read = [read_sensors(settings, path) for path in recordings]
        with ExitStack() as shown:

            def seen(work: str):
                shown.close()  # one display at a time
                return shown.enter_context(counted(work, "done", quiet=quiet))

            calibrated_robot(build_robot(settings), read, fitted, presses=None, seen=seen)
    return fitted


def _sections(bed: Bed) -> list[tuple[str, str]]:
    """Headings and HTML of what the test bed is."""
    rows = [*bed.robot.told.items(), ("estimates", f"of each {EVERY}th frame, and of each sample")]
    sections = [("The test bed", table(("", ""), rows))]
    if bed.fitted_to:
        sections.append(
            (
                "Calibration",
                f"<p>Fitted to {bed.fitted_to} presses that are not among these: "
                '<a href="fitted.html">report</a>.</p>',
            )
        )
    return sections
