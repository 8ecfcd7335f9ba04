"""The solids of a layout have the volumes of closed forms, and fill the block together."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.design.casting import body_solid, casting, cavity_solids, outline_solid
from softfuse.design.casting_check import checked_solids
from softfuse.design.port import Port
from softfuse.errors import MeshError, SoftfuseError
from softfuse.mesh.block import NO_BOXES, Block
from softfuse.mesh.finger import FingerGeometry
from softfuse.mesh.surface import enclosed_volume
from softfuse.robot.layout.cavity_shape import CavityShape
from softfuse.robot.layout.cube_sphere import cube_sphere
from softfuse.robot.layout.layout import Parameter, TiedLayout
from softfuse.robot.layout.profile import RoundedBox, Superellipsoid

CHORD = 20e-6


def rounded_box(sizes, fillet: float) -> float:
    """Volume in m³ by Steiner's formula: of the core, slabs on its faces, rods on its edges, a ball."""
    a, b, c = np.asarray(sizes) - 2.0 * fillet
    slabs, rods = 2.0 * fillet * (a * b + b * c + c * a), np.pi * fillet**2 * (a + b + c)
    return a * b * c + slabs + rods + 4.0 / 3.0 * np.pi * fillet**3


def test_cavities_and_body_have_the_volumes_of_rounded_boxes(pad, pad_cast) -> None:
    exact = rounded_box((0.028, 0.028, 0.006), 0.001)
    surface = 2.0 * (0.028**2 + 2.0 * 0.028 * 0.006)
    for solid in cavity_solids(pad, pad.start, CHORD):
        assert exact - CHORD * surface < solid.volume() < exact
        assert solid.volume() == pytest.approx(exact, rel=1e-3)
    assert pad_cast.body.volume() == pytest.approx(0.08 * 0.08 * 0.018 - 4.0 * exact, rel=2e-4)


def test_volumes_converge_with_the_tolerance(twins) -> None:
    exact = rounded_box((0.026, 0.028, 0.006), 0.001)
    errors = []
    for chord in (80e-6, 20e-6, 5e-6):
        first, _ = cavity_solids(twins, twins.start, chord)
        errors.append(exact - first.volume())
    assert min(errors) > 0.0
    # In proportion to the tolerance, a factor of 16 in all.
    assert errors[0] > 2.5 * errors[1] > 2.5**2 * errors[2]
    assert errors[0] > 12.0 * errors[2]


def test_turned_and_round_cavities_have_the_volumes_of_dense_surfaces(layout_like, changed, twins) -> None:
    for layout, theta in ((twins, changed), (layout_like(Superellipsoid(), roundness=0.6), None)):
        theta = layout.start if theta is None else theta
        directions, faces = cube_sphere(120)
        dense = layout.points(jnp.asarray(theta), [directions] * 2)
        for solid, points in zip(cavity_solids(layout, theta, 5e-6), dense, strict=True):
            assert solid.volume() == pytest.approx(enclosed_volume(np.asarray(points), faces), rel=1e-3)


def test_body_and_cores_fill_the_block_exactly(pad_cast) -> None:
    block = outline_solid(pad_cast.outline)
    parts = [pad_cast.body_with_ports, *(core ^ block for core in pad_cast.cores)]
    assert sum(part.volume() for part in parts) == pytest.approx(0.08 * 0.08 * 0.018, rel=1e-12)
    between = pad_cast.body.volume() - pad_cast.body_with_ports.volume()
    # Rods of 9 mm, which are prisms within 20 µm, less what a fillet takes from the wall.
    assert between == pytest.approx(4.0 * 9e-3 * np.pi * 1e-6, rel=0.03)


def test_the_table_tells_names_volumes_and_surfaces(pad_cast) -> None:
    table = checked_solids(pad_cast)
    names = ["body", "body_with_ports", "core_0", "core_1", "core_2", "core_3"]
    assert [line.name for line in table] == names
    assert all(line.watertight and line.genus == 0 for line in table)
    assert [line.surfaces for line in table] == [5, 1, 1, 1, 1, 1]
    assert table[0].volume_mm3 == pytest.approx(1e9 * pad_cast.body.volume())


