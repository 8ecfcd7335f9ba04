"""What `softfuse evaluate` writes at the end: a page, tables as LaTeX and CSV, figures as PNG and PDF."""

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from softfuse.experiment.pose_cache import Arrays
from softfuse.io.result_folder import writing
from softfuse.report.comparison import UNKNOWN, Comparison
from softfuse.report.page import page, picture
from softfuse.report.study import Study
from softfuse.robot.robot import Robot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_ABOUT = (
    f"<p>Paper: Navarro et al., RA-L 5(4), 2020, on their own device; {UNKNOWN} where its figure is not at "
    "hand. The others: this robot, on a virtual test bed.</p>"
)


@dataclass(frozen=True, eq=False)
class Plate:
    """A figure, the name of its files, and its caption."""

    name: str
    caption: str
    figure: "Figure"


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Tables, figures, further sections (heading, HTML), and columns (s,) of all samples of each way of
    estimating.
    """

    tables: tuple[Comparison, ...]
    plates: tuple[Plate, ...]
    sections: tuple[tuple[str, str], ...]
    samples: Mapping[str, Mapping[str, Float[np.ndarray, " s"]]]


@dataclass(frozen=True, eq=False)
class Evaluator:
    """How what one kind of test bed does is evaluated.

    names: of the arrays that are kept of each recording; said: these arrays of a study; evaluation: from the
    robot and the arrays of all recordings, estimated in some ways.
    """

    names: frozenset[str]
    said: Callable[[Study], Arrays]
    evaluation: Callable[[Robot, Mapping[str, Sequence[Arrays]]], Evaluation]


def write_evaluation(
    folder: Path, title: str, evaluation: Evaluation, sections: Sequence[tuple[str, str]]
) -> list[Path]:
    """Write everything into the folder, further sections among it, and return the files; raises SoftfuseError
    when that cannot be.
    """
    with writing(folder):
        written = [folder / "report.html"]
        for name in ("tables", "figures"):
            (folder / name).mkdir(exist_ok=True)
        for each in evaluation.tables:
            for suffix, text in ((".tex", each.latex), (".csv", each.csv)):
                written.append(folder / "tables" / f"{each.name}{suffix}")
                written[-1].write_text(text, encoding="utf-8")
        for plate in evaluation.plates:
            for suffix in (".png", ".pdf"):
                written.append(folder / "figures" / f"{plate.name}{suffix}")
                plate.figure.savefig(written[-1])
        for way, columns in evaluation.samples.items():
            written.append(folder / "tables" / f"samples_{way.replace(' ', '_')}.csv")
            with written[-1].open("w", newline="") as stream:
                rows = csv.writer(stream, lineterminator="\n")
                rows.writerow(columns)
                rows.writerows(
                    [f"{value:.6g}" for value in row] for row in zip(*columns.values(), strict=True)
                )
        parts = [(each.title, each.html) for each in evaluation.tables]
        figures = "".join(picture(plate.figure, plate.caption) for plate in evaluation.plates)
        everything = [("About", _ABOUT), *parts, *evaluation.sections, *sections, ("Figures", figures)]
        written[0].write_text(page(title, everything), encoding="utf-8")
    return written
