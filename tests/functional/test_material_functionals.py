"""Functionals of material points, on maps x(X) that quadratic elements hold exactly, against integrals and
derivatives of the maps themselves; and against rigid motions.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

from softfuse.body import QUADRATIC, Body, mesh_for
from softfuse.errors import MeshError
from softfuse.functional.base import MaterialFunctional
from softfuse.functional.curvature import Curvature
from softfuse.functional.embedded_line import EmbeddedLine
from softfuse.functional.embedded_sheet import EmbeddedSheet
from softfuse.functional.marker import Marker
from softfuse.functional.orientation import DirectionInPatch, PatchRotation
from softfuse.material import NeoHookean

SIZE = np.array([0.06, 0.02, 0.02])
LINE = np.array([[0.004, 0.006, 0.005], [0.03, 0.011, 0.012], [0.052, 0.009, 0.016]])
POINT = np.array([0.031, 0.012, 0.008])
_at = jax.jit(lambda functional, rest, moved: functional(rest, moved))


class Map(NamedTuple):
    """x = b + A X + X · C X."""

    a: np.ndarray
    c: np.ndarray
    b: np.ndarray

    def __call__(self, x: np.ndarray) -> np.ndarray:
        return self.b + x @ self.a.T + np.einsum("ijk,...j,...k->...i", self.c, x, x)

    def slope(self, x: np.ndarray) -> np.ndarray:
        return self.a + 2 * np.einsum("ijk,...j->...ik", self.c, x)


def _generic(seed: int) -> Map:
    random = np.random.default_rng(seed)
    c = random.uniform(-2.0, 2.0, (3, 3, 3))
    return Map(np.eye(3) + random.uniform(-0.2, 0.2, (3, 3)), 0.5 * (c + c.swapaxes(1, 2)), np.ones(3))


def _rigid(vector: list[float]) -> Map:
    turn = Rotation.from_rotvec(vector).as_matrix()
    return Map(turn, np.zeros((3, 3, 3)), np.array([0.1, -0.2, 0.05]))


@pytest.fixture(scope="module")
def beam(box) -> Body:
    """A beam of 60 x 20 x 20 mm in uneven quadratic tetrahedra."""
    planes = (np.array([0, 11, 26, 39, 60]), np.array([0, 7.5, 20]), np.array([0, 9, 20]))
    mesh = mesh_for(QUADRATIC, box(*(1e-3 * np.asarray(p, float) for p in planes)))
    fixed = mesh.nodes[:, 0] == 0.0
    return Body.from_mesh(mesh, [NeoHookean.from_young(1e5, 0.4)], fixed, element=QUADRATIC)


@pytest.fixture(scope="module")
def moved(beam) -> Callable[[MaterialFunctional, Map], np.ndarray]:
    """moved(functional, x): its values when the beam's nodes are where the map takes them."""
    rest = np.asarray(beam.rest)
    return lambda functional, x: np.asarray(_at(functional, beam.rest, jnp.asarray(x(rest) - rest)))


@pytest.fixture(scope="module")
def parts(beam) -> dict[str, MaterialFunctional]:
    """One functional of each kind."""
    body = beam
    turn = Rotation.from_rotvec([0.4, 1.0, -0.7]).as_matrix()
    edges = np.array([[0.012, 0.002, 0.0], [0.0, 0.005, 0.004]])
    return {
        "marker": Marker.of(body, POINT, rotation=turn, origin=(0.3, 0.1, 0.0), components=(2, 0)),
        "direction": DirectionInPatch.of(body, POINT, 0.003, np.array([0.0, 0.0, -9.81]), mounting=turn),
        "rotation": PatchRotation.of(body, POINT, 0.003, mounting=turn),
        "line": EmbeddedLine.of(body, LINE, stations=[0, 1, 2]),
        "sheet": EmbeddedSheet.of(body, POINT, edges),
        "curvature": Curvature.of(body, LINE[[0, 2]], np.array([0.012, 0.03]), 0.01, np.eye(3)[1]),
    }


