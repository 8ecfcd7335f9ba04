"""`softfuse evaluate`: what a virtual test bed does, recorded as a real one would, estimates of these on a
core each, and what is written of them: a page, tables as LaTeX and CSV, figures as PNG and PDF.
"""

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float
from tabulate import tabulate

from softfuse.estimation.batch import cores
from softfuse.estimation.stream import follow
from softfuse.estimation.tracker import Tracker
from softfuse.experiment.accuracy import Spread
from softfuse.experiment.paper.bed import Bed
from softfuse.experiment.pose_cache import Arrays, kept
from softfuse.experiment.recording_file import write_recording
from softfuse.io.result_folder import put_in_place, writing
from softfuse.report.calibration import Seen, calibrated_robot
from softfuse.report.page import UNKNOWN, page, picture, spread_cells, table
from softfuse.report.presses import Part, read_sensors, sensor_frames
from softfuse.report.recording_report import EstimateRows
from softfuse.report.study import Study
from softfuse.robot.robot import Robot, build_robot
from softfuse.robot.settings import RobotSettings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_ABOUT = (
    f"<p>Paper: Navarro et al., RA-L 5(4), 2020, on their own robot; {UNKNOWN} where its figure is not at "
    "hand. The others: this robot, on a virtual test bed.</p>"
)

EVERY = 10
"""Frames from one estimate to the next: ten estimates a second, which a full body manages live."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """One table: a name for its files, its title, the unit of all its figures.

    paper: mean errors that the paper reports, by group; found: mean and standard deviation by group, of each
    way of estimating; named: what to call groups.
    """

    name: str
    title: str
    unit: str
    paper: Mapping[str, float]
    found: Mapping[str, Mapping[str, Spread]]
    named: Mapping[str, str]

    @property
    def head(self) -> tuple[str, ...]:
        """The cells of its head."""
        ways = [f"{way} {what} [{self.unit}]" for way in self.found for what in ("mean", "std")]
        return ("samples", f"paper [{self.unit}]", *ways, "n")

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """The cells of its rows, of groups with samples."""
        groups = next(iter(self.found.values()))
        return [self._row(group) for group, each in groups.items() if each.n]

    def _row(self, group: str) -> tuple[str, ...]:
        spreads = [groups[group] for groups in self.found.values()]
        paper = f"{self.paper[group]:g}" if group in self.paper else UNKNOWN
        cells = [cell for each in spreads for cell in spread_cells(each)]
        return (self.named.get(group, group), paper, *cells, str(spreads[-1].n))

    @property
    def html(self) -> str:
        """For a page."""
        return table(self.head, self.rows)

    @property
    def text(self) -> str:
        """For a terminal."""
        return tabulate(self.rows, self.head, tablefmt="simple", disable_numparse=True)

    @property
    def latex(self) -> str:
        """A tabular with the rules of the package booktabs."""
        rows = [[cell.replace(UNKNOWN, "--") for cell in row] for row in self.rows]
        return tabulate(rows, self.head, tablefmt="latex_booktabs", disable_numparse=True) + "\n"

    @property
    def csv(self) -> str:
        """Comma-separated; what is not known is empty."""
        text = io.StringIO()
        rows = [[cell.replace(UNKNOWN, "") for cell in row] for row in self.rows]
        csv.writer(text, lineterminator="\n").writerows([self.head, *rows])
        return text.getvalue()


@dataclass(frozen=True, eq=False)
class Plate:
    """A figure, the name of its files, and its caption."""

    name: str
    caption: str
    figure: "Figure"


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Tables, figures, further sections (heading, HTML), and columns (s,) of all samples of each way."""

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
    """Write everything, further sections too, and return the files; SoftfuseError when that cannot be."""
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


def record(bed: Bed, folder: Path, *, solved: Callable[[], None]) -> list[Path]:
    """A recording of each thing that is done, in folder/recordings; those that are there are kept, as are
    equilibria in folder/equilibria.

    `solved` is called after each equilibrium. Raises SolveError when the body cannot be pressed,
    SoftfuseError when a file cannot be written.
    """
    paths = [folder / "recordings" / f"{name}.csv.gz" for name in bed.names]
    if all(path.exists() for path in paths):
        return paths
    played = bed.played(folder / "equilibria", solved)
    with writing(folder):
        paths[0].parent.mkdir(exist_ok=True)
        for k, (path, performance) in enumerate(zip(paths, played, strict=True)):
            if not path.exists():
                columns = performance.recording(bed.seed, k + 1)
                numbered = {"press": (columns["press"][0], np.full(len(performance.frames.time_s), float(k)))}
                with put_in_place(path) as part:
                    write_recording(part, columns | numbered)
    return paths


def estimates(
    settings: RobotSettings,
    recordings: Sequence[Path],
    folder: Path,
    evaluator: Evaluator,
    *,
    done: Callable[[], None],
) -> list[Arrays]:
    """The evaluator's arrays of each recording, in their order.

    They are kept in the folder, with the estimates as CSV, and not estimated again where they are there.
    `done` is called after each.
    """
    files = [path.name.removesuffix(".csv.gz") for path in recordings]

    def start() -> Callable[[int], Mapping[str, np.ndarray]]:
        robot = build_robot(settings)
        trackers: SimpleQueue[Tracker] = SimpleQueue()
        for _ in range(min(cores(), len(files))):
            trackers.put(Tracker(robot))
        folder.mkdir(parents=True, exist_ok=True)

        def compute(k: int) -> Mapping[str, np.ndarray]:
            whole = read_sensors(settings, recordings[k])
            part = Part.of(whole, EVERY)
            study, tracker = Study(robot, part.recording), trackers.get()
            try:
                tracker.reset()
                frames = zip(sensor_frames(settings, whole), part.estimated, strict=True)
                with (folder / f"{files[k]}.csv").open("w", newline="") as stream:
                    rows = EstimateRows(stream, study)
                    for now in follow(tracker, frames):
                        study.see(now)
                        rows.write()
            finally:  # the others wait for it
                trackers.put(tracker)
            done()
            return evaluator.said(study)

        return compute

    return kept(folder, files, evaluator.names, start)


def fitted(settings: RobotSettings, recordings: Sequence[Path], folder: Path, *, seen: Seen) -> Path:
    """The configuration fitted to all samples of some recordings, fitted.toml, with the files beside it; not
    fitted again where these are there.
    """
    path = folder / "fitted.toml"
    if not all(path.with_suffix(suffix).exists() for suffix in (".toml", ".npz", ".html")):
        read = [read_sensors(settings, recording) for recording in recordings]
        calibrated_robot(build_robot(settings), read, path, seen=seen)
    return path


def sections(bed: Bed) -> list[tuple[str, str]]:
    """Headings and HTML of what the test bed is."""
    rows = [*bed.robot.told.items(), ("estimates", f"of each {EVERY}th frame, and of each sample")]
    found = [("The test bed", table(("", ""), rows))]
    if bed.fitted_to:
        told = f"<p>Fitted to {bed.fitted_to} presses that are not among these: "
        found.append(("Calibration", f'{told}<a href="fitted.html">report</a>.</p>'))
    return found
