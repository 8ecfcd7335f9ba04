"""softfuse convert."""

from collections.abc import Callable
from pathlib import Path

import pytest

from softfuse.cli.terminal import printable

CSV = "time_s,flow0_V,row0\n0.0,0.5,20000.0\n0.01,,20010.0\n"


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "a.csv"
    path.write_text(CSV)
    return path


def test_a_recording_goes_round(
    recording: Path, tmp_path: Path, code_of: Callable[..., int], capsys: pytest.CaptureFixture[str]
) -> None:
    for source, target in (("a.csv", "b.mcap"), ("b.mcap", "c.parquet"), ("c.parquet", "d.csv")):
        assert code_of("convert", tmp_path / source, tmp_path / target) == 0
    out, err = capsys.readouterr()
    assert (tmp_path / "d.csv").read_text() == CSV
    assert out.count("2 frames written to ") == 3 and str(tmp_path / "d.csv") in out and err == ""


def test_force_overwrites_and_quiet_says_nothing(
    recording: Path, tmp_path: Path, code_of: Callable[..., int], capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / "b.csv.gz"
    target.write_text("mine")
    assert code_of("convert", recording, target) == 2
    assert "exists" in capsys.readouterr().err and target.read_text() == "mine"
    assert code_of("convert", recording, target, "--force", "--quiet") == 0
    assert target.read_bytes()[:2] == b"\x1f\x8b" and capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("a.csv", "b.txt"), "must end in .mcap"),
        (("no.csv", "b.mcap"), "cannot open the recording"),
        (("a.csv", "b.parquet", "--estimates"), "estimates are taken out of"),
    ],
)
def test_a_mistake_is_one_line(
    recording: Path,
    tmp_path: Path,
    code_of: Callable[..., int],
    capsys: pytest.CaptureFixture[str],
    arguments: tuple[str, ...],
    told: str,
) -> None:
    source, target, *options = arguments
    assert code_of("convert", tmp_path / source, tmp_path / target, *options) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("error: ") and told in err and err.count("\n") == 1


def test_what_a_file_says_cannot_command_the_terminal(
    tmp_path: Path, code_of: Callable[..., int], capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.csv"
    path.write_text("\x1b]0;title\x07\x9b31m,b\n1,2\n")
    assert code_of("convert", path, tmp_path / "b.mcap") == 2
    err = capsys.readouterr().err
    assert "lacks the column 'time_s'" in err and "\\x1b]0;title\\x07\\x9b31m" in err
    assert not any(sign in err for sign in "\x1b\x07\x9b")


def test_printable_leaves_text_and_line_ends() -> None:
    assert printable("ΔV 3 mm³ [bold]\nnext") == "ΔV 3 mm³ [bold]\nnext"
    assert printable("a\x1b[2J\r\u202eb\x00") == "a\\x1b[2J\\r\\u202eb\\x00"
