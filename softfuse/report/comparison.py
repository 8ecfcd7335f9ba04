"""Tables of errors beside those that the paper reports, as pages, LaTeX and CSV show them."""

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass

from tabulate import tabulate

from softfuse.experiment.accuracy import Spread
from softfuse.report.page import table

UNKNOWN = "–"
"""Stands where a figure is not known."""


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
        cells = [f"{value:.2f}" for each in spreads for value in (each.mean, each.std)]
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