def test_marker_reads_the_point_in_the_camera_frame(beam, moved, parts) -> None:
    x, marker = _generic(0), parts["marker"]
    seen = np.asarray(marker.rotation).T @ (x(POINT) - np.array([0.3, 0.1, 0.0]))
    np.testing.assert_allclose(moved(marker, x), seen[[2, 0]], rtol=1e-13)
    with pytest.raises(MeshError, match="no right-handed frame"):
        Marker.of(beam, POINT, rotation=np.diag([1.0, 1.0, -1.0]))
    told = r"marker 0 at \(31, 12, 23\) mm lies outside the body by 3 mm .*: move"
    with pytest.raises(MeshError, match=told):
        Marker.of(beam, np.array([0.031, 0.012, 0.023]))


def test_patch_turns_with_the_mean_of_its_deformation(beam, moved, parts) -> None:
    """On a linear deformation gradient the mean over the ball is that at its middle."""
    x = _generic(1)
    u, _, v = np.linalg.svd(x.slope(POINT))
    turn = u @ v
    axes = turn @ np.asarray(parts["direction"].mounting)
    np.testing.assert_allclose(moved(parts["direction"], x), axes.T @ [0, 0, -9.81], rtol=1e-12)
    mounting = np.asarray(parts["rotation"].mounting)
    expected = Rotation.from_matrix(mounting.T @ turn @ mounting).as_rotvec()
    np.testing.assert_allclose(moved(parts["rotation"], x), expected, rtol=1e-11)
    with pytest.raises(MeshError, match="point of the patch"):
        PatchRotation.of(beam, POINT, 0.02)


def test_lengths_are_the_integrals_of_the_stretch(beam, moved, parts) -> None:
    x = _generic(2)
    exact = []
    for start, end in zip(LINE, LINE[1:], strict=False):

        def stretch(s, start=start, end=end):
            return np.linalg.norm(x.slope(start + s * (end - start)) @ (end - start))

        exact.append(quad(stretch, 0, 1, epsabs=1e-14)[0])
    np.testing.assert_allclose(moved(parts["line"], x), exact, rtol=1e-9)
    np.testing.assert_allclose(moved(EmbeddedLine.of(beam, LINE), x), [sum(exact)], rtol=1e-9)
    np.testing.assert_allclose(moved(EmbeddedLine.of(beam, LINE, stations=[1, 2]), x), exact[1:], rtol=1e-9)


def test_line_passes_through_elements_whose_stretch_jumps(beam) -> None:
    """One node moves: the length is the sum over the elements, as so many small pieces also give it."""
    rest = np.asarray(beam.rest)
    displacement = np.zeros_like(rest)
    inner = np.argmin(np.linalg.norm(rest - [0.026, 0.0075, 0.009], axis=1))
    displacement[inner] = [2e-4, 5e-4, -3e-4]
    line = EmbeddedLine.of(beam, LINE)
    fine = np.concatenate([np.linspace(a, b, 2001)[:-1] for a, b in zip(LINE, LINE[1:], strict=False)])
    points = Marker.of(beam, LINE[0]).point
    at = type(points).embedded(beam, np.concatenate([fine, LINE[-1:]]))
    x = np.asarray(at.positions(beam.rest, jnp.asarray(displacement)))
    polygon = np.linalg.norm(np.diff(x, axis=0), axis=1).sum()
    found = _at(line, beam.rest, jnp.asarray(displacement))
    np.testing.assert_allclose(found, polygon, rtol=2e-6)
    assert abs(float(found[0]) / EmbeddedLine.of(beam, LINE).weight.sum() - 1) > 1e-4


@pytest.mark.parametrize(
    ("stations", "told"),
    [([0, 3], "station 3 of a line of 3 points"), ([1, 1], "ascending"), ([2], "two numbers")],
)
def test_stations_that_are_none_are_told(beam, stations, told) -> None:
    with pytest.raises(MeshError, match=told):
        EmbeddedLine.of(beam, LINE, stations=stations)


def test_points_outside_are_all_told_with_their_distances(beam) -> None:
    outside = LINE + np.array([0, 0, 0.007])
    told = r"point of the line 1 .*by \d.*; point of the line 2 .*by 3 mm .*: move into the material"
    with pytest.raises(MeshError, match=told):
        EmbeddedLine.of(beam, outside + np.array([[0, 0, 0], [0, 0, 0.003], [0, 0, 0]]))


