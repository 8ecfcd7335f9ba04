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
from softfuse.hardware.stage.dialect import AbstractDialect, Heard, Millimetres, Talk

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

    def heard(self, line: str) -> Heard:
        """It tells as an error what it does not like, be it that it has given up."""
        if line.startswith("FIRMWARE_NAME:"):
            return Heard(greeting=True)
        # Perhaps with the state of the buffers.
        if line == "ok" or line.startswith("ok "):
            return Heard(answer=True)
        if line == "start":
            return Heard(trouble="it was reset, the position is lost: home the stage")
        error, remark = line.removeprefix("Error:"), line.removeprefix("echo:")
        if error != line and any(word in line for word in _FATAL):
            return Heard(trouble=f"{error} Reset it and home the stage")
        if error != line:
            return Heard(refusal=error)
        if line.startswith("echo:Unknown command"):
            return Heard(refusal=remark)
        if line.startswith("echo:Home") and "first" in line.lower():
            return Heard(refusal=f"{remark}: home the stage")
        match = _PLACE.fullmatch(line)
        if match is None:
            return Heard()
        try:
            x, y, z = (float(part) for part in match.groups())
        except ValueError:
            return Heard()
        return Heard(place=(x, y, z))

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
