"""Rods are where they should be, keep their walls, and find the nearest way out."""

import numpy as np
import pytest

from softfuse.design.casting import cavity_solids
from softfuse.design.port import Port, box_solid, check_rods, nearest_ports, placed, prism
from softfuse.errors import MeshError, SoftfuseError
from softfuse.mesh.block import NO_BOXES, NORMALS, SIDES, Block
from softfuse.robot.layout.cavity_shape import CavityShape
from softfuse.robot.layout.layout import TiedLayout
from softfuse.robot.layout.profile import RoundedBox

CHORD = 20e-6


@pytest.fixture(scope="module")
def pad_cavities(pad):
    return cavity_solids(pad, pad.start, CHORD)


def with_notch(low, high) -> TiedLayout:
    """A cavity of 6 mm around (0, 0, 10) mm in a block of 40 x 20 x 20 mm with a notch."""
    outline = Block(
        np.array([-0.02, -0.01, 0.0]),
        np.array([0.02, 0.01, 0.02]),
        NO_BOXES,
        np.array([[low, high]], float),
        ((), (), ()),
    )
    values = {"x": 0.0, "y": 0.0, "z": 0.01, "fillet": 0.001}
    halves = {name: 0.003 for name in ("half x", "half y", "half z")}
    return TiedLayout.of(outline, [(CavityShape(RoundedBox()), {**values, **halves})], [])


@pytest.mark.parametrize("side", SIDES)
def test_a_rod_lies_along_its_direction(pad, side) -> None:
    rod = placed(pad, pad.start, Port(3, side, 0.001), beyond=0.006)
    solid = rod.solid(CHORD)
    low, high = np.reshape(solid.bounding_box(), (2, 3))
    direction = NORMALS[SIDES.index(side)]
    axis = int(np.argmax(np.abs(direction)))
    start = np.array([0.017, 0.017, 0.009])
    end = (pad.outline.high if direction[axis] > 0.0 else pad.outline.low) + 0.006 * direction
    assert sorted([low[axis], high[axis]]) == pytest.approx(sorted([start[axis], end[axis]]))
    across = np.delete(np.stack([low - start, high - start]), axis, axis=1)
    np.testing.assert_allclose(across, [[-0.001] * 2, [0.001] * 2], atol=1e-12)
    assert solid.volume() == pytest.approx(np.pi * 1e-6 * (rod.inside + 0.003) + 0.0016**2 * 0.003, rel=0.05)
    assert solid.genus() == 0


def test_a_prism_is_within_its_tolerance_and_room_is_all_round() -> None:
    start, direction = np.zeros(3), np.array([0.0, -1.0, 0.0])
    narrow = prism(start, direction, 0.01, 0.001, CHORD)
    assert np.pi * 1e-8 > narrow.volume() > np.pi * 1e-8 * (1.0 - CHORD / 0.001) ** 2
    wide = prism(start - 0.001 * direction, direction, 0.012, 0.001, CHORD, room=0.0002)
    around = box_solid(np.full(3, -0.02), np.full(3, 0.02)) - wide
    # The flats of sixteen sides are nearer than the corners by 2 %.
    assert narrow.min_gap(around, 0.001) == pytest.approx(0.0002, rel=0.021)


def test_the_nearest_ways_out_are_taken(pad, pad_cavities) -> None:
    ports = nearest_ports(pad, pad.start, pad_cavities, radius=0.001, wall=0.002, chord=CHORD)
    assert [port.side for port in ports] == ["low x", "low x", "high x", "high x"]
    assert [port.cavity for port in ports] == [0, 1, 2, 3]
    along_y = nearest_ports(
        pad, pad.start, pad_cavities, radius=0.001, wall=0.002, chord=CHORD, sides=["high y", "low y"]
    )
    assert [port.side for port in along_y] == ["low y", "high y", "low y", "high y"]
    level = nearest_ports(pad, pad.start, pad_cavities, radius=0.001, wall=0.002, chord=CHORD, level=0.008)
    assert all(port.start is not None and port.start[2] == 0.008 for port in level)


def test_a_cavity_without_a_way_out_says_why(pad, pad_cavities) -> None:
    with pytest.raises(MeshError, match="cavity 0 has no way out: .* cavity 2"):
        nearest_ports(pad, pad.start, pad_cavities, radius=0.001, wall=0.002, chord=CHORD, sides=["high x"])


