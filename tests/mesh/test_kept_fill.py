"""The same surface and settings give the same mesh, in this process and in others."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import platformdirs
import pytest
import trimesh

from softfuse.mesh.kept_fill import kept_fill
from softfuse.mesh.shell import Shell, checked
from softfuse.mesh.tetmesh import edge_lengths
from softfuse.mesh.tetrahedralise import tetrahedralise

ONE = (np.zeros((4, 3)), np.zeros((1, 4), int))
OTHER = (np.ones((4, 3)), np.zeros((1, 4), int))


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("XDG_CACHE_HOME", "HOME", "LOCALAPPDATA"):
        monkeypatch.setenv(name, str(tmp_path))
    return platformdirs.user_cache_path("softfuse") / "fills"


def test_the_first_fill_of_the_same_input_is_kept(folder: Path) -> None:
    nodes = np.random.default_rng(0).random((5, 3))
    kept_fill(lambda: ONE, nodes, 0.1)
    np.testing.assert_array_equal(kept_fill(lambda: OTHER, nodes, 0.1)[0], ONE[0])
    np.testing.assert_array_equal(kept_fill(lambda: OTHER, nodes + 1e-16, 0.1)[0], OTHER[0])
    np.testing.assert_array_equal(kept_fill(lambda: OTHER, nodes, 0.2)[0], OTHER[0])
    assert len(list(folder.iterdir())) == 3


def test_who_was_faster_is_followed(folder: Path) -> None:
    def slow() -> tuple[np.ndarray, np.ndarray]:
        kept_fill(lambda: OTHER, 1.0)  # as another process would meanwhile
        return ONE

    np.testing.assert_array_equal(kept_fill(slow, 1.0)[0], OTHER[0])


def test_a_broken_file_is_made_anew_and_a_folder_is_done_without(folder: Path, monkeypatch) -> None:
    kept_fill(lambda: ONE, 1.0)
    (file,) = folder.iterdir()
    file.write_bytes(file.read_bytes()[:100])
    np.testing.assert_array_equal(kept_fill(lambda: OTHER, 1.0)[0], OTHER[0])
    np.testing.assert_array_equal(kept_fill(lambda: ONE, 1.0)[0], OTHER[0])
    monkeypatch.setenv("XDG_CACHE_HOME", os.devnull)
    np.testing.assert_array_equal(kept_fill(lambda: ONE, 1.0)[0], ONE[0])


def block() -> Shell:
    parts = [trimesh.creation.box((0.04, 0.03, 0.02)), trimesh.creation.icosphere(2, 0.006)]
    return checked(
        np.vstack([part.vertices for part in parts]),
        np.vstack([parts[0].faces, parts[1].faces + len(parts[0].vertices)]),
    )


def test_two_processes_mesh_a_body_alike() -> None:
    program = (
        "from tests.mesh.test_kept_fill import block\n"
        "from softfuse.mesh.tetrahedralise import tetrahedralise\n"
        "import hashlib\n"
        "mesh = tetrahedralise(block(), 0.01)\n"
        "print(hashlib.sha256(mesh.nodes.tobytes() + mesh.tets.tobytes()).hexdigest())\n"
    )
    root = Path(__file__).parents[2]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    said = {
        subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, check=True
        ).stdout
        for _ in range(2)
    }
    assert len(said) == 1


def test_fine_facets_do_not_make_a_fine_mesh(caplog: pytest.LogCaptureFixture) -> None:
    """A tube's bore of 96 facets of 0.3 mm each, in a body meshed with edges of 8 mm."""
    counts = []
    for facets in (12, 96):
        bore = trimesh.creation.cylinder(0.005, 0.05, sections=facets)
        body = trimesh.creation.box((0.03, 0.03, 0.06))
        nodes = np.vstack([body.vertices, bore.vertices])
        mesh = tetrahedralise(checked(nodes, np.vstack([body.faces, bore.faces + 8])), 0.008)
        counts.append(len(mesh.nodes))
        assert edge_lengths(mesh).mean() > 0.35 * 0.008
    assert counts[1] < 2 * counts[0]
    assert "the edges are" not in caplog.text
