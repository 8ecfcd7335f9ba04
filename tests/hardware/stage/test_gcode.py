"""A stage with grbl and with Marlin."""

import math
import os
import threading
import time

import pytest

from softfuse.errors import HardwareError
from softfuse.hardware.source.port import open_serial
from softfuse.hardware.stage import gcode
from softfuse.hardware.stage.dialect import Heard
from softfuse.hardware.stage.gcode import GcodeStage, Workspace
from softfuse.hardware.stage.grbl import ALARMS, Grbl

SETUP = {"grbl": ["G21", "G90", "G94"], "marlin": ["G21", "G90"]}


def place_of(controller) -> tuple[float, ...]:
    """Where the simulated stage really is, in the coordinates of moves [m]."""
    offset = getattr(controller, "offset", [0.0, 0.0, 0.0])
    return tuple(1e-3 * (a - b) for a, b in zip(controller.place, offset, strict=True))


def moves(controller) -> list[str]:
    return [line for line in controller.heard if line.startswith("G1")]


def test_a_move_is_over_when_the_stage_is_there(kind, stage, controller):
    for target in ((0.01, -0.005, 0.002), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)):
        started, begin = time.monotonic(), place_of(controller)
        there = stage.move_to(*target, speed=0.05)
        assert time.monotonic() - started >= math.dist(begin, target) / 0.05 - 0.01
        assert place_of(controller) == pytest.approx(target, abs=1e-9)
        assert there == pytest.approx(target, abs=1e-5)
    assert stage.position() == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    setup = SETUP[kind]
    said = [line for line in controller.heard if line not in ("M115", "M114")]
    settle = "G4 P0" if kind == "grbl" else "M400"
    assert said[: len(setup) + 2] == [*setup, "G1 X10.0000 Y-5.0000 Z2.0000 F3000.000", settle]
    # The setup is sent once.
    assert said.count("G21") == 1


def test_a_firmware_that_goes_slower_than_it_was_told_is_waited_for(stage, controller):
    controller.fastest = 10.0
    stage.move_to(0.005, 0.0, 0.0, speed=0.1)
    assert place_of(controller) == pytest.approx((0.005, 0.0, 0.0), abs=1e-9)


BEYOND = [
    ((0.051, 0.0, 0.0), 0.01, "x = 51 mm: x lies between -50 mm and 50 mm"),
    ((0.0, -0.06, 0.0), 0.01, "y = -60 mm"),
    ((0.0, 0.0, math.nan), 0.01, "z = nan mm"),
    ((0.0, 0.0, 0.0), 0.11, "110 mm/s: up to 100 mm/s"),
    ((0.0, 0.0, 0.0), 0.0, "0 mm/s"),
    ((0.0, 0.0, 0.0), math.nan, "nan mm/s"),
]


@pytest.mark.parametrize("kind", ["grbl"], indirect=True)
def test_nothing_moves_beyond_the_workspace(stage, controller):
    before = list(controller.heard)
    for target, speed, told in BEYOND:
        with pytest.raises(HardwareError, match=told):
            stage.move_to(*target, speed=speed)
    assert controller.heard == before


@pytest.mark.parametrize("kind", ["grbl"], indirect=True)
def test_a_stage_moves_along_the_edge_at_which_it_stands(stage, controller):
    """Though it stands beside it by a step of its motors."""
    stage.move_to(-0.05, 0.0, 0.0, speed=0.1)
    x, y, _ = stage.position()
    stage.move_to(x - 10e-6, y, 0.01, speed=0.1)
    assert place_of(controller)[2] == pytest.approx(0.01, abs=1e-9)


def stopped(stage, controller, *, after: float, target=(0.04, 0.0, 0.0), speed=0.02) -> tuple[float, str]:
    """Stop a move; how late the controller heard of it [s], and what the mover was told."""
    told = []

    def mover() -> None:
        try:
            stage.move_to(*target, speed=speed)
        except HardwareError as error:
            told.append(str(error))

    thread = threading.Thread(target=mover)
    thread.start()
    for _ in range(1000):
        if moves(controller):
            break
        time.sleep(0.01)
    time.sleep(after)
    halts = len(controller.halts)
    called = time.monotonic()
    stage.stop()
    thread.join(20.0)
    assert not thread.is_alive()
    return controller.halts[halts] - called, told[0]


