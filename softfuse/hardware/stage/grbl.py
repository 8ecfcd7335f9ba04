"""grbl 1.1.

    start       "Grbl 1.1h ['$' for help]", after a reset by Ctrl-X too
    answers     "ok" or "error:N" to each line; "ALARM:N" at any time
    "?"         "<Idle|MPos:0.000,0.000,0.000|...>", also while a line is carried out
    "G4 P0"     is answered when all moves are done
    "!"         feed hold: slows down at once; "Hold:1" until it stands, then "Hold:0"
    Ctrl-X      reset; without an alarm where it stands

Positions are machine's (MPos) or work (WPos), which differ by the offset WCO, told now and then; moves are
in work coordinates.

Source: grbl's documentation of its interface and its tables of alarms and errors (gnea/grbl,
doc/markdown/interface.md, doc/csv), version 1.1.
"""

import re
from collections.abc import Callable
from time import monotonic

from softfuse.errors import HardwareError
from softfuse.hardware.stage.dialect import PATIENCE_S, AbstractDialect, Heard, Millimetres, Talk

_HOME_AGAIN = "the position is lost: reset and home the stage"
ALARMS = {
    1: f"an end switch was hit; {_HOME_AGAIN}",
    2: "the target lies beyond the machine's travel (soft limit): correct the workspace; reset and unlock",
    3: f"it was reset while it moved; {_HOME_AGAIN}",
    4: "the probe was not in its first state",
    5: "the probe touched nothing",
    6: f"homing was interrupted by a reset; {_HOME_AGAIN}",
    7: f"homing was interrupted by the safety door; {_HOME_AGAIN}",
    8: "homing did not get off the end switch: increase the pull-off or check the wiring",
    9: "homing did not find the end switch: check the switch and the travel settings",
}
ERRORS = {
    1: "a letter was expected",
    2: "a number cannot be read",
    3: "an unknown $ command",
    5: "homing is not enabled in grbl's settings ($22=1)",
    8: "a $ command is taken only while the stage is idle",
    9: "moves are locked after an alarm or at the start: home the stage",
    11: "the line is too long",
    13: "the safety door is open: close it",
    15: "the target lies beyond the machine's travel",
    20: "an unsupported command",
    22: "no feed rate is set",
    33: "the target of the move is invalid",
}
_STATUS = re.compile(r"<([A-Za-z]+(?::\d+)?)\|(.*)>")
_RESET = b"\x18"
_ASK_S = 0.1
"""How often the stage is asked where it is [s]; the documentation says 5 Hz to 10 Hz."""
_STANDING_S = 10.0
"""How long a halt may take [s]."""


class Grbl(AbstractDialect):
    """One stage with grbl; it remembers the offset between its two kinds of positions."""

    name = "grbl"
    hello = _RESET
    setup = ("G21", "G90", "G94")
    home = "$H"
    settle = "G4 P0"
    pulse = b"?"
    halt = b"!"
    abort = _RESET

    def __init__(self) -> None:
        self._offset: Millimetres | None = None

    def heard(self, line: str) -> Heard:
        """A status has no place until the offset has been told, which a reset forgets."""
        if line.startswith("Grbl "):
            # The first report after a reset tells the offset anew.
            self._offset = None
            return Heard(greeting=True)
        error, alarm = _number(line, "error:"), _number(line, "ALARM:")
        if error is not None:
            return Heard(refusal=f"{ERRORS.get(error, 'see its table of errors')} (error {error})")
        if alarm is not None:
            return Heard(trouble=f"{ALARMS.get(alarm, 'see its table of alarms')} (alarm {alarm})")
        match = _STATUS.fullmatch(line)
        if match is None:
            return Heard(answer=line == "ok")
        fields = dict(field.split(":", 1) for field in match[2].split("|") if ":" in field)
        if "WCO" in fields:
            self._offset = _triple(fields["WCO"])
        place = _triple(fields.get("WPos", fields.get("MPos", "")))
        if "WPos" in fields or place is None or self._offset is None:
            return Heard(place=place if "WPos" in fields else None, state=match[1])
        x, y, z = (there - offset for there, offset in zip(place, self._offset, strict=True))
        return Heard(place=(x, y, z), state=match[1])

    def working(self, state: str) -> bool:
        """Not while it is idle, held, or waits for a door."""
        return state.startswith(("Run", "Jog", "Home", "Hold:1"))

    def locate(self, talk: Talk) -> Millimetres:
        """By "?", again and again until the offset is told too."""
        talk.place = None
        _ask_until(talk, lambda: talk.place is not None, PATIENCE_S, talk.send)
        talk.check()
        assert talk.place is not None
        return talk.place

    def recover(self, talk: Talk) -> None:
        """Wait until it stands, for a reset in motion would lose the position; then reset it."""
        talk.state = ""
        talk.send_halted(self.halt)
        _ask_until(talk, lambda: _stands(talk.state), _STANDING_S, talk.send_halted)
        talk.send_halted(_RESET)
        end = monotonic() + PATIENCE_S
        while not any(heard.greeting for heard in talk.lines()):
            if monotonic() > end:
                raise HardwareError("the stage does not greet after a reset: switch it off and on")
        talk.drain()


def _ask_until(
    talk: Talk, done: Callable[[], bool], patience_s: float, send: Callable[[bytes], None]
) -> None:
    end = monotonic() + patience_s
    while monotonic() < end:
        send(b"?")
        pause = monotonic() + _ASK_S
        while monotonic() < pause:
            talk.lines()
            if done() or talk.trouble is not None:
                return
    raise HardwareError(f"the stage has not told where it is for {patience_s:g} s: is it switched on?")


def _stands(state: str) -> bool:
    return state in ("Hold:0", "Idle") or state.startswith(("Alarm", "Sleep", "Check"))


def _number(line: str, start: str) -> int | None:
    rest = line.removeprefix(start)
    return int(rest) if rest != line and rest.isascii() and rest.isdigit() else None


def _triple(text: str) -> Millimetres | None:
    try:
        x, y, z, *_ = (float(part) for part in text.split(","))
    except ValueError:
        return None
    return x, y, z
