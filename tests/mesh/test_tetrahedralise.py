"""Bodies filled by fTetWild: cavities stay empty, inserts get their region, nothing is left lying about."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from softfuse.errors import MeshError
from softfuse.mesh.orientation import check
from softfuse.mesh.quality import mean_ratios
from softfuse.mesh.shell import Shell, checked
from softfuse.mesh.surface import cavities, centroid, enclosed_volume
from softfuse.mesh.tetmesh import edge_lengths, volumes
from softfuse.mesh.tetrahedralise import insert_regions, tetrahedralise

BLOCK = trimesh.creation.box((0.04, 0.03, 0.02))


def shell(*parts: trimesh.Trimesh) -> Shell:
    starts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    faces = [part.faces + start for part, start in zip(parts, starts, strict=True)]
    return checked(np.vstack([part.vertices for part in parts]), np.vstack(faces))


@pytest.mark.parametrize(
    "hole", [trimesh.creation.box((0.012, 0.01, 0.008)), trimesh.creation.icosphere(3, 0.006)]
)
def test_a_cavity_stays_empty(hole: trimesh.Trimesh, tmp_path: Path, monkeypatch, capfd) -> None:
    monkeypatch.chdir(tmp_path)
    hole = hole.copy().apply_translation((0.005, -0.002, 0.001))
    mesh = tetrahedralise(shell(BLOCK, hole), 0.006)
    check(mesh)
    assert volumes(mesh).sum() == pytest.approx(BLOCK.volume - hole.volume, rel=2e-3)
    (wall,) = cavities(mesh, np.array([[0.005, -0.002, 0.001]]))
    assert enclosed_volume(mesh.nodes, wall.faces) == pytest.approx(hole.volume, rel=1e-2)
    np.testing.assert_allclose(centroid(mesh.nodes, wall.faces), hole.center_mass, atol=1e-4)
    assert mean_ratios(mesh).min() > 0.1
    assert list(tmp_path.iterdir()) == [] and capfd.readouterr() == ("", "")


def test_a_shorter_edge_length_makes_a_finer_mesh() -> None:
    coarse, fine = tetrahedralise(shell(BLOCK), 0.008), tetrahedralise(shell(BLOCK), 0.0025)
    assert len(fine.tets) > 3 * len(coarse.tets)
    assert edge_lengths(coarse).mean() < 0.008 and 0.0015 < edge_lengths(fine).mean() < 0.003


def test_inserts_get_their_own_region_with_faces_on_their_outline() -> None:
    rod = trimesh.creation.box((0.006, 0.02, 0.01)).apply_translation((0.01, 0, 0))
    plate = trimesh.creation.box((0.01, 0.02, 0.004)).apply_translation((-0.01, 0, 0))
    mesh = tetrahedralise(shell(BLOCK), 0.006, inserts=[shell(rod), shell(plate)])
    size = np.bincount(mesh.region, weights=volumes(mesh))
    expected = [BLOCK.volume - rod.volume - plate.volume, rod.volume, plate.volume]
    assert size == pytest.approx(expected, rel=1e-2)


def test_an_insert_outside_the_body_is_told() -> None:
    mesh = tetrahedralise(shell(BLOCK), 0.012)
    far = trimesh.creation.box((0.01, 0.01, 0.01)).apply_translation((1.0, 0, 0))
    with pytest.raises(MeshError, match="insert 0 around .* holds no tetrahedron"):
        insert_regions(mesh, [shell(far)])


@pytest.mark.parametrize("length", [0.0, 1e-6, 5.0])
def test_an_edge_length_in_the_wrong_unit_is_told(length: float) -> None:
    with pytest.raises(MeshError, match="does not suit a body of 53.85 mm"):
        tetrahedralise(shell(BLOCK), length)


def test_a_surface_that_crosses_itself_is_told() -> None:
    other = trimesh.creation.box((0.04, 0.03, 0.02)).apply_translation((0.02, 0.015, 0.01))
    crossing = shell(BLOCK)
    outer = shell(other)
    joined = Shell(
        np.vstack([crossing.nodes, outer.nodes]),
        np.vstack([crossing.faces, outer.faces + len(crossing.nodes)]),
    )
    with pytest.raises(MeshError, match="may cross itself|closed parts"):
        tetrahedralise(joined, 0.01)