@pytest.mark.parametrize("kind", ["grbl", "marlin", "marlin-plain"], indirect=True)
def test_a_move_is_stopped_at_once_from_another_thread_and_the_place_stays_known(stage, controller):
    late, told = stopped(stage, controller, after=0.3)
    where = place_of(controller)
    assert late < 0.2
    assert 0.003 < where[0] < 0.03 and where[1:] == pytest.approx((0.0, 0.0), abs=1e-9)
    assert told.startswith("the stage was stopped at (")
    assert float(told.split("(")[1].split(",")[0]) == pytest.approx(1e3 * where[0], abs=0.02)
    # It stands, and takes the next move from there.
    assert place_of(controller) == where
    stage.move_to(0.0, 0.0, 0.0, speed=0.1)
    assert place_of(controller) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def test_stopping_a_stage_that_stands_does_no_harm(stage, controller):
    stage.move_to(0.001, 0.0, 0.0, speed=0.1)
    stage.stop()
    stage.stop()
    stage.move_to(0.002, 0.0, 0.0, speed=0.1)
    assert place_of(controller) == pytest.approx((0.002, 0.0, 0.0), abs=1e-9)


def test_what_stops_the_stage_is_told_and_moves_are_refused_until_it_is_homed(kind, stage, controller):
    threading.Timer(0.3, lambda: controller.do(controller.hit_a_switch)).start()
    with pytest.raises(HardwareError) as caught:
        stage.move_to(0.04, 0.0, 0.0, speed=0.02)
    assert (ALARMS[1] if kind == "grbl" else "Printer halted") in str(caught.value)
    assert "home the stage" in str(caught.value)
    count = len(controller.heard)
    for _ in range(2):
        with pytest.raises(HardwareError, match="home the stage"):
            stage.move_to(0.0, 0.0, 0.0, speed=0.02)
    assert len(controller.heard) == count
    if kind != "grbl":
        controller.dead = False
    stage.home()
    assert controller.place == [0.0, 0.0, 0.0]
    target = place_of(controller)
    stage.move_to(max(target[0], -0.05), max(target[1], -0.02), 0.005, speed=0.1)
    assert place_of(controller)[2] == pytest.approx(0.005, abs=1e-9)


def test_a_stage_that_resets_behind_the_hosts_back_has_lost_its_place(stage, controller):
    threading.Timer(0.3, lambda: controller.do(controller.boot)).start()
    with pytest.raises(HardwareError, match="reset"):
        stage.move_to(0.04, 0.0, 0.0, speed=0.02)
    with pytest.raises(HardwareError, match="home"):
        stage.move_to(0.0, 0.0, 0.0, speed=0.02)


@pytest.mark.parametrize("kind", ["grbl"], indirect=True)
def test_a_stage_that_is_not_where_it_should_be_is_told(stage, controller):
    def slip() -> None:
        controller.moves.clear()

    threading.Timer(0.1, lambda: controller.do(slip)).start()
    with pytest.raises(HardwareError, match=r"stands at \(.* instead of \(10.000, 0.000, 0.000\) mm"):
        stage.move_to(0.01, 0.0, 0.0, speed=0.02)


@pytest.mark.parametrize("kind", ["marlin"], indirect=True)
def test_a_stage_that_says_nothing_any_more_is_told(stage, controller, monkeypatch):
    monkeypatch.setattr(gcode, "PATIENCE_S", 0.5)
    stage.move_to(0.001, 0.0, 0.0, speed=0.1)
    threading.Timer(0.1, controller.ended.set).start()
    with pytest.raises(HardwareError, match=r"does not answer .* is it held, or off\?"):
        stage.move_to(0.011, 0.0, 0.0, speed=0.05)


@pytest.mark.parametrize("kind", ["marlin"], indirect=True)
def test_a_port_that_goes_away_is_told(stage, controller):
    def unplug() -> None:
        os.close(controller.slave)
        os.close(controller.master)
        controller.slave, controller.master = os.pipe()

    threading.Timer(0.2, lambda: controller.do(unplug)).start()
    with pytest.raises(HardwareError, match="port"):
        stage.move_to(0.04, 0.0, 0.0, speed=0.02)


def test_homing_can_be_stopped_and_then_has_to_be_done(stage, controller):
    controller.place = [40.0, 40.0, 20.0]
    threading.Timer(0.1, stage.stop).start()
    with pytest.raises(HardwareError, match="home it|homing was interrupted"):
        stage.home()
    assert controller.place != [0.0, 0.0, 0.0]
    with pytest.raises(HardwareError, match="home it|home the stage"):
        stage.move_to(0.0, 0.0, 0.0, speed=0.1)
    stage.home()
    assert controller.place == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("kind", ["marlin"], indirect=True)
