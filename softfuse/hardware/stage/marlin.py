"""Marlin 2.

    start       "start"; M115 is answered "FIRMWARE_NAME:Marlin ...", lines "Cap:...", then "ok"
    answers     "ok" to each line, perhaps after "Error:..."; "echo:busy: processing" while it takes long
    M114        "X:0.00 Y:0.00 Z:0.00 E:0.00 Count X:0 Y:0 Z:0", the end of the last move that was taken
    M400        is answered when all moves are done
    M410        stops at once; then M114 tells where
    G28         homes
    "Error:Printer halted. kill() called!"     it takes nothing any more until it is reset

With EMERGENCY_PARSER in the firmware M410 is seen as it comes, without it only after the command before it,
which may be an M400. So M400 is sent when the move should be over, and a stop during the move is at once.

Source: Marlin's G-code documentation (M114, M115, M400, M410, G28) and logs of hosts that talk to it.
"""

import re
from time import monotonic

from softfuse.errors import HardwareError
from softfuse.hardware.stage.dialect import AbstractDialect, Millimetres, Report, Talk

_PLACE = re.compile(r"X:\s*(-?[\d.]+) Y:\s*(-?[\d.]+) Z:\s*(-?[\d.]+)(?: .*)?")
_STANDING_S = 10.0
"""How long a halt may take [s]."""
_FATAL = ("halted", "kill()", "stopped due to errors")


class Marlin(AbstractDialect):
    """One stage with Marlin."""

    name = "Marlin"
    hello = b"M115\n"
    setup = ("G21", "G90")
    home = "G28"
    settle = "M400"
    pulse = b""
    halt = abort = b"M410\n"

    def greeted(self, line: str) -> bool:
        """The answer to M115."""
        return line.startswith("FIRMWARE_NAME:")

    def answered(self, line: str) -> bool:
        """ok, perhaps with the state of the buffers"""
        return line == "ok" or line.startswith("ok ")

    def refused(self, line: str) -> str | None:
        """What is no command to it; anything else that it does not like it tells as an error."""
        if line.startswith("echo:Unknown command"):
            return line.removeprefix("echo:")
        if line.startswith("echo:Home") and "first" in line.lower():
            return f"{line.removeprefix('echo:')}: home the stage"
        if line.startswith("Error:") and self.broken(line) is None:
            return line.removeprefix("Error:")
        return None

    def broken(self, line: str) -> str | None:
        """Halted, or reset behind the host's back."""
        if line.startswith("Error:") and any(word in line for word in _FATAL):
            return f"{line.removeprefix('Error:')} Reset it and home the stage"
        if line == "start":
            return "it was reset, the position is lost: home the stage"
        return None

    def report(self, line: str) -> Report | None:
        """The answer to M114."""
        match = _PLACE.fullmatch(line)
        if match is None:
            return None
        try:
            x, y, z = (float(part) for part in match.groups())
        except ValueError:
            return None
        return Report((x, y, z), "")

    def working(self, state: str) -> bool:
        """Whatever it says: it tells that it is busy, and does not say with what."""
        return True

    def locate(self, talk: Talk) -> Millimetres:
        """By M114."""
        talk.place = None
        talk.command("M114")
        if talk.place is None:
            raise HardwareError("the stage has answered M114 without a position: is it Marlin?")
        return talk.place

    def recover(self, talk: Talk) -> None:
        """Wait for the position, which it tells once it stands, and for the answers that were under way."""
        talk.place = None
        talk.send_halted(self.halt)
        talk.send_halted(b"M114\n")
        end = monotonic() + _STANDING_S
        while talk.place is None:
            if monotonic() > end:
                raise HardwareError(f"the stage does not answer for {_STANDING_S:g} s after a stop")
            talk.lines()
        talk.drain()