def test_notches_are_cut_from_the_block() -> None:
    finger = FingerGeometry((0.12, 0.02, 0.02), (0.03, 0.06, 0.09), 0.012, 0.015, (0.008, 0.006, 0.01), ())
    solid = outline_solid(finger.block())
    assert solid.volume() == pytest.approx(finger.block().volume(), rel=1e-12)
    assert (solid.genus(), len(solid.decompose())) == (0, 1)


def two_balls(apart: float, height: float) -> TiedLayout:
    """Balls of 4 mm radius with centres at a distance and a height in m, in a block of 40 x 20 x 20 mm."""
    outline = Block(
        np.array([-0.02, -0.01, 0.0]), np.array([0.02, 0.01, 0.02]), NO_BOXES, NO_BOXES, ((), (), ())
    )
    size = {"half x": 0.004, "half y": 0.004, "half z": 0.004, "roundness": 1.0}
    balls = [(CavityShape(Superellipsoid()), {"x": x, "y": 0.0, "z": height, **size}) for x in (0.0, apart)]
    return TiedLayout.of(outline, balls, [Parameter("x", 0.0, -1.0, 1.0, adds={(0, "x"): 1.0})])


def test_cavities_that_meet_reach_out_or_do_not_exist_are_refused() -> None:
    with pytest.raises(MeshError, match="cavity 0 and cavity 1 meet"):
        cavity_solids(two_balls(0.0079, 0.01), np.zeros(1), CHORD)
    with pytest.raises(MeshError, match="cavity 0 reaches out of the body"):
        cavity_solids(two_balls(0.01, 0.003), np.zeros(1), CHORD)
    with pytest.raises(SoftfuseError, match="is none"):
        cavity_solids(two_balls(0.01, 0.01), np.zeros(1), 0.0)
    thick = {
        "x": 0.0,
        "y": 0.0,
        "z": 0.01,
        "half x": 0.004,
        "half y": 0.004,
        "half z": 0.004,
        "fillet": 0.005,
    }
    layout = two_balls(0.01, 0.01)
    wrong = TiedLayout.of(layout.outline, [(CavityShape(RoundedBox()), thick)], [])
    with pytest.raises(MeshError, match="cavity 0 does not exist"):
        cavity_solids(wrong, np.zeros(0), CHORD)


def test_a_block_cut_in_two_is_refused() -> None:
    slit = np.array([[[-0.001, -0.01, 0.0], [0.001, 0.01, 0.02]]])
    outline = Block(np.array([-0.02, -0.01, 0.0]), np.array([0.02, 0.01, 0.02]), NO_BOXES, slit, ((), (), ()))
    with pytest.raises(MeshError, match="2 pieces"):
        outline_solid(outline)


def test_a_cavity_without_a_port_and_names_that_do_not_fit_are_refused() -> None:
    layout = two_balls(0.012, 0.01)
    ports = [Port(0, "low x", 0.001), Port(1, "high x", 0.001)]
    lengths = {"beyond": 0.004, "wall": 0.001, "chord": CHORD}
    with pytest.raises(SoftfuseError, match="cavity 1 has no port"):
        casting(layout, np.zeros(1), ports[:1], **lengths)
    with pytest.raises(SoftfuseError, match="as many names"):
        casting(layout, np.zeros(1), ports, names=["left", "left"], **lengths)


def test_a_cavity_may_have_two_ports() -> None:
    layout = two_balls(0.012, 0.01)
    ports = [
        Port(0, "low x", 0.001),
        Port(1, "low y", 0.0005, (0.012, -0.0015, 0.01)),
        Port(1, "high y", 0.0005, (0.012, 0.0015, 0.01)),
    ]
    cast = casting(layout, np.zeros(1), ports, beyond=0.004, wall=0.001, chord=CHORD)
    genus = {line.name: line.genus for line in checked_solids(cast)}
    assert genus == {"body": 0, "body_with_ports": 1, "core_0": 0, "core_1": 0}


def test_cores_that_overlap_are_refused(pad_cast) -> None:
    shifted = pad_cast.cores[0].translate((0.0, 0.03, 0.0))
    cores = (shifted, *pad_cast.cores[1:])
    wrong = replace(pad_cast, cores=cores, body_with_ports=body_solid(pad_cast.outline, cores))
    with pytest.raises(MeshError, match="holes through it|overlap"):
        checked_solids(wrong)