def test_sheet_grows_and_thins_with_the_material(beam, moved, parts) -> None:
    """A uniform deformation in closed form, then a generic one by many points."""
    sheet = parts["sheet"]
    a = _generic(3).a
    normal, area = np.asarray(sheet.normal), float(np.sum(sheet.weight))
    grown = np.linalg.norm(np.linalg.det(a) * np.linalg.inv(a).T @ normal)
    across = 1 / np.linalg.norm(np.linalg.inv(a).T @ normal)
    uniform = Map(a, np.zeros((3, 3, 3)), np.zeros(3))
    np.testing.assert_allclose(moved(sheet, uniform), [area * grown, across], rtol=1e-12)
    x, edges = _generic(3), np.array([[0.012, 0.002, 0.0], [0.0, 0.005, 0.004]])
    n = 400
    middle = (np.arange(n) + 0.5) / n - 0.5
    grid = np.stack(np.meshgrid(middle, middle, indexing="ij"), -1).reshape(-1, 2)
    f = x.slope(POINT + grid @ edges)
    j = np.linalg.det(f)
    each = j * np.linalg.norm(np.swapaxes(np.linalg.inv(f), 1, 2) @ normal, axis=1)
    exact = area * each.mean(), each.mean() / (each**2 / j).mean()
    np.testing.assert_allclose(moved(sheet, x), exact, rtol=1e-6)
    with pytest.raises(MeshError, match="corner of the sheet"):
        EmbeddedSheet.of(beam, POINT, 5 * edges)


def test_curvature_of_parabolas_is_exact(beam, moved, parts) -> None:
    x, fibre = _generic(4), parts["curvature"]
    along = (LINE[2] - LINE[0]) / np.linalg.norm(LINE[2] - LINE[0])
    expected = []
    for s, m in zip((0.012, 0.03), np.asarray(fibre.across), strict=True):
        f = x.slope(LINE[0] + s * along)
        mean = quad(lambda g: np.linalg.norm(x.slope(LINE[0] + g * along) @ along), s - 0.005, s + 0.005)[0]
        stretch, bend = np.linalg.norm(f @ along), 2 * np.einsum("ijk,j,k->i", x.c, along, along)
        t = f @ along / stretch
        d1 = f @ m - t * (t @ f @ m)
        d1 /= np.linalg.norm(d1)
        expected.append([mean / 0.01 - 1, bend @ d1 / stretch, bend @ np.cross(t, d1) / stretch])
    found = moved(fibre, x).reshape(2, 3)
    np.testing.assert_allclose(found[:, 1:], np.array(expected)[:, 1:], rtol=1e-9)
    np.testing.assert_allclose(found[:, 0], np.array(expected)[:, 0], atol=2e-6)
    assert np.all(np.abs(found[:, 1:]) > 0.03)


def test_cores_of_a_bent_fibre_are_strained_as_gratings_say(beam, box) -> None:
    """An arc in a generic plane with plane sections, stretched by 2 %: each core's own strain along the gauge
    is ε − d (κ₁ cos θ + κ₂ sin θ).
    """
    mesh = mesh_for(QUADRATIC, box(*(np.linspace(0, s, n) for s, n in zip(SIZE, (17, 5, 5), strict=True))))
    body = Body.from_mesh(mesh, beam.materials, mesh.nodes[:, 0] == 0.0, element=QUADRATIC)
    kappa, stretch, plane = 6.0, 1.02, 0.7
    section = np.array([[0, np.cos(plane), np.sin(plane)], [0, -np.sin(plane), np.cos(plane)]])
    rest = np.asarray(body.rest)
    y, z = ((rest - [0, 0.01, 0.01]) @ section.T).T
    s = rest[:, 0]
    # Turned by κ s towards the first direction of the section.
    e = np.stack([-np.sin(kappa * s), *(np.cos(kappa * s)[None] * section[0, 1:, None])], axis=1)
    middle = np.stack([np.sin(kappa * s), *((1 - np.cos(kappa * s)) * section[0, 1:, None])], axis=1)
    x = middle * stretch / kappa + y[:, None] * e + z[:, None] * section[1]
    displacement = jnp.asarray(x - rest)
    ends = np.array([[0.005, 0.01, 0.01], [0.055, 0.01, 0.01]])
    fibre = Curvature.of(body, ends, np.array([0.02, 0.03]), 0.01, np.eye(3)[1])
    found = np.asarray(_at(fibre, body.rest, displacement)).reshape(2, 3)
    # Per length at rest the direction turns by κ; its own plane is at `plane` from the first axis.
    expected = [stretch - 1, kappa * np.cos(plane), kappa * np.sin(plane)]
    np.testing.assert_allclose(found, np.tile(expected, (2, 1)), rtol=2e-3, atol=2e-5)
    for theta in (0.0, 2.1, 4.2):
        d = 0.004
        core = ends + d * np.array([0.0, np.cos(theta), np.sin(theta)])
        piece = EmbeddedLine.of(body, np.stack([core[0] + [0.01, 0, 0], core[0] + [0.02, 0, 0]]))
        strain = float(_at(piece, body.rest, displacement)[0]) / 0.01 - 1
        told = found[0, 0] - d * (found[0, 1] * np.cos(theta) + found[0, 2] * np.sin(theta))
        np.testing.assert_allclose(strain, told, atol=5e-5)


