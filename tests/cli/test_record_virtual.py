"""softfuse record-virtual: a recording of a robot that is made up here, with the truth."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from made_robots import BLOCK

from softfuse.cli import record_virtual as command
from softfuse.experiment import equilibria, performance
from softfuse.experiment.episodes import Episode
from softfuse.experiment.virtual_robot import MakingErrors, VirtualRobot, virtual_robot
from softfuse.hardware.recording import read_recording
from softfuse.robot.settings import RobotSettings


class MadeUpSolver:
    """Gives way in proportion."""

    def __init__(self, robot: VirtualRobot) -> None:
        self._made = robot.made

    def reach(self) -> tuple[tuple[str, float], ...]:
        return ()

    def count(self, episode: Episode) -> int:
        return len(episode.touches[0].forces)

    def poses(self, episode: Episode, *, solved: Callable[[], None] | None = None) -> dict[str, np.ndarray]:
        (touch,) = episode.touches
        for _ in touch.forces:
            if solved is not None:
                solved()
        force = np.array([0.0, 0.0, *touch.forces])
        at = np.broadcast_to(np.array(touch.place)[0, :2], (len(force), 2))
        return {
            "reading": np.outer(force, [-1e-8, 0.0]),
            "force": force[:, None],
            "gap": np.array([60e-3, 0.0, *(-1e-4 * np.array(touch.forces))])[:, None],
            "point": np.zeros((len(force), 1, 3)),
            "drive": np.zeros((len(force), 0)),
            "answer": np.zeros((len(force), 0)),
            "volume": np.outer(force, [-1e-8, 0.0]),
            "held": (force > 0).astype(float),
            "signal stage": np.column_stack([at, force]),
        }


def quick(settings: RobotSettings, errors: MakingErrors) -> VirtualRobot:
    """On the drawing's own mesh."""
    assert errors.nodes >= 2
    return virtual_robot(settings, MakingErrors(nodes=0, seed=errors.seed))


@pytest.fixture(autouse=True)
def made_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command, "virtual_robot", quick)
    for module in (command, performance, equilibria):
        monkeypatch.setattr(module, "RobotSolver", MadeUpSolver)


def test_a_recording_holds_so_many_presses(code_of: Callable[..., int], tmp_path: Path) -> None:
    config = tmp_path / "block.toml"
    config.write_text(BLOCK, encoding="utf-8")
    read = {}
    for name, options in {"a": [], "same": [], "noise": ["--seed", "2"], "body": ["--body", "2"]}.items():
        path = tmp_path / f"{name}.csv.gz"
        assert code_of("record-virtual", config, "--out", path, "--presses", "3", *options) == 0
        read[name] = read_recording(
            path, ["flow0_V", "x_mm", "force_N", "true_x_mm", "true_force_N", "sample"]
        )
    first = read["a"].columns
    assert first["sample"][first["sample"] > 0].tolist() == [1, 2, 3] * 3 and first["press"].max() == 2
    held = first["sample"] == 3
    assert (first["true_force_N"][held] >= 3.5).all() and (first["true_force_N"] <= 7.5).all()
    np.testing.assert_allclose(first["x_mm"][held], first["true_x_mm"][held], atol=0.3)
    np.testing.assert_array_equal(read["same"].columns["flow0_V"], first["flow0_V"])
    assert not np.array_equal(read["noise"].columns["true_x_mm"], first["true_x_mm"])
    rest = slice(0, 100)
    zero = {name: each.columns["flow0_V"][rest].mean() for name, each in read.items()}
    assert abs(zero["noise"] - zero["a"]) < 1.5e-3 and abs(zero["body"] - zero["a"]) > 0.2e-3


def test_a_robot_without_sensors_is_refused(
    code_of: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "block.toml"
    config.write_text(BLOCK[: BLOCK.index("[[sensor]]")], encoding="utf-8")
    assert code_of("record-virtual", config, "--out", tmp_path / "a.csv") == 2
    assert "sensor: missing" in capsys.readouterr().err
