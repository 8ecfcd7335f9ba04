"""softfuse observe on a coarse pad."""

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest


@pytest.fixture(scope="module")
def folder(code_of: Callable[..., int], tmp_path_factory: pytest.TempPathFactory, coarse: Path) -> Path:
    """What it writes of three by three places."""
    out = tmp_path_factory.mktemp("observe") / "new"
    assert code_of("observe", coarse, "--out", out, "--side", "3", "--force", "4", "--quiet") == 0
    return out


def test_every_place_has_a_row(folder: Path) -> None:
    with (folder / "observability.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [(float(row["x_mm"]), float(row["y_mm"])) for row in rows] == [
        (x, y) for x in (-30.0, 0.0, 30.0) for y in (-30.0, 0.0, 30.0)
    ]
    told = {name: np.array([float(row[name]) for row in rows]) for name in rows[0] if "sigma" in name}
    assert all(np.all(each > 0) for each in told.values())
    assert np.all(told["force_sigma_N"] <= told["blind_force_sigma_N"])
    assert np.all(told["u_sigma_mm"] <= 0.2) and np.all(told["u_sigma_mm"] <= told["blind_u_sigma_mm"])
    # The cavities are alike: what is told of one corner is told of the others.
    corners = told["force_sigma_N"][[0, 2, 6, 8]]
    np.testing.assert_allclose(corners, corners[0], rtol=1e-3)


def test_the_report_is_whole(folder: Path) -> None:
    text = (folder / "report.html").read_text()
    assert text.startswith("<!doctype html>") and text.rstrip().endswith("</html>")
    assert text.count("data:image/png;base64,") == 3 and "By the readings alone" in text


def test_where_it_is_told_well_is_said(
    code_of: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str], coarse: Path
) -> None:
    assert code_of("observe", coarse, "--out", tmp_path / "o", "--side", "2") == 0
    out = capsys.readouterr().out
    assert "force known to 6 %: at 100 % of the places" in out
    assert "place known to 2 mm: at 100 % of the places" in out and "both: at 100 % of the places" in out


@pytest.mark.slow
def test_contacts_at_electrodes_are_looked_at_there(
    code_of: Callable[..., int], tmp_path: Path, linear_finger: Callable[..., Path]
) -> None:
    out = tmp_path / "o"
    assert code_of("observe", linear_finger(), "--out", out, "--force", "0.2", "--quiet") == 0
    with (out / "observability.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 12 and rows[-2]["place"] == "tip left"
    assert [float(rows[-2][f"{axis}_mm"]) for axis in "xyz"] == [108.0, 10.0, 10.0]
    # Near the clamp so little moves that a force is lost in what the model misses of the pressures.
    sigma = [float(row["force_sigma_N"]) for row in rows]
    assert [row["place"].split()[0] for row in rows[:3]] == ["base"] * 3
    assert min(sigma) > 0 and max(sigma[3:]) < 0.05 < 0.2 < min(sigma[:3])
    assert (out / "report.html").read_text().count("data:image/png;base64,") == 3


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('name = "indenter"', 'name = "thumb"', 'there is no contact "indenter"'),
        ('x = ["-30 mm", "30 mm"]', 'x = ["-30 mm", "20 V"]', "contact[0].workspace.x"),
    ],
)
def test_a_mistake_is_told(
    code_of: Callable[..., int],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    coarse: Path,
    old: str,
    new: str,
    told: str,
) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(coarse.read_text().replace(old, new))
    assert code_of("observe", path, "--out", tmp_path / "o") == 2
    assert told in capsys.readouterr().err
