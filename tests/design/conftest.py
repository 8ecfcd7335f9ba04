"""A block over two cavities that are mirror images, with a parameter of every kind."""

from collections.abc import Callable

import numpy as np
import pytest

from softfuse.design.casting import Casting, casting, cavity_solids
from softfuse.design.port import nearest_ports
from softfuse.mesh.block import Fineness, finer_to_the_top
from softfuse.mesh.pad import PadGeometry
from softfuse.robot.layout.cavity_shape import CavityShape
from softfuse.robot.layout.layout import Parameter, TiedLayout
from softfuse.robot.layout.layout_mesh import LayoutMesh, layout_mesh
from softfuse.robot.layout.profile import AbstractProfile, RoundedBox

BLOCK = PadGeometry((0.07, 0.04, 0.018), (0.026, 0.028, 0.006), ((-0.017, 0.0), (0.017, 0.0)), 0.006).block()
FINENESS = Fineness(0.02, finer_to_the_top(0.018, 0.02))


def both(*names: str, left: float = 1.0) -> dict[tuple[int, str], float]:
    """What a parameter adds to the left cavity, 1 or −1, and to the right one."""
    return {(k, name): amount for name in names for k, amount in ((0, left), (1, 1.0))}


def twin_layout(profile: AbstractProfile, **shape: float) -> TiedLayout:
    """Two cavities as in BLOCK, with a profile and its values by name."""
    kind = CavityShape(profile)
    place = {"y": 0.0, "z": 0.009, "half x": 0.013, "half y": 0.014, "half z": 0.003}
    cavities = [(kind, {"x": x, **place, **shape}) for x in (-0.017, 0.017)]
    parameters = [
        Parameter("distance", 0.017, 0.015, 0.02, adds=both("x", left=-1.0)),
        Parameter("width", 0.013, 0.008, 0.016, adds=both("half x")),
        Parameter("half height", 0.003, 0.001, 0.004, adds=both("half z")),
        Parameter("level", 0.009, 0.004, 0.014, adds=both("z")),
        Parameter("turn", 0.0, -0.3, 0.3, "rad", adds=both("turn z", left=-1.0)),
        *(
            Parameter(name, value, value - 0.05, value + 0.05, "1", 0.02 * abs(value) + 1e-4, both(name))
            for name, value in shape.items()
        ),
    ]
    return TiedLayout.of(BLOCK, cavities, parameters)


@pytest.fixture(scope="session")
def layout_like() -> Callable[..., TiedLayout]:
    """layout_like(profile, name=value, ...): two cavities with a profile and its values."""
    return twin_layout


@pytest.fixture(scope="session")
def fineness() -> Fineness:
    """Of meshes with some thousand nodes."""
    return FINENESS


@pytest.fixture(scope="session")
def twins() -> TiedLayout:
    """Boxes with fillets of 1 mm."""
    return twin_layout(RoundedBox(), fillet=0.001)


@pytest.fixture(scope="session")
def twin_mesh(twins: TiedLayout) -> LayoutMesh:
    """Some thousand nodes."""
    return layout_mesh(twins, twins.start, FINENESS)


@pytest.fixture(scope="session")
def pad() -> TiedLayout:
    """The pad's four cavities, with fillets of 1 mm, one parameter for their half-widths along x."""
    places = [(x, y) for x in (-0.017, 0.017) for y in (-0.017, 0.017)]
    block = PadGeometry((0.08, 0.08, 0.018), (0.028, 0.028, 0.006), tuple(places), 0.006).block()
    size = {"z": 0.009, "half x": 0.014, "half y": 0.014, "half z": 0.003, "fillet": 0.001}
    cavities = [(CavityShape(RoundedBox()), {"x": x, "y": y, **size}) for x, y in places]
    widths = {(k, "half x"): 1.0 for k in range(4)}
    return TiedLayout.of(block, cavities, [Parameter("width", 0.014, 0.01, 0.016, adds=widths)])


@pytest.fixture(scope="session")
def pad_cast(pad: TiedLayout) -> Casting:
    """The pad with rods of 1 mm radius that reach 6 mm out, curves within 20 µm."""
    cavities = cavity_solids(pad, pad.start, 20e-6)
    ports = nearest_ports(pad, pad.start, cavities, radius=0.001, wall=0.002, chord=20e-6)
    return casting(pad, pad.start, ports, beyond=0.006, wall=0.002, chord=20e-6)


@pytest.fixture
def changed(twins: TiedLayout) -> np.ndarray:
    """θ (p,), everything a little different."""
    return twins.start + 0.5 * twins.scale * np.cos(1.0 + np.arange(len(twins.names)))