def test_a_rod_that_meets_or_passes_another_cavity_is_refused(pad, pad_cavities) -> None:
    def check(port, wall=0.002):
        rod = placed(pad, pad.start, port, beyond=0.006)
        check_rods(pad, [rod], pad_cavities, wall=wall, chord=CHORD)

    with pytest.raises(MeshError, match="rod of cavity 0 to high x meets cavity 2"):
        check(Port(0, "high x", 0.001))
    # Between two cavities, 6 mm apart, there are 2 mm on both sides of a rod of 2 mm, less the fillets' room.
    beside = Port(0, "high x", 0.001, (-0.017, -0.0055, 0.009))
    with pytest.raises(MeshError, match="meets cavity 2"):
        check(beside)
    check(Port(0, "low x", 0.001))
    near = Port(0, "low y", 0.001, (-0.0045, -0.017, 0.009))
    check(near, wall=0.006)
    with pytest.raises(MeshError, match=r"comes within 6\.5 mm of cavity 2"):
        check(near, wall=0.0066)


def test_a_rod_near_a_face_or_thicker_than_its_cavity_is_refused(pad, pad_cavities) -> None:
    def check(port, wall):
        rod = placed(pad, pad.start, port, beyond=0.006)
        check_rods(pad, [rod], pad_cavities, wall=wall, chord=CHORD)

    with pytest.raises(MeshError, match="lies 8 mm from low z"):
        check(Port(0, "low x", 0.001), 0.0081)
    with pytest.raises(MeshError, match="does not begin inside it"):
        check(Port(0, "low x", 0.0032), 0.002)
    with pytest.raises(MeshError, match="does not begin inside it"):
        check(Port(0, "low x", 0.001, (-0.017, -0.017, 0.0115)), 0.002)
    with pytest.raises(MeshError, match="outside the block"):
        check(Port(0, "low x", 0.001, (-0.05, -0.017, 0.009)), 0.002)


def test_rods_that_come_near_each_other_are_refused(pad, pad_cavities) -> None:
    starts = ((-0.017, -0.017, 0.009), (-0.017, -0.012, 0.009))
    rods = [placed(pad, pad.start, Port(0, "low x", 0.001, at), beyond=0.006) for at in starts]
    check_rods(pad, rods, pad_cavities, wall=0.0029, chord=CHORD)
    with pytest.raises(MeshError, match=r"come nearer to each other than 3\.1 mm"):
        check_rods(pad, rods, pad_cavities, wall=0.0031, chord=CHORD)


def test_a_rod_leaves_through_a_notch_that_is_open_to_the_side() -> None:
    layout = with_notch([0.01, -0.01, 0.005], [0.02, 0.01, 0.02])
    rod = placed(layout, layout.start, Port(0, "high x", 0.001), beyond=0.004)
    assert (rod.inside, rod.notch) == (pytest.approx(0.01), 0)
    cavities = cavity_solids(layout, layout.start, CHORD)
    check_rods(layout, [rod], cavities, wall=0.002, chord=CHORD)


def test_a_rod_over_the_edge_of_a_notch_is_refused() -> None:
    layout = with_notch([0.01, -0.01, 0.0078], [0.02, 0.01, 0.02])
    port = Port(0, "high x", 0.001, (0.0, 0.0, 0.0085))
    rod = placed(layout, layout.start, port, beyond=0.004)
    with pytest.raises(MeshError, match="over the edge of notch 0"):
        check_rods(layout, [rod], cavity_solids(layout, layout.start, CHORD), wall=0.001, chord=CHORD)


def test_a_rod_through_a_notch_into_the_body_again_is_refused() -> None:
    layout = with_notch([0.01, -0.01, 0.005], [0.015, 0.01, 0.02])
    with pytest.raises(MeshError, match="passes notch 0 and enters the body again"):
        placed(layout, layout.start, Port(0, "high x", 0.001), beyond=0.004)


def test_a_rod_that_passes_near_a_notch_is_refused() -> None:
    layout = with_notch([0.01, -0.01, 0.012], [0.015, 0.01, 0.02])
    cavities = cavity_solids(layout, layout.start, CHORD)
    rod = placed(layout, layout.start, Port(0, "high x", 0.001), beyond=0.004)
    check_rods(layout, [rod], cavities, wall=0.001, chord=CHORD)
    with pytest.raises(MeshError, match="nearer to notch 0"):
        check_rods(layout, [rod], cavities, wall=0.0011, chord=CHORD)
    other = placed(layout, layout.start, Port(0, "low x", 0.001), beyond=0.004)
    check_rods(layout, [other], cavities, wall=0.002, chord=CHORD)


def test_ports_that_make_no_sense_are_refused(pad) -> None:
    for port, beyond, message in (
        (Port(4, "low x", 0.001), 0.006, "does not exist"),
        (Port(0, "left", 0.001), 0.006, "no side 'left'"),
        (Port(0, "low x", 0.0), 0.006, "must be positive"),
        (Port(0, "low x", 0.001), 0.0, "must be positive"),
    ):
        with pytest.raises(SoftfuseError, match=message):
            placed(pad, pad.start, port, beyond=beyond)
