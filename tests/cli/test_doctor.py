"""softfuse doctor: what is there, what is missing, and which ports answer."""

import contextlib
import json
import os
import threading
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import jax
import numpy as np
import pytest

from softfuse.cli.doctor import findings_table
from softfuse.hardware.doctor import findings, sources
from softfuse.hardware.doctor.findings import (
    Finding,
    check_cache,
    check_devices,
    check_requirements,
    check_solvers,
)
from softfuse.hardware.source.listening import Heard
from softfuse.hardware.source.port import SerialPort
from softfuse.hardware.wire.description import Channel, Description, Layout, RawType
from softfuse.hardware.wire.message import (
    DescriptionMessage,
    Header,
    SampleMessage,
    TextMessage,
    encode,
    pack,
)
from softfuse.mechanics.multifrontal import Multifrontal
from softfuse.robot.source import SoftfuseSource

ROOT = Path(__file__).parents[2]
PAD = (ROOT / "configs" / "pad.toml").read_text()
EVIL = "\x1b]0;owned\x07"


class Board(threading.Thread):
    """Sends samples of the pad's channels at 100 Hz to a pseudo-terminal; `leave_out`: every so many."""

    def __init__(self, names: list[str], *, leave_out: int = 0, garbage: bool = False) -> None:
        super().__init__(daemon=True)
        self._host, self._device = os.openpty()
        tty.setraw(self._device)
        os.set_blocking(self._host, False)
        self.port = os.ttyname(self._device)
        self._leave_out, self._garbage = leave_out, garbage
        channels = tuple(Channel(name, RawType.F32, 1.0, 0.0) for name in names)
        self._description = Description("board", channels)
        self._ended = threading.Event()

    def run(self) -> None:
        layout = Layout(self._description)
        began, k = time.monotonic(), 0
        content = layout.content(np.ones(len(self._description.channels)))
        while not self._ended.wait(max(0.0, began + 0.01 * k - time.monotonic())):
            data = b""
            if k % 20 == 0:
                data = pack(encode(DescriptionMessage(Header(0, k, 10_000 * k), self._description)))
            if not self._leave_out or k % self._leave_out:
                data += pack(encode(SampleMessage(Header(0, k, 10_000 * k), layout.number, content)))
            if k % 20 == 10:
                data += pack(encode(TextMessage(Header(0, k, 10_000 * k), EVIL)))
            with contextlib.suppress(BlockingIOError):
                os.write(self._host, b"hello\r\n" if self._garbage else data)
            k += 1

    def close(self) -> None:
        self._ended.set()
        self.join()
        os.close(self._device)
        os.close(self._host)


CHANNELS = [f"flow{k}_V" for k in range(4)] + [f"{way}{k}" for way in ("row", "col") for k in range(8)]


@pytest.fixture
def board_of() -> Iterator[Callable[..., Board]]:
    boards: list[Board] = []

    def make(names: list[str], **faults) -> Board:
        boards.append(Board(names, **faults))
        boards[-1].start()
        return boards[-1]

    yield make
    for board in boards:
        board.close()


