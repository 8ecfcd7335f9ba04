"""softfuse simulate on a coarse finger."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from softfuse.cli import main
from softfuse.mesh.files import read_mesh

ROOT = Path(__file__).parents[2]
COARSE = (
    ('wall_size = "10 mm"', 'wall_size = "20 mm"'),
    ('base_size = "12 mm"', 'base_size = "30 mm"'),
    ("growth = 2.0", "growth = 9.0"),
    ('element = "taylor-hood"', 'element = "linear"'),
    ("poisson = 0.49", "poisson = 0.3"),
)


def code_of(*arguments: str | Path) -> int | str | None:
    """The exit code of `softfuse simulate`."""
    with pytest.raises(SystemExit) as caught:
        main(["simulate", *map(str, arguments)])
    return caught.value.code


@pytest.fixture(scope="module")
def coarse(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The finger's config on a coarse mesh of elements that compile in no time."""
    text = (ROOT / "configs" / "finger.toml").read_text(encoding="utf-8")
    for old, new in COARSE:
        text = text.replace(old, new)
    path = tmp_path_factory.mktemp("config") / "coarse.toml"
    path.write_text(text, encoding="utf-8")
    return path


def simulated(tmp_path: Path, coarse: Path, cable: str) -> dict[str, Any]:
    """The numbers of a push on the tip's left with a cable."""
    numbers, shape = tmp_path / "n.json", tmp_path / "s.vtu"
    given = ("--electrode", "tip left", "--force", "0.2", "--cable", cable, "--quiet")
    assert code_of(coarse, *given, "--json", numbers, "--vtu", shape) == 0
    found = json.loads(numbers.read_text())
    assert len(read_mesh(shape).nodes) == found["nodes"]
    return found


def test_a_push_and_a_pull_give_numbers_and_a_shape(tmp_path: Path, coarse: Path) -> None:
    found = simulated(tmp_path, coarse, "5 mm")
    assert found["result"] == "converged" and found["force_N"] == pytest.approx(0.2)
    assert found["electrode"] == "tip left" and len(found["pressures_Pa"]) == 6
    cable = found["cables"]["palm"]
    assert cable["shortening_mm"] == pytest.approx(5.0) and 0.5 < cable["tension_N"] < 5.0
    # Pushed from the left it goes right, and the palm's cable pulls it down.
    x, y, z = found["points_mm"]["p0"]
    assert x < 117.0 and y < -2.0 and z < 0.0
    assert found["tip_bend_deg"] > 10.0 and len(found["bend_deg"]) == 4
    # The same tension shortens the cable as much.
    again = simulated(tmp_path, coarse, f"{cable['tension_N']!r} N")
    assert again["cables"]["palm"]["shortening_mm"] == pytest.approx(5.0, rel=1e-6)
    np.testing.assert_allclose(again["points_mm"]["p0"], found["points_mm"]["p0"], atol=1e-5)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--at", "10,0", "--force", "1"), "pressed at its electrodes, not at any place"),
        (("--electrode", "thumb", "--force", "1"), 'there is no electrode "thumb"'),
        (("--force", "1"), "--force needs an --electrode"),
        (("--electrode", "tip left"), "--force is missing"),
        (("--cable", "10"), '--cable "10" is no length or force'),
        (("--cable", "-1 mm"), '--cable "-1 mm" is no length or force'),
        (("--cable", "1 mm", "--cable", "1 mm"), "--cable is given 2 times for 1 cables"),
    ],
)
def test_a_mistake_is_one_line(
    capsys: pytest.CaptureFixture[str], coarse: Path, arguments: tuple[str, ...], told: str
) -> None:
    assert code_of(coarse, *arguments) == 2
    err = capsys.readouterr().err
    assert told in err and err.count("\n") == 1


def test_a_pad_has_no_electrodes_to_be_pressed(capsys: pytest.CaptureFixture[str]) -> None:
    assert code_of(ROOT / "configs" / "pad.toml", "--electrode", "tip", "--force", "1") == 2
    assert "this device is pressed by a disc" in capsys.readouterr().err
