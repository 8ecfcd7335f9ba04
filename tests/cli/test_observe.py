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
    assert np.all(told["x_sigma_mm"] <= 0.2) and np.all(told["x_sigma_mm"] <= told["blind_x_sigma_mm"])
    # The cavities are alike: what is told of one corner is told of the others.
    corners = told["force_sigma_N"][[0, 2, 6, 8]]
    np.testing.assert_allclose(corners, corners[0], rtol=1e-3)


def test_the_report_is_whole(folder: Path) -> None:
    text = (folder / "report.html").read_text()
    assert text.startswith("<!doctype html>") and text.rstrip().endswith("</html>")
    assert text.count("data:image/png;base64,") == 3 and "By the cavities alone" in text


def test_a_device_pressed_at_electrodes_is_told(
    code_of: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    finger = Path(__file__).parents[2] / "configs" / "finger.toml"
    assert code_of("observe", finger, "--out", tmp_path / "o") == 2
    assert 'contact.model: a workspace is that of discs, not of a "patch"' in capsys.readouterr().err
