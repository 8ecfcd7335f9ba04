"""What people should know of a source, a few a second at most: a board may print without end."""

from softfuse.hardware.stream import Level, Notice

MOST = 10
"""Notices in a second of the host's time."""
LONGEST = 500
"""Characters of a notice."""


class Remarks:
    """Gathers notices; what is too much is counted instead."""

    def __init__(self) -> None:
        self._notices: list[Notice] = []
        self._second = -1
        self._in_second = 0
        self.left_out = 0
        """Notices that were too many."""

    def add(self, host_s: float, level: Level, text: str) -> None:
        """Note a remark of the host's time host_s [s]."""
        second = int(host_s)
        if second != self._second:
            self._second, self._in_second = second, 0
        self._in_second += 1
        if self._in_second > MOST:
            self.left_out += 1
            return
        cut = text if len(text) <= LONGEST else text[:LONGEST] + "…"
        self._notices.append(Notice(host_s, None, level, cut))

    def take(self) -> list[Notice]:
        """The notices since the last time."""
        taken, self._notices = self._notices, []
        return taken
