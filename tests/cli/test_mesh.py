"""softfuse mesh."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from rich.console import Console

from softfuse.cli.mesh import quality_table
from softfuse.mesh.files import read_mesh
from softfuse.mesh.shell import checked
from softfuse.mesh.surface import cavities
from softfuse.mesh.tetrahedralise import tetrahedralise
from softfuse.robot.file import load
from softfuse.robot.mesh import RobotMesh, build_mesh

CONFIGS = Path(__file__).parents[2] / "configs"
PAD, FINGER = CONFIGS / "pad.toml", CONFIGS / "finger.toml"


@pytest.mark.parametrize(("config", "name"), [(PAD, "pad.vtu"), (PAD, "pad.msh"), (FINGER, "finger.vtu")])
def test_the_file_holds_the_mesh_of_the_config(
    code_of: Callable[..., int], tmp_path: Path, config: Path, name: str
) -> None:
    assert code_of("mesh", config, "--out", tmp_path / name) == 0
    expected = build_mesh(load(config)).mesh
    found = read_mesh(tmp_path / name)
    np.testing.assert_array_equal(found.nodes, expected.nodes)
    np.testing.assert_array_equal(found.tets, expected.tets)


def test_the_report_tells_counts_and_quality(
    code_of: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert code_of("mesh", PAD, "--out", tmp_path / "pad.vtu") == 0
    out, err = capsys.readouterr()
    mesh = build_mesh(load(PAD)).mesh
    assert f"{len(mesh.nodes)}" in out and f"{len(mesh.tets)}" in out
    assert out.count("4704.0") == 4
    assert "volume of chamber (-,+) [mm³]" in out and "edges [mm]" in out and "mean ratio" in out
    assert err == ""


def test_volumes_are_those_within_curved_walls() -> None:
    ball, block = trimesh.creation.icosphere(3, 0.006), trimesh.creation.box((0.04, 0.03, 0.02))
    shell = checked(
        np.vstack([block.vertices, ball.vertices]),
        np.vstack([block.faces, ball.faces + len(block.vertices)]),
    )
    mesh = tetrahedralise(shell, 0.008, envelope=5e-3)
    made = RobotMesh(mesh, tuple(cavities(mesh)), np.zeros(len(mesh.nodes), bool))
    console = Console(width=120)
    with console.capture() as shown:
        console.print(quality_table("ball", ["hole"], made))

    def told(of: str) -> float:
        return float(re.search(rf"volume of {of} \[mm³\]\W*([\d.]+)", shown.get())[1])

    # Flat triangles would miss it by 3 %.
    assert told("chamber hole") == pytest.approx(1e9 * ball.volume, rel=5e-3)
    assert told("the material") == pytest.approx(1e9 * (block.volume - ball.volume), rel=5e-4)


def test_quiet_says_nothing(
    code_of: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert code_of("mesh", PAD, "--out", tmp_path / "pad.vtu", "--quiet") == 0
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("config", "out", "told"),
    [
        ("no.toml", "pad.vtu", "no.toml: cannot be read: No such file or directory"),
        (str(PAD), "pad.stl", "meshes are not written as '.stl'"),
        (str(PAD), "no/pad.vtu", "cannot be written"),
    ],
)
def test_a_mistake_is_one_line(
    code_of: Callable[..., int],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    config: str,
    out: str,
    told: str,
) -> None:
    assert code_of("mesh", config, "--out", tmp_path / out) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("error: ") and told in captured.err
    assert captured.err.count("\n") == 1
