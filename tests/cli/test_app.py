"""Errors in a line, exit codes, precision."""

import io
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import typer
from rich.console import Console
from rich.text import Text
from typer.core import TyperGroup
from typer.main import get_command

from softfuse.cli import app as application
from softfuse.cli import main, progress
from softfuse.cli.progress import steps, tracked
from softfuse.errors import ConfigError

PAD = Path(__file__).parents[2] / "configs" / "pad.toml"


@pytest.fixture
def failing(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """An application whose command `fail` raises what FAILURE names."""
    app = typer.Typer()

    @app.callback()
    def _prepare() -> None: ...

    @app.command()
    def fail(kind: str) -> None:
        if kind == "interrupt":
            raise KeyboardInterrupt
        if kind == "mistake":
            raise ConfigError("a.toml: body[0]: wrong [red]\na.toml: " + 30 * "long " + "end")
        raise RuntimeError(kind)

    monkeypatch.setattr(application, "app_for", lambda arguments: app)
    return monkeypatch


@pytest.mark.usefixtures("failing")
def test_a_mistake_is_a_line_each_and_two(
    code_of: Callable[..., int], capsys: pytest.CaptureFixture[str]
) -> None:
    assert code_of("fail", "mistake") == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err == "error: a.toml: body[0]: wrong [red]\nerror: a.toml: " + 30 * "long " + "end\n"


@pytest.mark.usefixtures("failing")
def test_an_interrupt_is_130(code_of: Callable[..., int]) -> None:
    assert code_of("fail", "interrupt") == 130


@pytest.mark.usefixtures("failing")
def test_a_fault_of_ours_is_not_hidden() -> None:
    with pytest.raises(RuntimeError, match="broken"):
        main(["fail", "broken"])


@pytest.mark.parametrize("arguments", [["nonsense"], ["mesh"], ["mesh", "pad.toml", "--nonsense"]])
def test_wrong_usage_is_two(
    code_of: Callable[..., int], arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert code_of(*arguments) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_help_and_version(code_of: Callable[..., int], capsys: pytest.CaptureFixture[str]) -> None:
    assert code_of("--help") == 0
    assert "mesh" in capsys.readouterr().out
    assert code_of("--version") == 0
    assert re.fullmatch(r"softfuse \d+\.\d+\.\d+\n", capsys.readouterr().out)


def test_a_command_imports_what_it_needs_itself() -> None:
    """What all of them need takes seconds."""
    code = "import sys; from softfuse.cli.app import app_for; app_for(['mesh']); print(*sys.modules)"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert "softfuse.cli.mesh" in found.split() and "softfuse.cli.simulate" not in found.split()


def test_no_help_loses_what_is_in_brackets() -> None:
    command = get_command(application.app_for([]))
    assert isinstance(command, TyperGroup)
    helps = [getattr(option, "help", None) for one in command.commands.values() for option in one.params]
    helps += [one.help for one in (command, *command.commands.values())]
    assert len(helps) > 50
    for text in helps:
        assert isinstance(text, str) and Text.from_markup(text).spans == [], f"escape the brackets of {text}"


def test_progress_yields_everything_and_says_nothing_without_a_terminal(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert list(tracked(range(3), "counting", total=3, quiet=False)) == [0, 1, 2]
    with steps(quiet=False) as begin:
        for done in (begin("meshing"), begin("pressing", 2), begin("writing")):
            done()
    assert capsys.readouterr() == ("", "")


def test_one_step_is_shown_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    console = Console(file=io.StringIO(), force_terminal=True, width=80)
    monkeypatch.setattr(progress, "stderr", console)
    with steps(quiet=False) as begin:
        begin("meshing")()
        begin("pressing", 2)()
    said = console.file.getvalue()
    assert 0 < said.rindex("meshing") < said.index("pressing")


def run_python(code: str, **environment: str) -> str:
    """What a fresh interpreter prints."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith("JAX_")}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env={**kept, **environment}
    )
    return done.stdout.strip()


SHOW = """
from softfuse.computing.prepare import prepare_jax
prepare_jax()
import jax
print(jax.config.jax_enable_x64, jax.config.jax_compilation_cache_dir)
"""


def test_commands_factorise_on_one_thread_unless_told_otherwise() -> None:
    show = "import os, softfuse.cli; print(os.environ['OPENBLAS_NUM_THREADS'])"
    assert run_python(show, OPENBLAS_NUM_THREADS="3") == "3"
    assert run_python(f"import os; os.environ.pop('OPENBLAS_NUM_THREADS', None); {show}") == "1"


def test_commands_compute_in_double_precision_and_keep_programs(tmp_path: Path) -> None:
    kept = run_python(SHOW, XDG_CACHE_HOME=str(tmp_path), HOME=str(tmp_path), LOCALAPPDATA=str(tmp_path))
    precise, folder = kept.split(maxsplit=1)
    assert precise == "True"
    assert Path(folder).is_relative_to(tmp_path) and Path(folder).is_dir()


def test_a_folder_that_is_given_is_used(tmp_path: Path) -> None:
    assert run_python(SHOW, JAX_COMPILATION_CACHE_DIR=str(tmp_path)) == f"True {tmp_path}"


def test_without_a_cache_folder_nothing_is_kept(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.touch()
    kept = run_python(SHOW, XDG_CACHE_HOME=str(blocked), HOME=str(blocked), LOCALAPPDATA=str(blocked))
    assert kept == "True None"


@pytest.mark.parametrize(
    "command",
    [
        ["mesh", "{pad}", "--out", "{out}.vtu"],
        ["simulate", "{pad}", "--at", "0,0", "--force", "1", "--json", "{out}"],
        ["simulate", "{pad}", "--at", "0,0", "--force", "1", "--vtu", "{out}.vtu"],
        ["calibrate", "{pad}", "{pad}", "--out", "{out}.toml"],
        ["run", "{pad}", "--record", "{out}.mcap"],
        ["run", "{pad}", "--save-view", "{out}.rrd"],
        ["virtual-device", "{pad}", "--truth", "{out}.csv"],
        ["estimate", "{pad}", "{pad}", "--out", "{file}/o"],
        ["observe", "{pad}", "--out", "{file}/o"],
        ["reduce", "{pad}", "--out", "{file}/o"],
        ["evaluate", "{pad}", "--out", "{file}/o"],
        ["sweep", "{pad}", "{pad}", "--out", "{file}/o"],
        ["design", "{pad}", "--out", "{file}/o"],
    ],
)
def test_what_cannot_be_written_is_told_before_any_work(
    code_of: Callable[..., int],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    command: list[str],
) -> None:
    def begun(*_: object) -> None:
        raise AssertionError("the command has begun")

    monkeypatch.setattr("softfuse.robot.file.parse", begun)
    (tmp_path / "file").write_text("")
    places = {"pad": PAD, "out": tmp_path / "no" / "x", "file": tmp_path / "file"}
    assert code_of(*(part.format(**places) for part in command)) == 2
    told = capsys.readouterr().err
    assert "cannot be written: " in told and told.count("\n") == 1
    assert sorted(tmp_path.iterdir()) == [tmp_path / "file"]


def test_a_disk_that_takes_no_more_is_told_in_one_line(
    code_of: Callable[..., int], bar: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert code_of("simulate", bar, "--cable", "1 mm", "--json", "/dev/full") == 2
    told = capsys.readouterr().err
    assert "cannot write to /dev/full: No space left on device" in told and told.count("\n") == 1