def test_gauges_that_leave_the_curve_are_told(beam) -> None:
    with pytest.raises(MeshError, match="station 1 at 2 mm .* move it by 3 mm or more"):
        Curvature.of(beam, LINE, np.array([0.02, 0.002]), 0.01, np.eye(3)[1])


@pytest.mark.parametrize("vector", [[0.3, -0.2, 0.9], [0.0, 3.0, 0.4]])
def test_rigid_motions_change_no_strain_and_turn_what_turns(moved, parts, vector) -> None:
    x, still = _rigid(vector), _rigid([0, 0, 0])
    for name in ("line", "sheet", "curvature"):
        at_rest = moved(parts[name], still)
        np.testing.assert_allclose(moved(parts[name], x), at_rest, rtol=1e-11, atol=1e-11)
    mounting = np.asarray(parts["rotation"].mounting)
    np.testing.assert_allclose(mounting @ moved(parts["rotation"], x), vector, rtol=1e-10, atol=1e-14)


def test_values_have_the_slopes_of_differences(beam, parts) -> None:
    """In how nodes move, forwards and backwards, at generic strains and at rest; and in the shape at rest,
    which the points' places in their elements follow.
    """
    every, random = tuple(parts.values()), np.random.default_rng(7)
    which = np.concatenate([np.full(part.count, k) for k, part in enumerate(every)])

    def values(*at):
        return jnp.concatenate([part(*at) for part in every])

    value, forward = jax.jit(values), jax.jit(lambda at, along: jax.jvp(values, at, along)[1])
    backward = jax.jit(lambda at, weights: jax.vjp(values, *at)[1](weights))
    rest, h = np.asarray(beam.rest), 1e-8
    still, generic = np.zeros(rest.shape), 2e-4 * random.normal(size=rest.shape)
    for moved, by_shape in ((still, 0.0), (generic, 0.0), (generic, 1.0)):
        along = by_shape * random.normal(size=rest.shape), random.normal(size=rest.shape)
        slope = np.asarray(forward((rest, moved), along))
        ends = (value(rest + sign * h * along[0], moved + sign * h * along[1]) for sign in (1, -1))
        difference = np.subtract(*map(np.asarray, ends)) / (2 * h)
        size = np.array([np.abs(difference[which == k]).max() for k in which])
        np.testing.assert_allclose(slope / size, difference / size, atol=1e-6)
        weights = random.normal(size=len(slope)) / size
        back = backward((rest, moved), weights)
        np.testing.assert_allclose(sum(map(np.vdot, back, along)), weights @ slope, rtol=1e-9)


def test_changes_are_counted_from_rest(beam, parts) -> None:
    marker, z = parts["marker"], jnp.asarray(1e-4 * np.random.default_rng(1).normal(size=beam.n))
    assert np.all(np.asarray(marker.change(beam, jnp.zeros(beam.n))) == 0.0)
    at_rest = marker.value(beam, jnp.zeros(beam.n))
    np.testing.assert_allclose(marker.change(beam, z), marker.value(beam, z) - at_rest, rtol=1e-12)
