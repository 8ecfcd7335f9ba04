"""Draw the images of softfuse.report.paper_evaluation; called by grid-images."""

from pathlib import Path
from typing import Annotated

import typer

from softfuse.cli.terminal import stderr, stdout
from softfuse.experiment.paper.mutual_bed import MutualBed
from softfuse.report.paper_evaluation import fig_11


def main(path: Annotated[Path, typer.Argument(help="Picture to write: .png, .svg or .pdf.")]) -> None:
    """Draw what a virtual grid of mutual capacitances sees: things near, light and firm, plastic, two."""
    try:
        fig_11(MutualBed()).savefig(path)
    except (OSError, ValueError) as error:
        stderr.print(f"error: {path}: {error}", markup=False, highlight=False, soft_wrap=True)
        raise SystemExit(2) from None
    stdout.print(f"{path} shows the virtual grid", markup=False, highlight=False)


if __name__ == "__main__":
    typer.run(main)
