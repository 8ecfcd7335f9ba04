"""Bodies filled by fTetWild: cavities stay empty, inserts get their region, nothing is left lying about."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
import trimesh

from softfuse.errors import MeshError
from softfuse.functional.cavity import Cavity
from softfuse.mesh.conforming import conforming
from softfuse.mesh.orientation import check
from softfuse.mesh.quality import mean_ratios
from softfuse.mesh.shell import Shell, checked
from softfuse.mesh.surface import cavities, centroid, enclosed_volume, outer_surface
from softfuse.mesh.tetmesh import edge_lengths, tet_mesh, volumes
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
    # Within its curved edges: straight ones cut off as much of a sphere as the envelope has room for.
    assert float(Cavity(jnp.asarray(wall.faces))(jnp.asarray(mesh.nodes))) == pytest.approx(
        hole.volume, rel=4e-3
    )
    np.testing.assert_allclose(centroid(mesh.nodes, wall.faces), hole.center_mass, atol=1e-4)
    assert mean_ratios(mesh).min() > 0.1
    assert list(tmp_path.iterdir()) == [] and capfd.readouterr() == ("", "")


def test_a_shorter_edge_length_makes_a_finer_mesh() -> None:
    coarse, fine = tetrahedralise(shell(BLOCK), 0.008), tetrahedralise(shell(BLOCK), 0.0025)
    assert len(fine.tets) > 3 * len(coarse.tets)
    assert edge_lengths(coarse).mean() < 0.008 and 0.0015 < edge_lengths(fine).mean() < 0.003


def test_a_rough_mesh_lies_on_its_surface_all_the_same() -> None:
    radius, envelope = 0.006, 5e-3
    ball = trimesh.creation.icosphere(4, radius)
    mesh = tetrahedralise(shell(BLOCK, ball), 0.008, envelope=envelope)
    check(mesh)
    wall, skin = cavities(mesh)[0].faces, outer_surface(mesh).faces
    off = np.abs(np.linalg.norm(mesh.nodes[np.unique(wall)], axis=1) - radius)
    assert np.median(off) < 2e-3 * radius and off.max() < envelope * 0.054
    # Flat triangles cut off far more than the curved ones, which are what cavities' volumes are made of.
    flat = enclosed_volume(mesh.nodes, wall)
    curved = float(Cavity(jnp.asarray(wall))(jnp.asarray(mesh.nodes)))
    assert abs(curved / ball.volume - 1.0) < 0.1 * abs(flat / ball.volume - 1.0)
    from_planes = np.abs(np.abs(mesh.nodes[np.unique(skin)]) - 0.5 * BLOCK.extents).min(axis=1)
    assert np.quantile(from_planes, 0.95) < 1e-9


def test_edges_that_a_rough_mesh_cuts_off_are_made_up_for() -> None:
    # Rounded by 0.4 mm, which is less than the envelope of 0.54 mm.
    sphere = trimesh.creation.icosphere(2, 0.0004)
    places = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * [0.008, 0.006, 0.002]
    hole = trimesh.PointCloud((sphere.vertices + places[:, None]).reshape(-1, 3)).convex_hull
    mesh = tetrahedralise(shell(BLOCK, hole), 0.008, envelope=1e-2)
    check(mesh)
    wall = cavities(mesh)[0].faces
    flat = enclosed_volume(mesh.nodes, wall)
    curved = float(Cavity(jnp.asarray(wall))(jnp.asarray(mesh.nodes)))
    assert flat < 0.99 * hole.volume
    assert curved == pytest.approx(hole.volume, rel=4e-3)


def test_nodes_that_would_flatten_a_tetrahedron_stay_back() -> None:
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    one = tet_mesh(corners, [[0, 1, 2, 3]])
    # All of the tetrahedron's nodes are nearest to the square's bottom, where it would be flat.
    below = trimesh.creation.box((9.0, 9.0, 2.0)).apply_translation((0.0, 0.0, 0.9))
    moved = conforming(one, checked(below.vertices, below.faces), [], within=5.0)
    check(moved)
    assert mean_ratios(moved) > 0.3 * mean_ratios(one)
    near = conforming(one, checked(below.vertices, below.faces), [], within=0.2)
    assert near.nodes[:3, 2] == pytest.approx(-0.1) and near.nodes[3] == pytest.approx(corners[3])


def test_inserts_get_their_own_region_with_faces_on_their_outline() -> None:
    rod = trimesh.creation.box((0.006, 0.02, 0.01)).apply_translation((0.01, 0, 0))
    plate = trimesh.creation.box((0.01, 0.02, 0.004)).apply_translation((-0.01, 0, 0))
    mesh = tetrahedralise(shell(BLOCK), 0.006, inserts=[shell(rod), shell(plate)], envelope=1e-3)
    size = np.bincount(mesh.region, weights=volumes(mesh))
    expected = [BLOCK.volume - rod.volume - plate.volume, rod.volume, plate.volume]
    assert size == pytest.approx(expected, rel=1e-3)


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
