"""The parts of a mould clear what lies in them, come off along z, and fit each other with their room."""

from dataclasses import replace

import numpy as np
import pytest

from softfuse.design.casting import Casting, casting, cavity_solids
from softfuse.design.casting_check import checked_solids
from softfuse.design.mould import MouldShape, mould
from softfuse.design.port import Port, nearest_ports
from softfuse.errors import MeshError, SoftfuseError
from softfuse.mesh.block import NO_BOXES, Block
from softfuse.mesh.finger import FingerGeometry
from softfuse.robot.layout.cavity_shape import CavityShape
from softfuse.robot.layout.layout import TiedLayout
from softfuse.robot.layout.profile import RoundedBox

CHORD = 20e-6
SHAPE = MouldShape(
    thickness=0.008,
    pin_radius=0.002,
    pin_length=0.004,
    pin_room=0.0001,
    rod_room=0.0001,
    filled_at=(-0.01, 0.0),
    filling_radius=0.003,
    vented_at=(0.01, 0.0),
    vent_radius=0.001,
)


def cast_of(low, high, notches=(), *, side="low y", start=None) -> Casting:
    """A cavity of 6 mm in the middle of a block between corners in m, with notches."""
    boxes = np.array(notches, float).reshape(-1, 2, 3)
    outline = Block(np.array(low, float), np.array(high, float), NO_BOXES, boxes, ((), (), ()))
    centre = dict(zip("xyz", (0.5 * (outline.low + outline.high)).tolist(), strict=True))
    halves = {name: 0.003 for name in ("half x", "half y", "half z")}
    layout = TiedLayout.of(outline, [(CavityShape(RoundedBox()), {**centre, **halves, "fillet": 0.001})], [])
    port = Port(0, side, 0.001, start)
    return casting(layout, layout.start, [port], beyond=0.006, wall=0.001, chord=CHORD)


BLOCK = ([-0.02, -0.01, 0.0], [0.02, 0.01, 0.02])


@pytest.fixture(scope="module")
def finger_cast() -> Casting:
    """The finger with three notches below its necks, and six cavities."""
    centres = tuple((x, y, 0.0125) for x in (0.03, 0.06, 0.09) for y in (0.005, -0.005))
    finger = FingerGeometry(
        (0.12, 0.02, 0.02), (0.03, 0.06, 0.09), 0.012, 0.015, (0.008, 0.006, 0.01), centres
    )
    halves = {"half x": 0.004, "half y": 0.003, "half z": 0.005, "fillet": 0.001}
    cavities = [
        (CavityShape(RoundedBox()), {**dict(zip("xyz", at, strict=True)), **halves}) for at in centres
    ]
    layout = TiedLayout.of(finger.block(), cavities, [])
    solids = cavity_solids(layout, layout.start, CHORD)
    ports = nearest_ports(layout, layout.start, solids, radius=0.001, wall=0.001, chord=CHORD)
    return casting(layout, layout.start, ports, beyond=0.006, wall=0.001, chord=CHORD)


@pytest.fixture(scope="module", params=["pad", "finger"])
def made(request, pad_cast, finger_cast):
    """A casting and its mould."""
    if request.param == "pad":
        return pad_cast, mould(pad_cast, SHAPE)
    return finger_cast, mould(finger_cast, replace(SHAPE, filled_at=(0.1, 0.0), vented_at=(0.015, 0.0)))


def test_the_solids_are_as_expected_and_clear_each_other(made) -> None:
    cast, parts = made
    table = {line.name: line for line in checked_solids(cast, parts)}
    assert (table["mould_lower"].genus, table["mould_upper"].genus) == (0, 2)
    assert parts.parting == pytest.approx(cast.rods[0].start[2])


def test_the_mould_is_the_shell_less_the_body(made) -> None:
    cast, parts = made
    outline = cast.outline
    shell = np.prod(outline.high - outline.low + 2.0 * SHAPE.thickness)
    body = np.prod(outline.high - outline.low) - np.ptp(outline.notches, axis=1).prod(axis=1).sum()
    room = 2.0 * SHAPE.rod_room
    # Channels, holes, pins and their holes.
    channels = len(cast.rods) * (np.pi * 0.0011**2 * 0.003 + (0.0016 + room) ** 2 * 0.0031)
    openings = np.pi * (SHAPE.filling_radius**2 + SHAPE.vent_radius**2) * SHAPE.thickness
    between = 3.0 * np.pi * (0.0021**2 * 0.0041 - 0.002**2 * 0.004)
    volume = parts.lower.volume() + parts.upper.volume()
    assert volume == pytest.approx(shell - body - channels - openings - between, abs=1.5e-8)


