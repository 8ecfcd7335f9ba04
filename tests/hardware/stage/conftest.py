"""Stages on pseudo-terminals: controllers that keep track of place and time, after their documentation."""

import contextlib
import math
import os
import re
import threading
import time
from collections import deque
from collections.abc import Iterator

import pytest

from softfuse.hardware.source.port import open_serial
from softfuse.hardware.stage.gcode import GcodeStage, Workspace
from softfuse.hardware.stage.grbl import Grbl
from softfuse.hardware.stage.marlin import Marlin


class Controller(threading.Thread):
    """What both firmwares have in common: a queue of straight moves, carried out in real time."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.master, slave = os.openpty()
        self.path = os.ttyname(slave)
        # Nobody hears the controller's echo before the port is opened, nor does it hear itself.
        self.slave = slave
        os.set_blocking(self.master, False)
        self.place = [0.0, 0.0, 0.0]
        self.moves: deque[tuple[list[float], float]] = deque()
        self.queue: deque[str] = deque()
        self.heard: list[str] = []
        self.blocked_by: str | None = None
        self.fastest = math.inf
        self.ended = threading.Event()
        self.acts: deque = deque()

    def run(self) -> None:
        partial = b""
        before = time.monotonic()
        while not self.ended.wait(0.002):
            with contextlib.suppress(BlockingIOError, OSError):
                partial = self.take(partial + os.read(self.master, 1000))
            while self.acts:
                self.acts.popleft()()
            now = time.monotonic()
            self.advance(now - before)
            before = now
            if self.blocked_by is not None and not self.moves:
                self.unblock()
            while self.queue and self.blocked_by is None:
                self.execute(self.queue.popleft())

    def advance(self, seconds: float) -> None:
        while self.moves and seconds > 0.0:
            target, speed = self.moves[0]
            distance = math.dist(self.place, target)
            step = min(speed, self.fastest) * seconds
            if step < distance:
                self.place = [a + (b - a) * step / distance for a, b in zip(self.place, target, strict=True)]
                return
            self.place = list(target)
            self.moves.popleft()
            seconds -= distance / min(speed, self.fastest)

    def say(self, text: str) -> None:
        os.write(self.master, text.encode() + b"\r\n")

    def do(self, act) -> None:
        """Let something happen in the controller's own thread."""
        self.acts.append(act)

    def shut(self) -> None:
        self.ended.set()
        self.join()
        os.close(self.slave)
        with contextlib.suppress(OSError):
            os.close(self.master)


def words(line: str) -> dict[str, float]:
    return {letter: float(number) for letter, number in re.findall(r"([A-Z])(-?[\d.]+)", line)}


class SimulatedGrbl(Controller):
    """grbl 1.1: work coordinates apart from the machine's, realtime characters, ramps when held."""

    def __init__(self) -> None:
        super().__init__()
        self.offset = [10.0, 20.0, -5.0]
        self.place = list(self.offset)
        self.travel = 200.0
        self.state = "Idle"
        self.ramp = 0.0
        self.homing = True
        self.reports = 0
        self.halts: list[float] = []

    def boot(self, locked: bool = False) -> None:
        self.moves.clear()
        self.queue.clear()
        self.blocked_by = None
        self.reports = 0
        self.state = "Alarm" if locked else "Idle"
        self.say("")
        self.say("Grbl 1.1h ['$' for help]")
        if locked:
            self.say("[MSG:'$H'|'$X' to unlock]")

    def take(self, data: bytes) -> bytes:
        for byte in data:
            if byte == ord("?"):
                self.tell()
            elif byte == ord("!"):
                self.halts.append(time.monotonic())
                if self.state == "Run":
                    self.state, self.ramp = "Hold:1", 0.05
                elif self.state == "Idle":
                    self.state = "Hold:0"
            elif byte == 0x18:
                moving = self.state in ("Run", "Hold:1", "Home")
                if moving:
                    self.say(f"ALARM:{6 if self.state == 'Home' else 3}")
                self.boot(locked=moving or self.state == "Alarm")
        data = data.translate(None, b"?!\x18")
        *lines, rest = data.split(b"\n")
        for line in lines:
            self.heard.append(line.decode().strip())
            self.queue.append(self.heard[-1])
        return rest

    def tell(self) -> None:
        if self.state in ("Home", "Dead"):
            return
        numbers = ",".join(f"{value:.3f}" for value in self.place)
        offset = ",".join(f"{value:.3f}" for value in self.offset)
        self.say(
            f"<{self.state}|MPos:{numbers}|FS:0,0" + (f"|WCO:{offset}>" if self.reports % 10 == 0 else ">")
        )
        self.reports += 1

    def advance(self, seconds: float) -> None:
        if self.state == "Run" or self.state == "Home":
            super().advance(seconds)
            if not self.moves and self.state == "Run":
                self.state = "Idle"
        elif self.state == "Hold:1":
            super().advance(min(seconds, self.ramp))
            self.ramp -= seconds
            if self.ramp <= 0.0:
                self.state = "Hold:0"

    def unblock(self) -> None:
        if self.blocked_by == "$H":
            self.state = "Idle"
        self.blocked_by = None
        self.say("ok")

    def execute(self, line: str) -> None:
        if self.state.startswith("Hold"):
            self.queue.appendleft(line)
            self.blocked_by = "hold"
            return
        if line == "$H":
            if not self.homing:
                self.say("error:5")
                return
            self.state = "Home"
            self.blocked_by = line
            self.moves.append(([0.0, 0.0, 0.0], 100.0))
        elif self.state == "Alarm":
            self.say("error:9")
        elif line == "G4 P0":
            self.blocked_by = line
        elif line in ("G21", "G90", "G94"):
            self.say("ok")
        elif line.startswith("G1 "):
            said = words(line)
            target = [said[axis] + offset for axis, offset in zip("XYZ", self.offset, strict=True)]
            if max(map(abs, target)) > self.travel:
                self.say("ALARM:2")
                self.say("[MSG:Reset to continue]")
                self.state = "Dead"
                return
            self.moves.append((target, said["F"] / 60.0))
            self.state = "Run"
            self.say("ok")
        else:
            self.say("error:20")

    def hit_a_switch(self) -> None:
        self.moves.clear()
        self.state = "Dead"
        self.say("ALARM:1")
        self.say("[MSG:Reset to continue]")


