"""Tables beside the paper's, in each of their forms."""

import csv
import dataclasses
import io

from softfuse.experiment.accuracy import Spread
from softfuse.report.evaluation import Comparison

TABLE = Comparison(
    "table_2",
    "Table II: force error",
    "%",
    {"all": 10.9, "circle": 7.8},
    {
        "as drawn": {
            "all": Spread(9.04, 6.0, 300),
            "circle": Spread(8.9, 5.0, 200),
            "level_1": Spread(1, 2, 99),
        },
        "calibrated": {
            "all": Spread(3.3, 2, 300),
            "circle": Spread(3.4, 2, 200),
            "level_1": Spread(0.5, 1, 100),
        },
    },
    {"all": "all", "circle": "within 28 mm", "level_1": "5 N"},
)


def test_the_papers_figures_stand_beside_ours_and_unknown_ones_are_told() -> None:
    assert TABLE.head == (
        "samples", "paper [%]", "as drawn mean [%]", "as drawn std [%]",
        "calibrated mean [%]", "calibrated std [%]", "n",
    )  # fmt: skip
    assert TABLE.rows == [
        ("all", "10.9", "9.04", "6.00", "3.30", "2.00", "300"),
        ("within 28 mm", "7.8", "8.90", "5.00", "3.40", "2.00", "200"),
        ("5 N", "–", "1.00", "2.00", "0.50", "1.00", "100"),
    ]


def test_groups_without_samples_are_left_out() -> None:
    found = {
        way: groups | {"none": Spread(float("nan"), float("nan"), 0)} for way, groups in TABLE.found.items()
    }
    assert dataclasses.replace(TABLE, found=found).rows == TABLE.rows


def test_csv_can_be_read_again_and_leaves_empty_what_is_not_known() -> None:
    head, *rows = csv.reader(io.StringIO(TABLE.csv))
    assert tuple(head) == TABLE.head and rows[0] == list(TABLE.rows[0]) and rows[2][1] == ""


def test_latex_escapes_and_has_a_line_for_each_row() -> None:
    lines = TABLE.latex.splitlines()
    assert lines[0].startswith(r"\begin{tabular}") and lines[-1] == r"\end{tabular}"
    assert r"paper [\%]" in TABLE.latex and "–" not in TABLE.latex
    cells = [cell.strip() for cell in lines[5].removesuffix(r"\\").split("&")]
    assert cells == ["within 28 mm", "7.8", "8.90", "5.00", "3.40", "2.00", "200"]


def test_html_holds_all_cells() -> None:
    assert all(f"<td>{cell}</td>" in TABLE.html for row in TABLE.rows for cell in row)