def test_nobody_who_answers_is_told(monkeypatch, unconnected, controller):
    monkeypatch.setattr(gcode, "GREETING_S", 0.5)
    controller.ended.set()
    controller.join()
    with pytest.raises(HardwareError, match="answers for 0.5 s: check the port"):
        unconnected.connect()


@pytest.mark.parametrize("kind", ["grbl"], indirect=True)
def test_a_board_that_is_still_starting_is_waited_for(unconnected, controller):
    take, starts = controller.take, time.monotonic() + 0.7

    def deaf(data: bytes) -> bytes:
        return take(data) if time.monotonic() > starts else b""

    controller.take = deaf
    unconnected.connect()
    unconnected.move_to(0.001, 0.0, 0.0, speed=0.1)


@pytest.mark.parametrize("kind", ["grbl"], indirect=True)
def test_locked_and_limited_grbls_say_what_to_do(stage, controller):
    controller.do(lambda: controller.boot(locked=True))
    stage.connect()
    controller.state = "Alarm"
    with pytest.raises(HardwareError, match="moves are locked .* home the stage"):
        stage.move_to(0.0, 0.0, 0.0, speed=0.1)
    controller.homing = False
    with pytest.raises(HardwareError, match="homing is not enabled"):
        stage.home()
    controller.homing = True
    stage.home()
    controller.travel = 30.0
    with pytest.raises(HardwareError, match="beyond the machine's travel"):
        stage.move_to(0.04, 0.0, 0.0, speed=0.1)


@pytest.mark.parametrize("kind", ["grbl"], indirect=True)
def test_a_grbl_that_somebody_holds_is_told(stage, controller, monkeypatch):
    monkeypatch.setattr(gcode, "PATIENCE_S", 0.5)

    def hold() -> None:
        controller.state, controller.ramp = "Hold:1", 0.05

    threading.Timer(0.1, lambda: controller.do(hold)).start()
    with pytest.raises(HardwareError, match="says 'Hold:0': is it held"):
        stage.move_to(0.015, 0.0, 0.0, speed=0.05)


@pytest.mark.parametrize(
    ("line", "place", "state"),
    [
        ("<Idle|MPos:11.000,22.000,-5.000|FS:0,0>", (1.0, 2.0, 0.0), "Idle"),
        ("<Run|WPos:1.000,2.000,3.000|Bf:15,128>", (1.0, 2.0, 3.0), "Run"),
        ("<Hold:1|MPos:10,20,-5,0|Pn:XYZ|Ov:100,100,100>", (0.0, 0.0, 0.0), "Hold:1"),
        ("<Idle|MPos:1,2>", None, "Idle"),
        ("<Idle|MPos:x,y,z>", None, "Idle"),
    ],
)
def test_reports_of_grbl_are_read(line, place, state):
    dialect = Grbl()
    assert dialect.heard("<Idle|MPos:11.000,22.000,-5.000|FS:0,0>") == Heard(state="Idle")
    dialect.heard("<Idle|MPos:0.000,0.000,0.000|FS:0,0|WCO:10.000,20.000,-5.000>")
    heard = dialect.heard(line)
    assert heard.state == state
    assert heard.place == (None if place is None else pytest.approx(place))


@pytest.mark.parametrize("line", ["<Idle", "ALARM:x", "error:", "error:²", "", "Grbl", "<|>", "ALARM:-1"])
def test_other_lines_are_no_reports_and_no_trouble(line):
    assert Grbl().heard(line) == Heard()
    assert Grbl().heard("ok") == Heard(answer=True)


@pytest.mark.parametrize(
    ("lowest", "highest", "fastest"),
    [
        ((0, 0, 0), (1, -1, 1), 0.1),
        ((0, math.nan, 0), (1, 1, 1), 0.1),
        ((0, 0, 0), (1, 1, math.inf), 0.1),
        ((0, 0, 0), (1, 1, 1), 0.0),
    ],
)
def test_workspaces_that_cannot_be_are_told(lowest, highest, fastest):
    with pytest.raises(HardwareError, match="cannot"):
        Workspace(lowest, highest, fastest)


@pytest.mark.parametrize("kind", ["grbl"], indirect=True)
def test_a_closed_stage_is_open_for_others(stage, controller):
    stage.close()
    other = open_serial(controller.path, 115200)
    assert isinstance(GcodeStage(other, Grbl(), Workspace((0, 0, 0), (1, 1, 1), 0.1)), GcodeStage)
    other.close()