@pytest.fixture
def sound(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine on which all but the ports has been looked at, for the tests of ports."""
    monkeypatch.setattr("softfuse.cli.doctor.check_installed", lambda: [])
    monkeypatch.setattr("softfuse.cli.doctor.check_solvers", lambda: [])
    monkeypatch.setattr("softfuse.cli.doctor.serial_ports", lambda: [])


def states(findings) -> dict[str, str]:
    return {finding.about: finding.state for finding in findings}


def test_this_machine_is_well_and_says_so_to_machines(
    code_of: Callable[..., int], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def opened(*_: object) -> None:
        raise AssertionError("a port was opened")

    monkeypatch.setattr("softfuse.hardware.source.configured.open_serial", opened)
    assert code_of("doctor", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    about = {finding["about"]: finding for finding in told["findings"]}
    assert told["well"] is True and {"python", "jax", "cache", "jax on cpu:0", "viewer"} <= set(about)
    assert about["solver"]["measured"]["error"] < 1e-9 and about["numpy"]["said"] == np.__version__


def test_requirements_are_held_against_what_is_there() -> None:
    versions = {"numpy": "1.26", "jax": "0.10.2", "rerun-sdk": None, "daqp": "0.1"}
    wanted = [
        "numpy>=2.4",
        "jax>=0.10",
        "cobs>=1.2.2",
        "pywin32; sys_platform == 'nowhere'",
        "rerun-sdk>=0.41; extra == 'viz'",
        "daqp>=0.11; extra == 'dev'",
    ]
    findings = {f.about: f for f in check_requirements(wanted, versions.get)}
    assert {about: f.state for about, f in findings.items()} == {
        "numpy": "problem",
        "jax": "ok",
        "cobs": "problem",
        "rerun-sdk [viz]": "note",
        "daqp [dev]": "problem",
    }
    assert findings["numpy"].remedy == "install it with pip install 'numpy>=2.4'"
    assert findings["rerun-sdk [viz]"].remedy == "pip install 'softfuse[viz]'"


def test_single_precision_and_wrong_solvers_are_problems(monkeypatch: pytest.MonkeyPatch) -> None:
    with jax.enable_x64(False):
        assert [f.state for f in check_devices()][0] == "problem"
    solve = Multifrontal.solve
    monkeypatch.setattr(Multifrontal, "solve", lambda self, factor, rhs: solve(self, factor, rhs) * 1.001)
    found = check_solvers()
    assert states(found) == {"solver": "problem", "solver CHOLMOD": "ok", "solver KLU": "ok"}
    assert "off by 0.001" in found[0].said and found[0].remedy


def test_a_cache_that_cannot_be_written_is_a_problem(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    jax.config.update("jax_compilation_cache_dir", str(tmp_path / "file" / "jax"))
    assert check_cache().state == "problem"
    jax.config.update("jax_compilation_cache_dir", str(tmp_path / "jax"))
    assert check_cache().state == "ok" and not list((tmp_path / "jax").iterdir())


def test_a_viewer_that_is_broken_is_a_problem_and_none_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(error: Exception) -> Callable[[str], None]:
        def load(name: str) -> None:
            raise error

        return load

    for error, state in ((ModuleNotFoundError("rerun"), "note"), (ImportError("no libGL"), "problem")):
        monkeypatch.setattr(findings.importlib, "import_module", fail(error))
        assert findings.check_viewer().state == state
    monkeypatch.setattr(findings.importlib.metadata, "distribution", _absent)
    assert findings.check_installed()[-1].state == "problem"


def _absent(name: str):
    raise findings.importlib.metadata.PackageNotFoundError(name)


def test_the_board_of_a_configuration_is_listened_to(
    code_of, board_of, sound, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    board = board_of(CHANNELS)
    config = tmp_path / "pad.toml"
    config.write_text(f'{PAD}\n[[source]]\ndriver = "softfuse"\nurl = "{board.port}"\n')
    assert code_of("doctor", config, "--json", "--for", "1") == 0
    out = capsys.readouterr().out
    (heard,) = [
        f["measured"] for f in json.loads(out)["findings"] if f["about"] == board.port and "measured" in f
    ]
    assert heard["channels"] == CHANNELS and heard["lost"] == 0 and heard["driver"] == "softfuse"
    assert heard["rate_Hz"] == pytest.approx(100.0, rel=0.02) and heard["samples"] > 50
    assert "all 20 of the configuration come" in out and "\x1b" not in out
    assert code_of("doctor", config, "--for", "0.5") == 0
    out = capsys.readouterr().out
    assert "\x1b" not in out and "\x07" not in out and "\\x1b]0;owned" in out.replace("\n", "")


def test_what_a_port_lacks_and_loses_is_told_with_a_remedy(
    code_of,
    board_of,
    sound,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("softfuse.hardware.doctor.sources.START_S", 1.0)
    config = tmp_path / "pad.toml"
    config.write_text(PAD)
    lossy = board_of(CHANNELS[:-1], leave_out=7)
    talker = board_of(["x"], garbage=True)
    gone = tmp_path / "no-such-port"
    ports = ["--port", lossy.port, "--port", talker.port, "--port", gone]
    assert code_of("doctor", config, *ports, "--json", "--for", "0.5") == 2
    told = json.loads(capsys.readouterr().out)
    found = [f for f in told["findings"] if f["state"] == "problem"]
    problems = {f["about"]: f for f in found}
    assert set(problems) == {lossy.port, talker.port, str(gone), "channels"} and len(found) == 4
    assert told["well"] is False
    assert "samples are lost" in problems[lossy.port]["said"]
    assert "no sample of the driver" in problems[talker.port]["said"]
    assert problems[str(gone)]["said"] == "there is no such port"
    assert problems["channels"]["measured"] == {"missing": ["col7"]}
    assert all(problem["remedy"] for problem in problems.values())


def test_a_silent_port_and_a_wrong_configuration_are_told(
    code_of, sound, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("softfuse.hardware.doctor.sources.START_S", 0.3)
    port = SerialPort("/dev/ttyX", f"thing {EVIL}", False)
    monkeypatch.setattr("softfuse.cli.doctor.serial_ports", lambda: [port])
    config = tmp_path / "pad.toml"
    config.write_text(PAD.replace('max_force = "25 N"', 'max_force = "25 mm"'))
    host, device = os.openpty()
    try:
        assert code_of("doctor", config, "--port", os.ttyname(device), "--for", "0.2") == 2
    finally:
        os.close(host)
        os.close(device)
    out = " ".join(capsys.readouterr().out.split())
    assert "nothing has come for 0.3 s" in out and "contact[0].max_force" in out
    assert "this user may not open it" in out and "\x1b" not in out


@pytest.mark.parametrize(
    ("ports", "told"),
    [
        (("udp://1.2.3.4",), "only the driver"),
        (("",), "give a port"),
        (("/dev/ttyX", "/dev/ttyX"), "given twice"),
    ],
)
def test_a_port_that_can_be_none_is_told_in_a_line(
    code_of, sound, capsys: pytest.CaptureFixture[str], ports: tuple[str, ...], told: str
) -> None:
    assert code_of("doctor", *(word for port in ports for word in ("--port", port))) == 2
    err = capsys.readouterr().err
    assert err.startswith("error: --port") and told in err and err.count("\n") == 1


@pytest.mark.parametrize(("stall", "told"), [(0.0, "FTDI"), (0.3, "end other programs")])
def test_the_lateness_of_samples_is_blamed_on_who_causes_it(stall: float, told: str) -> None:
    source = SoftfuseSource(driver="softfuse", url="/dev/ttyX", baud=115200)
    late = Heard(0, ("a_V",), (), 100, 100.0, None, (3e5, 3.5e5), 0.2)
    (note,) = sources._problems(source, late, stall)
    assert note.state == "note" and told in note.remedy


def test_no_finding_can_command_a_terminal() -> None:
    from rich.console import Console

    console = Console(width=200, force_terminal=False)
    with console.capture() as captured:
        console.print(findings_table([Finding(EVIL, "ok", f"[red]{EVIL}\nx", EVIL)]))
    text = captured.get()
    assert "\x1b" not in text and "\x07" not in text and "[red]" in text and text.count("\n") == 1