def test_the_parts_come_off_along_z(made) -> None:
    cast, parts = made
    inside = cast.body_with_ports
    for core in cast.cores:
        inside = inside + core
    for part, sign in ((parts.lower, -1.0), (parts.upper, 1.0)):
        for way in np.geomspace(1e-4, 0.03, 12):
            moved = part.translate((0.0, 0.0, float(sign * way)))
            assert (moved ^ inside).volume() < 1e-15
    for way in np.geomspace(1e-4, 0.03, 12):
        assert (parts.upper.translate((0.0, 0.0, float(way))) ^ parts.lower).volume() < 1e-15


def test_pins_fit_their_holes_with_the_room(made) -> None:
    cast, parts = made
    low, high = cast.outline.low - 0.004, cast.outline.high + 0.004
    corners = ((low[0], low[1]), (high[0], low[1]), (low[0], high[1]))
    raised = parts.lower.trim_by_plane((0.0, 0.0, 1.0), parts.parting + 1e-4)
    assert len(raised.decompose()) == 3
    for (x, y), pin in zip(corners, sorted(raised.decompose(), key=_place), strict=True):
        box = np.reshape(pin.bounding_box(), (2, 3))
        np.testing.assert_allclose(box.mean(axis=0)[:2], (x, y), atol=1e-12)
        assert box[1, 2] == pytest.approx(parts.parting + SHAPE.pin_length)
        gap = pin.min_gap(parts.upper, 0.001)
        assert gap == pytest.approx(SHAPE.pin_room, rel=0.03)
    # Turned by half a turn, the upper part does not go on.
    middle = 0.5 * (cast.outline.low + cast.outline.high)
    turned = parts.upper.translate(tuple((-middle).tolist())).rotate((0.0, 0.0, 180.0))
    assert (turned.translate(tuple(middle.tolist())) ^ parts.lower).volume() > 1e-9


def _place(pin) -> tuple[float, float]:
    low = pin.bounding_box()
    return (low[1], low[0]) if low[1] < -0.012 else (1.0, low[0])


def test_rods_have_their_room_in_the_channels(made) -> None:
    cast, parts = made
    for rod in cast.rods:
        out = rod.solid(CHORD)
        axis = int(np.argmax(np.abs(rod.direction)))
        reach = (rod.start + (rod.inside + 1e-4) * rod.direction)[axis]
        outside = out.trim_by_plane(tuple(rod.direction.tolist()), float(rod.direction[axis] * reach))
        for part in (parts.lower, parts.upper):
            assert outside.min_gap(part, 0.001) == pytest.approx(SHAPE.rod_room, rel=0.03)


def test_notches_at_the_sides_are_undercuts_that_are_named() -> None:
    side = [[-0.004, -0.01, 0.004], [0.004, -0.006, 0.008]]
    bottom = [[-0.018, -0.01, 0.0], [-0.012, 0.01, 0.004]]
    shape = replace(SHAPE, filled_at=(0.012, 0.0), vented_at=(-0.015, 0.0))
    checked_solids(*_with_mould(cast_of(*BLOCK, [bottom], side="high y"), shape))
    with pytest.raises(MeshError, match="notch 1 is an undercut of the mould's lower part"):
        mould(cast_of(*BLOCK, [bottom, side], side="high y"), shape)
    above = [[-0.004, -0.01, 0.012], [0.004, -0.006, 0.016]]
    with pytest.raises(MeshError, match="notch 0 is an undercut of the mould's upper part"):
        mould(cast_of(*BLOCK, [above], side="high y"), shape)
    # What is split by the plane is an undercut of both.
    across = [[-0.004, -0.01, 0.008], [0.004, -0.006, 0.012]]
    with pytest.raises(MeshError, match="undercut of the mould's lower part"):
        mould(cast_of(*BLOCK, [across], side="high y"), shape)


