"""What is found out about one thing."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

State = Literal["ok", "note", "problem"]


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
