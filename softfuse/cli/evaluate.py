"""softfuse evaluate: the evaluation of Navarro et al. 2020 on a virtual test bed, beside their figures."""

from pathlib import Path
from typing import Annotated

import typer

from softfuse.cli.options import Quiet, out_folder
from softfuse.cli.progress import steps
from softfuse.cli.terminal import say, termination_interrupts
from softfuse.experiment.paper.bed import build_bed
from softfuse.io.result_folder import claim
from softfuse.report.evaluation import estimates, fitted, record, sections, write_evaluation
from softfuse.report.paper_evaluation import PRESSES, PUSHES
from softfuse.robot.digest import digest
from softfuse.robot.file import load
from softfuse.robot.robot import build_robot


def evaluate(
    config: Annotated[Path, typer.Argument(help="Configuration of a robot of the paper's kind (TOML).")],
    out: Annotated[Path, out_folder("Folder for the results; an evaluation in it is continued.")],
    grid: Annotated[
        int, typer.Option(help="A block is pressed at so many times so many places.", min=2, max=30)
    ] = 10,
    seed: Annotated[int, typer.Option(help="Another body with other sensors.", min=0)] = 1,
    quiet: Quiet = False,
) -> None:
    """Press a virtual robot as the paper did, estimate, and write its tables and figures; goes on where it
    stopped.
    """
    settings = load(config)
    bed = build_bed(settings, grid=grid, seed=seed)
    identity = {"config": digest(settings), "grid": str(grid), "seed": str(seed)}
    claim(out, "evaluation.json", "an evaluation", identity, parts="estimates/*/*.npz")
    evaluator = PUSHES if bed.pushes else PRESSES
    with steps(quiet=quiet) as begin, termination_interrupts():
        recordings = record(bed, out, solved=begin("pressing the test bed", bed.equilibria))
        configs = {"as drawn": config}
        if bed.fitted_to:
            configs["calibrated"] = fitted(settings, recordings[: bed.fitted_to], out, seen=begin)
        found, pressed = {}, recordings[bed.fitted_to :]
        for way, path in configs.items():
            folder, done = out / "estimates" / way.replace(" ", "_"), begin(f"estimating {way}", len(pressed))
            found[way] = estimates(load(path), pressed, folder, evaluator, done=done)
        begin("writing the report")
        evaluation = evaluator.evaluation(build_robot(settings), found)
        title = f"{settings.robot.name}: evaluation"
        written = write_evaluation(out, title, evaluation, sections(bed))
    say(*(f"{each.title}\n{each.text}\n" for each in evaluation.tables), quiet=quiet)
    say(f"written to {out}: report.html and {len(written) - 1} tables and figures", quiet=quiet)
