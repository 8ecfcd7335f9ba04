"""What softfuse doctor finds out, and how it is told."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

from rich.table import Table
from rich.text import Text

from softfuse.cli.terminal import printable

State = Literal["ok", "note", "problem"]
_SIGNS: dict[State, tuple[str, str]] = {
    "ok": ("ok", "green"),
    "note": ("note", "cyan"),
    "problem": ("problem", "red"),
}


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    about: what; state: a note is what may be as it is; said: how it is; remedy: what to do, "" where nothing
    is to be done; measured: the numbers behind it, for machines.
    """

    about: str
    state: State
    said: str
    remedy: str = ""
    measured: dict[str, object] = field(default_factory=dict)

    def as_json(self) -> dict[str, object]:
        """As it is told to machines."""
        told: dict[str, object] = {"about": self.about, "state": self.state, "said": self.said}
        if self.remedy:
            told["remedy"] = self.remedy
        return told | ({"measured": self.measured} if self.measured else {})


def well(findings: Sequence[Finding]) -> bool:
    """Whether there is no problem."""
    return all(finding.state != "problem" for finding in findings)


def findings_table(findings: Sequence[Finding]) -> Table:
    """As people read them; nothing in it can command a terminal."""
    table = Table.grid(padding=(0, 2))
    for finding in findings:
        word, colour = _SIGNS[finding.state]
        said = f"{finding.said}: {finding.remedy}" if finding.remedy else finding.said
        about, said = (printable(text).replace("\n", " ") for text in (finding.about, said))
        table.add_row(Text(word, style=colour), Text(about), Text(said, overflow="fold"))
    return table