def _with_mould(cast, shape, **options):
    return cast, mould(cast, shape, **options)


def test_notches_that_together_are_open_are_none() -> None:
    wide = [[-0.006, -0.01, 0.0], [0.006, -0.005, 0.004]]
    narrow = [[-0.004, -0.01, 0.004], [0.004, -0.005, 0.008]]
    checked_solids(*_with_mould(cast_of(*BLOCK, [wide, narrow], side="high y"), SHAPE))


def test_a_notch_that_ends_in_the_parting_plane_or_goes_through_is_made() -> None:
    shape = replace(SHAPE, filled_at=(0.008, 0.0), vented_at=(-0.008, 0.0))
    half = [[0.012, -0.01, 0.0], [0.02, 0.01, 0.01]]
    checked_solids(*_with_mould(cast_of(*BLOCK, [half]), shape))
    through = [[0.012, -0.004, 0.0], [0.016, 0.004, 0.02]]
    checked_solids(*_with_mould(cast_of(*BLOCK, [through]), shape))


def test_a_rod_along_z_comes_off_with_its_part() -> None:
    shape = replace(SHAPE, filled_at=(0.008, 0.0), vented_at=(-0.008, 0.0))
    cast = cast_of(*BLOCK, side="low z")
    with pytest.raises(SoftfuseError, match="no rod lies in a plane z"):
        mould(cast, shape)
    parts = mould(cast, shape, parting=0.012)
    checked_solids(cast, parts)
    assert parts.lower_holes == 0
    # A rod that ends in the shell's face leads through it, without a skin.
    thin = mould(cast, replace(shape, thickness=0.0061, pin_radius=0.001), parting=0.012)
    assert {line.name: line.genus for line in checked_solids(cast, thin)}["mould_lower"] == 1


def test_rods_at_different_levels_are_refused() -> None:
    cast = cast_of(*BLOCK)
    low = replace(cast.rods[0], start=cast.rods[0].start - np.array([0.0, 0.0, 0.001]))
    with pytest.raises(MeshError, match=r"lies at z = 9 mm, the mould is parted at 10 mm"):
        mould(replace(cast, rods=(*cast.rods, low)), SHAPE)
    with pytest.raises(MeshError, match=r"lies at z = 10 mm, the mould is parted at 11 mm"):
        mould(cast, SHAPE, parting=0.011)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"thickness": 0.0}, "thickness is 0 m"),
        ({"rod_room": -1e-4}, "must not be negative"),
        ({"pin_radius": 0.0026}, "at most 2.57 mm"),
        ({"pin_length": 0.02}, "come through the upper part"),
        ({"filled_at": (0.018, 0.0)}, "filling hole at .* does not open"),
        ({"vented_at": (-0.012, 0.0)}, "the vent meet"),
    ],
)
def test_a_shape_that_does_not_fit_is_refused(changes, message) -> None:
    with pytest.raises(SoftfuseError, match=message):
        mould(cast_of(*BLOCK), replace(SHAPE, **changes))


def test_a_hole_over_a_notch_or_a_rod_is_refused() -> None:
    notch = [[-0.016, -0.01, 0.016], [-0.009, 0.01, 0.02]]
    with pytest.raises(MeshError, match="filling hole .* does not open"):
        mould(cast_of(*BLOCK, [notch]), SHAPE)
    over = replace(SHAPE, vented_at=(0.0, 0.0))
    with pytest.raises(MeshError, match="the vent meets the rod of core 0"):
        mould(cast_of(*BLOCK, side="high z"), over, parting=0.01)


def test_a_plane_beside_the_block_is_refused() -> None:
    with pytest.raises(SoftfuseError, match="one part only"):
        mould(cast_of(*BLOCK, side="low z"), SHAPE, parting=0.02)


def test_parts_that_overlap_are_refused(pad_cast) -> None:
    parts = mould(pad_cast, SHAPE)
    low = replace(parts, upper=parts.upper.translate((0.0, 0.0, -0.0005)))
    with pytest.raises(MeshError, match="overlap by"):
        checked_solids(pad_cast, low)
