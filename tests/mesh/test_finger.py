"""The parametric finger: exact volumes, faces where the geometry has them, symmetric and bounded meshes."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from softfuse.errors import MeshError
from softfuse.mesh.block import block_mesh
from softfuse.mesh.finger import FingerGeometry, finger_mesh
from softfuse.mesh.orientation import check
from softfuse.mesh.quality import mesh_quality
from softfuse.mesh.surface import boundary_faces, cavities, centroid, enclosed_volume, outer_surface
from softfuse.mesh.tetmesh import TetMesh, edge_lengths, quadratic, volumes

NECKS = (0.03, 0.06, 0.09)
SIDES = (0.005, -0.005)
FINGER = FingerGeometry(
    size=(0.12, 0.02, 0.02),
    neck_x=NECKS,
    neck_length=0.012,
    neck_height=0.015,
    cavity_size=(0.008, 0.006, 0.01),
    cavity_centres=tuple((x, y, 0.0125) for x in NECKS for y in SIDES),
)
SIZES = [(1.0, 0.024, 0.0), (0.01, 0.012, 2.0), (0.007, 0.012, 2.0), (0.006, 0.006, 1.0), (0.004, 0.03, 4.0)]


def meshed(sizes: tuple[float, float, float], geometry: FingerGeometry = FINGER) -> TetMesh:
    """The finger with these wall_size, base_size and growth."""
    wall, base, growth = sizes
    return finger_mesh(geometry, wall, base, growth=growth)


@pytest.mark.parametrize("sizes", SIZES)
def test_volume_and_cavities_are_exact(sizes: tuple[float, float, float]) -> None:
    mesh = meshed(sizes)
    check(mesh)
    beam, notches, holes = 120 * 20 * 20e-9, 3 * 12 * 20 * 5e-9, 6 * 8 * 6 * 10e-9
    assert volumes(mesh).sum() == pytest.approx(beam - notches - holes, rel=1e-12)
    assert FINGER.block().volume() == pytest.approx(beam - notches - holes, rel=1e-12)
    assert enclosed_volume(mesh.nodes, outer_surface(mesh).faces) == pytest.approx(beam - notches, rel=1e-12)
    found = cavities(mesh, FINGER.centres())
    assert [1e9 * enclosed_volume(mesh.nodes, c.faces) for c in found] == pytest.approx(
        [480.0] * 6, rel=1e-12
    )
    for wall, centre in zip(found, FINGER.centres(), strict=True):
        np.testing.assert_allclose(centroid(mesh.nodes, wall.faces), centre, atol=1e-12)


def test_cavities_follow_the_order_of_the_config() -> None:
    centres = tuple(FINGER.cavity_centres[k] for k in (4, 1, 5, 0, 3, 2))
    mesh = meshed(SIZES[0], replace(FINGER, cavity_centres=centres))
    found = [centroid(mesh.nodes, wall.faces) for wall in cavities(mesh, np.array(centres))]
    np.testing.assert_allclose(found, centres, atol=1e-12)


def areas(mesh: TetMesh, axis: int) -> dict[tuple[float, int], float]:
    """Area in mm² of the skin by its position in mm along an axis and the sign of its normal along it."""
    a, b, c = (1e3 * mesh.nodes[outer_surface(mesh).faces[:, k]] for k in range(3))
    area = 0.5 * np.cross(b - a, c - a)
    flat = np.abs(area[:, axis]) > 0.5 * np.linalg.norm(area, axis=1)
    found: dict[tuple[float, int], float] = {}
    for at, value in zip(a[flat, axis].round(6).tolist(), area[flat, axis].tolist(), strict=True):
        key = at, int(np.sign(value))
        found[key] = found.get(key, 0.0) + abs(value)
    return found


@pytest.mark.parametrize("sizes", SIZES)
def test_the_skin_is_that_of_a_beam_with_notches_at_the_palm(sizes: tuple[float, float, float]) -> None:
    mesh = meshed(sizes)
    along = {(0.0, -1): 400.0, (120.0, 1): 400.0}
    along |= {(1e3 * x - 6.0, 1): 100.0 for x in NECKS} | {(1e3 * x + 6.0, -1): 100.0 for x in NECKS}
    assert areas(mesh, 0) == pytest.approx(along)
    side = 120.0 * 20.0 - 3 * 12.0 * 5.0
    assert areas(mesh, 1) == pytest.approx({(-10.0, -1): side, (10.0, 1): side})
    palm = 84.0 * 20.0
    assert areas(mesh, 2) == pytest.approx({(0.0, -1): palm, (5.0, -1): 2400.0 - palm, (20.0, 1): 2400.0})


@pytest.mark.parametrize("sizes", SIZES)
def test_no_face_hangs_inside(sizes: tuple[float, float, float]) -> None:
    """A hanging node would leave faces of one tetrahedron besides the skin and the walls of the cavities."""
    mesh = meshed(sizes)
    a, b, c = (1e3 * mesh.nodes[boundary_faces(mesh).faces[:, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    skin = 2 * (400.0 + 2400.0 + 2400.0 - 180.0) + 6 * 100.0
    assert area == pytest.approx(skin + 6 * 2 * (48.0 + 60.0 + 80.0), rel=1e-12)


def tets_of(nodes: np.ndarray, mesh: TetMesh) -> set[tuple[tuple[float, ...], ...]]:
    """Tetrahedra as sorted positions of their corners; -0 is 0."""
    return {tuple(sorted(map(tuple, corners))) for corners in (nodes[mesh.tets] + 0.0).tolist()}


@pytest.mark.parametrize("sizes", SIZES)
def test_left_and_right_are_mirror_images_to_the_bit(sizes: tuple[float, float, float]) -> None:
    mesh = meshed(sizes)
    assert tets_of(mesh.nodes * [1.0, -1.0, 1.0], mesh) == tets_of(mesh.nodes, mesh)


@pytest.mark.parametrize("sizes", SIZES[:4])
def test_necks_have_the_same_elements_each(sizes: tuple[float, float, float]) -> None:
    mesh = meshed(sizes)
    middles = 1e3 * mesh.nodes[mesh.tets].mean(axis=1)
    around = [middles[np.abs(middles[:, 0] - 1e3 * x) < 6.0] - [1e3 * x, 0.0, 0.0] for x in NECKS]
    first, second, third = ({tuple(p) for p in (near.round(6) + 0.0).tolist()} for near in around)
    assert first == second == third
    assert {(-x + 0.0, y, z) for x, y, z in first} == first


@pytest.mark.parametrize("sizes", SIZES[1:])
def test_edges_obey_the_size_function(sizes: tuple[float, float, float]) -> None:
    wall, _, growth = sizes
    mesh = meshed(sizes)
    distance = np.full(len(mesh.nodes), np.inf)
    half = 0.5 * np.array(FINGER.cavity_size)
    for centre, axis, signs in product(FINGER.centres(), range(3), product((-1, 1), repeat=2)):
        start = centre + half * np.insert(signs, axis, -1)
        step = np.insert((0.0, 0.0), axis, 2.0 * half[axis])
        along = np.clip((mesh.nodes - start) @ step / (step @ step), 0.0, 1.0)
        distance = np.minimum(distance, np.linalg.norm(mesh.nodes - start - along[:, None] * step, axis=1))
    allowed = wall + growth * distance[mesh.tets].min(axis=1)
    length = edge_lengths(mesh).max(axis=1)
    assert (length <= allowed * (1.0 + 1e-6)).all()
    assert (length > 0.5 * allowed).any()


def test_quality_stays_bounded_under_refinement() -> None:
    for base, least in ((0.012, 0.15), (0.009, 0.2), (0.006, 0.35)):
        found = [mesh_quality(finger_mesh(FINGER, s, base)) for s in (1.0, 0.01, 0.007, 0.005, 0.003)]
        assert min(quality.mean_ratio.least for quality in found) > least
        assert max(quality.dihedral_angle.most for quality in found) < 166.0


@pytest.mark.parametrize(
    ("sizes", "count"),
    [
        ((1.0, 0.012, 0.0), 4200),
        ((0.01, 0.012, 2.0), 5500),
        ((0.007, 0.012, 2.0), 8100),
        ((0.005, 0.006, 2.0), 11_500),
        ((0.004, 0.006, 2.0), 15_700),
        ((0.003, 0.006, 1.0), 30_800),
    ],
)
def test_parameters_for_the_usual_numbers_of_quadratic_nodes(
    sizes: tuple[float, float, float], count: int
) -> None:
    assert len(quadratic(meshed(sizes)).nodes) == pytest.approx(count, rel=0.02)


def test_necks_as_high_as_the_finger_leave_no_notch() -> None:
    plain = replace(
        FINGER, neck_height=0.02, cavity_centres=tuple((x, y, 0.01) for x in NECKS for y in SIDES)
    )
    assert len(plain.notches()) == 0
    mesh = meshed(SIZES[1], plain)
    assert areas(mesh, 2) == pytest.approx({(0.0, -1): 2400.0, (20.0, 1): 2400.0})
    assert volumes(mesh).sum() == pytest.approx((48_000.0 - 6 * 480.0) * 1e-9, rel=1e-12)


def test_cavities_at_different_heights_and_necks_in_any_order() -> None:
    odd = replace(
        FINGER,
        neck_x=(0.09, 0.025),
        cavity_centres=((0.025, 0.0, 0.0115), (0.089, -0.004, 0.0135), (0.0575, 0.005, 0.0075)),
    )
    mesh = meshed(SIZES[1], odd)
    assert volumes(mesh).sum() == pytest.approx((48_000.0 - 2 * 1200.0 - 3 * 480.0) * 1e-9, rel=1e-12)
    for wall, centre in zip(cavities(mesh, odd.centres()), odd.centres(), strict=True):
        np.testing.assert_allclose(centroid(mesh.nodes, wall.faces), centre, atol=1e-12)


def test_a_wall_near_the_middle_of_a_neck_takes_its_plane() -> None:
    near = replace(FINGER, cavity_centres=((0.0341, 0.0, 0.0125),))
    mesh = meshed(SIZES[0], near)
    assert volumes(mesh).sum() == pytest.approx(near.block().volume(), rel=1e-12)
    assert (np.abs(mesh.nodes[:, 0] - 0.0301) < 1e-9).any()
    assert not (np.abs(mesh.nodes[:, 0] - 0.03) < 1e-9).any()


@pytest.mark.parametrize("growth", [0.0, 2.0])
def test_a_finger_without_cavities(growth: float) -> None:
    solid = replace(FINGER, cavity_centres=())
    mesh = finger_mesh(solid, 0.02, 0.02, growth=growth)
    assert volumes(mesh).sum() == pytest.approx((48_000.0 - 3 * 1200.0) * 1e-9, rel=1e-12)
    assert cavities(mesh, solid.centres()) == []


def test_a_size_of_ones_own_refines_around_a_contact() -> None:
    def longest(corners: np.ndarray) -> np.ndarray:
        return 0.004 + np.linalg.norm(corners - [0.115, 0.01, 0.01], axis=2).min(axis=1)

    mesh = block_mesh(FINGER.block(), 0.012, longest)
    check(mesh)
    assert (edge_lengths(mesh).max(axis=1) <= longest(mesh.nodes[mesh.tets]) * (1.0 + 1e-6)).all()
    assert len(mesh.nodes) < 1500


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"size": (0.12, -0.02, 0.02)}, "must be positive"),
        ({"neck_length": 0.0}, "must be positive"),
        ({"neck_height": 0.021}, "necks are 21 mm high, the finger 20 mm: lower neck_height"),
        ({"neck_x": ()}, "no neck: give the middle of at least one"),
        ({"neck_x": (0.03, 0.006)}, "neck 1 at x = 6 mm reaches an end"),
        ({"neck_x": (0.03, 0.115)}, "neck 1 at x = 115 mm reaches an end"),
        ({"neck_x": (0.03, 0.06, 0.042)}, "necks 0 and 2 leave no segment"),
        ({"cavity_centres": ((0.03, 0.0, 0.0125), (0.03, 0.007, 0.0125))}, "cavity 1 .* reaches the surface"),
        ({"cavity_centres": ((0.03, 0.0, 0.015),)}, "cavity 0 .* reaches the surface"),
        ({"cavity_centres": ((0.03, 0.0, 0.01),)}, "cavity 0 .* cuts the notch from .*24.* to .*36"),
        ({"cavity_centres": ((0.04, 0.0, 0.008),)}, "cavity 0 .* cuts the notch"),
        ({"cavity_centres": ((0.03, 0.003, 0.0125), (0.03, -0.003, 0.0125))}, "cavities 0 and 1 touch"),
        ({"cavity_centres": ((0.03, 0.0069, 0.0125),)}, "0.1 mm apart at y = 9.9 mm, .* thicken the wall"),
        ({"neck_height": 0.0127}, "0.2 mm apart at z = 7.3 mm"),
    ],
)
def test_an_impossible_finger_is_told(change: dict, told: str) -> None:
    with pytest.raises(MeshError, match=told):
        finger_mesh(replace(FINGER, **change), 0.01, 0.012)


@pytest.mark.parametrize(
    ("sizes", "told"),
    [
        ((0.0, 0.012, 1.0), "wall_size must be positive"),
        ((0.01, 0.012, -1.0), "growth not negative"),
        ((0.01, 0.0, 1.0), "base_size must be positive"),
    ],
)
def test_a_size_that_is_not_positive_is_told(sizes: tuple[float, float, float], told: str) -> None:
    with pytest.raises(MeshError, match=told):
        meshed(sizes)