class SimulatedMarlin(Controller):
    """Marlin 2, with or without its emergency parser."""

    def __init__(self, emergency: bool) -> None:
        super().__init__()
        self.emergency = emergency
        self.dead = False
        self.busy = 0.0
        self.halts: list[float] = []

    def boot(self) -> None:
        self.moves.clear()
        self.queue.clear()
        self.blocked_by = None
        self.say("start")
        self.say("echo: Last Updated: 2022-08-06 | Author: (none, default config)")

    def take(self, data: bytes) -> bytes:
        *lines, rest = data.split(b"\n")
        for raw in lines:
            line = raw.decode().strip()
            self.heard.append(line)
            if self.dead:
                continue
            if line == "M410":
                self.halts.append(time.monotonic())
                if self.emergency:
                    self.moves.clear()
            self.queue.append(line)
        return rest

    def advance(self, seconds: float) -> None:
        super().advance(seconds)
        self.busy += seconds
        if self.blocked_by is not None and self.busy > 0.1 and not self.dead:
            self.busy = 0.0
            self.say("echo:busy: processing")

    def unblock(self) -> None:
        if not self.dead:
            self.blocked_by = None
            self.say("ok")

    def execute(self, line: str) -> None:
        if self.dead:
            return
        if line == "M115":
            self.say(
                "FIRMWARE_NAME:Marlin 2.1.2 (Aug  6 2022) SOURCE_CODE_URL:github.com/MarlinFirmware/Marlin"
            )
            self.say(f"Cap:EMERGENCY_PARSER:{self.emergency:d}")
        elif line in ("M400", "G28"):
            if line == "G28":
                self.moves.append(([0.0, 0.0, 0.0], 100.0))
            self.blocked_by = line
            return
        elif line == "M114":
            end = self.moves[-1][0] if self.moves else self.place
            x, y, z = end
            self.say(
                f"X:{x:.2f} Y:{y:.2f} Z:{z:.2f} E:0.00 Count X:{80 * x:.0f} Y:{80 * y:.0f} Z:{400 * z:.0f}"
            )
        elif line == "M410":
            self.moves.clear()
        elif line.startswith("G1 "):
            said = words(line)
            self.moves.append(([said["X"], said["Y"], said["Z"]], said["F"] / 60.0))
        elif line not in ("G21", "G90"):
            self.say(f'echo:Unknown command: "{line}"')
        self.say("ok")

    def hit_a_switch(self) -> None:
        self.moves.clear()
        self.dead = True
        self.say("Error:Printer halted. kill() called!")


CONTROLLERS = {
    "grbl": (SimulatedGrbl, Grbl),
    "marlin": (lambda: SimulatedMarlin(True), Marlin),
    "marlin-plain": (lambda: SimulatedMarlin(False), Marlin),
}
BOX = Workspace((-0.05, -0.05, -0.02), (0.05, 0.05, 0.02), 0.1)


@pytest.fixture(params=["grbl", "marlin"])
def kind(request: pytest.FixtureRequest) -> str:
    """Which firmware."""
    return request.param


@pytest.fixture
def controller(kind: str) -> Iterator[Controller]:
    """A controller that is switched on."""
    make, _ = CONTROLLERS[kind]
    controller = make()
    controller.start()
    yield controller
    controller.shut()


@pytest.fixture
def unconnected(kind: str, controller: Controller) -> Iterator[GcodeStage]:
    """A stage with its port open."""
    stage = GcodeStage(open_serial(controller.path, 115200), CONTROLLERS[kind][1](), BOX)
    yield stage
    stage.close()


@pytest.fixture
def stage(unconnected: GcodeStage) -> GcodeStage:
    """A stage that is connected."""
    unconnected.connect()
    return unconnected
