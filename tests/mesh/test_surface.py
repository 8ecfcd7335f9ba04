"""Boundary, its closed components, and cavities in the order of the config."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softfuse.errors import MeshError
from softfuse.mesh.orientation import oriented
from softfuse.mesh.pad import PadGeometry
from softfuse.mesh.quality import dihedral_angles, mean_ratios, mesh_quality
from softfuse.mesh.surface import (
    boundary_components,
    boundary_faces,
    cavities,
    centroid,
    enclosed_volume,
    outer_surface,
    winding_number,
)
from softfuse.mesh.tetmesh import TetMesh, edge_lengths, quadratic, tet_mesh, volumes


@pytest.fixture(params=[1, 2])
def body(request: pytest.FixtureRequest, pad: TetMesh) -> TetMesh:
    return pad if request.param == 1 else quadratic(pad)


def test_every_edge_of_the_boundary_belongs_to_two_faces_in_opposite_senses(body: TetMesh) -> None:
    for part in boundary_components(body):
        ways = part.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        there = {tuple(way) for way in ways.tolist()}
        assert len(there) == len(ways)
        assert there == {(b, a) for a, b in there}


def test_components_come_by_size_and_face_out_of_the_material(body: TetMesh) -> None:
    inside = [1e9 * enclosed_volume(body.nodes, part.faces) for part in boundary_components(body)]
    assert inside == pytest.approx([115_200.0] + 4 * [-4704.0], rel=1e-12)
    faces = boundary_faces(body)
    a, b, c = (body.nodes[faces.faces[:, k]] for k in range(3))
    outwards = a - body.nodes[body.corners[faces.tets]].mean(axis=1)
    assert (np.einsum("fi,fi->f", outwards, np.cross(b - a, c - a)) > 0.0).all()


def test_owner_and_mid_edge_nodes_of_faces(body: TetMesh) -> None:
    for part in [boundary_faces(body), *cavities(body)]:
        for face, tet in zip(part.faces[:50], part.tets[:50], strict=True):
            assert set(face) <= set(body.tets[tet])
        if body.order == 2:
            corners = body.nodes[part.faces[:, :3]]
            middles = 0.5 * (corners + np.roll(corners, -1, axis=1))
            np.testing.assert_allclose(body.nodes[part.faces[:, 3:]], middles, atol=1e-17)


def test_cavities_follow_the_config_and_face_the_material(body: TetMesh, geometry: PadGeometry) -> None:
    order = np.array([2, 0, 3, 1])
    found = cavities(body, geometry.centres()[order])
    for part, centre in zip(found, geometry.centres()[order], strict=True):
        assert 1e9 * enclosed_volume(body.nodes, part.faces) == pytest.approx(4704.0, rel=1e-12)
        np.testing.assert_allclose(centroid(body.nodes, part.faces), centre, atol=1e-12)


def test_without_centres_cavities_come_by_x_then_y(body: TetMesh, geometry: PadGeometry) -> None:
    middles = [centroid(body.nodes, part.faces) for part in cavities(body)]
    np.testing.assert_allclose(middles, geometry.centres(), atol=1e-12)


@settings(max_examples=25)
@given(
    st.permutations(range(4)),
    st.lists(
        st.tuples(*[st.floats(-0.0139, 0.0139)] * 2, st.floats(-0.0029, 0.0029)), min_size=4, max_size=4
    ),
)
def test_any_point_inside_names_its_cavity(pad: TetMesh, geometry: PadGeometry, order, offsets) -> None:
    centres = geometry.centres()[list(order)]
    found = cavities(pad, centres + np.array(offsets))
    np.testing.assert_allclose([centroid(pad.nodes, part.faces) for part in found], centres, atol=1e-12)


def test_a_centre_outside_belongs_to_the_nearest_cavity(pad: TetMesh, geometry: PadGeometry) -> None:
    found = cavities(pad, geometry.centres() + [0.0, 0.0, 0.005])
    np.testing.assert_allclose([centroid(pad.nodes, p.faces) for p in found], geometry.centres(), atol=1e-12)


def test_a_count_that_differs_is_told(pad: TetMesh, geometry: PadGeometry) -> None:
    with pytest.raises(MeshError, match="config names 3 cavities, the mesh has 4 closed inner surfaces"):
        cavities(pad, geometry.centres()[:3])
    solid = replace_with_solid(pad)
    with pytest.raises(MeshError, match="config names 4 cavities, the mesh has 0 .* none"):
        cavities(solid, geometry.centres())
    assert cavities(solid) == [] and cavities(solid, np.empty((0, 3))) == []


def replace_with_solid(pad: TetMesh) -> TetMesh:
    """The block above the cavities alone."""
    above = (pad.nodes[pad.corners][:, :, 2] > 0.012 - 1e-9).all(axis=1)
    return oriented(tet_mesh(pad.nodes, pad.tets[above]))


def test_two_centres_in_one_cavity_are_told(pad: TetMesh, geometry: PadGeometry) -> None:
    centres = geometry.centres()
    centres[2] = centres[0] + 0.001
    with pytest.raises(MeshError, match="centres 0 and 2 of the config both belong to the cavity"):
        cavities(pad, centres)


def test_separate_parts_are_told(pad: TetMesh) -> None:
    twice = tet_mesh(
        np.vstack([pad.nodes, pad.nodes + [0.1, 0, 0]]), np.vstack([pad.tets, pad.tets + len(pad.nodes)])
    )
    with pytest.raises(MeshError, match="falls into 2 parts"):
        outer_surface(twice)


def test_parts_that_touch_along_an_edge_are_told() -> None:
    nodes = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, -1, 0], [-1, 0, 0]])
    mesh = oriented(tet_mesh(nodes, [[0, 1, 2, 3], [0, 3, 4, 5]]))
    with pytest.raises(MeshError, match="4 faces of the boundary meet at the edge of the nodes 0 and 3"):
        boundary_components(mesh)


def test_winding_number_inside_and_outside(pad: TetMesh) -> None:
    skin = outer_surface(pad).faces
    points = np.array([[0.0, 0, 0.009], [0.0399, 0.0399, 0.0001], [0.0, 0, 0.0181], [0.05, 0, 0.009]])
    np.testing.assert_allclose(winding_number(points, pad.nodes, skin), [1, 1, 0, 0], atol=1e-12)
    everything = boundary_faces(pad).faces
    np.testing.assert_allclose(
        winding_number(np.array([[0.017, 0.017, 0.009]]), pad.nodes, everything), 0, atol=1e-12
    )


def test_quality_of_the_regular_and_of_the_right_angled_tetrahedron() -> None:
    regular = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    mesh = oriented(tet_mesh(regular, [[0, 1, 2, 3]]))
    assert mean_ratios(mesh) == pytest.approx([1.0])
    np.testing.assert_allclose(dihedral_angles(mesh), np.degrees(np.arccos(1 / 3)))
    corner = tet_mesh(np.vstack([np.zeros(3), np.eye(3)]), [[0, 1, 2, 3]])
    assert mean_ratios(corner) == pytest.approx([12 * 0.5 ** (2 / 3) / 9])
    np.testing.assert_allclose(np.sort(dihedral_angles(corner)[0])[3:], 90.0)
    np.testing.assert_allclose(np.sort(dihedral_angles(corner)[0])[:3], np.degrees(np.arccos(1 / np.sqrt(3))))


def test_quality_report_of_the_pad(body: TetMesh, geometry: PadGeometry) -> None:
    report = mesh_quality(replace(body, region=np.arange(len(body.tets), dtype=np.int32) % 2))
    assert (report.n_nodes, report.n_tets, report.order) == (len(body.nodes), len(body.tets), body.order)
    assert report.regions == (0, 1)
    assert report.volume == pytest.approx(geometry.block().volume(), rel=1e-12)
    assert 1e9 * np.array(report.cavity_volumes) == pytest.approx([4704.0] * 4, rel=1e-12)
    assert report.tet_volume.mean == pytest.approx(volumes(body).mean(), rel=1e-12)
    assert report.edge_length.most == edge_lengths(body).max()
    for spread in (report.mean_ratio, report.tet_volume, report.edge_length, report.dihedral_angle):
        assert 0.0 < spread.least <= spread.mean <= spread.most
    assert report.mean_ratio.most <= 1.0 and report.dihedral_angle.most < 180.0
