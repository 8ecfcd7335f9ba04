"""The report of an estimated recording: one HTML file that needs nothing else."""

import base64
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

from softfuse.experiment.accuracy import Spread

if TYPE_CHECKING:
    from matplotlib.figure import Figure

UNKNOWN = "–"
"""Stands where a figure is not known."""

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222 }
body { max-width: 62rem; margin: 2rem auto; padding: 0 1rem }
table { border-collapse: collapse; margin: 1rem 0 }
th, td { padding: .25rem .9rem; border-bottom: 1px solid #ddd; text-align: right }
th:first-child, td:first-child { text-align: left }
img { max-width: 100% } figure { margin: 1.5rem 0 } figcaption { color: #555 }
"""


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """An HTML table with a head of cells and rows of cells of text."""
    titles = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><thead><tr>{titles}</tr></thead><tbody>{body}</tbody></table>"


def spread_cells(spread: Spread) -> tuple[str, str]:
    """Mean and standard deviation as cells of a table."""
    mean, std = (UNKNOWN if math.isnan(x) else f"{x:.2f}" for x in (spread.mean, spread.std))
    return mean, std


def spread_table(unit: str, groups: Mapping[str, Spread]) -> str:
    """An HTML table of means and standard deviations, in the unit of its head."""
    rows = [(name, *spread_cells(spread), str(spread.n)) for name, spread in groups.items()]
    return table(("samples", f"mean [{unit}]", f"std [{unit}]", "n"), rows)


def picture(figure: "Figure", caption: str) -> str:
    """A figure with its caption, the image inside the HTML."""
    data = io.BytesIO()
    figure.savefig(data, format="png")
    encoded = base64.b64encode(data.getvalue()).decode()
    text = escape(caption)
    return (
        f'<figure><img src="data:image/png;base64,{encoded}" alt="{text}">'
        f"<figcaption>{text}</figcaption></figure>"
    )


def page(title: str, sections: Iterable[tuple[str, str]]) -> str:
    """A whole page of (heading, HTML) sections."""
    body = "".join(f"<h2>{escape(heading)}</h2>{content}" for heading, content in sections)
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f"<style>{_STYLE}</style></head><body><h1>{escape(title)}</h1>{body}</body></html>\n"
    )
