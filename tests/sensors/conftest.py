"""A small block with everything that sensors may be attached to."""

import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body import LINEAR, Body, mesh_for
from softfuse.functional.cavity import Cavity
from softfuse.functional.chart import FlatChart
from softfuse.material import NeoHookean
from softfuse.mesh.pad import PadGeometry, pad_mesh
from softfuse.mesh.surface import cavities, outer_surface
from softfuse.sensors.parts import CablePart, ChamberPart, ContactPart, Parts

MM = 1e-3


@pytest.fixture(scope="session")
def parts() -> Parts:
    """A block of 70 × 40 × 18 mm with two cavities, each of which is vented, sealed or driven, as it is
    named.
    """
    size = (70 * MM, 40 * MM, 18 * MM)
    geometry = PadGeometry(size, (26 * MM, 28 * MM, 6 * MM), ((-17 * MM, 0.0), (17 * MM, 0.0)), 6 * MM)
    mesh = mesh_for(LINEAR, pad_mesh(geometry, 40 * MM, 40 * MM))
    body = Body.from_mesh(mesh, [NeoHookean.from_young(0.6e6, 0.3)], mesh.nodes[:, 2] < 1e-9, element=LINEAR)
    left, right = (Cavity(jnp.asarray(wall.faces)) for wall in cavities(mesh, geometry.centres()))
    low, high = np.array([[-32.0, -18.0], [32.0, 18.0]]) * MM
    down = FlatChart.along(np.array([0.0, 0.0, -1.0]))
    return Parts(
        body,
        outer_surface(mesh).faces,
        {
            "left": ChamberPart(left),
            "right": ChamberPart(right),
            "sealed": ChamberPart(left, 0, sealed=True, rest_volume=4e-6, dead_volume=1e-6),
            "driven": ChamberPart(right, 1),
        },
        {"one": CablePart(2, 0), "other": CablePart(3, 1)},
        {"top": ContactPart(down, 10 * MM, 1, low, high), "skin": ContactPart(None, 5 * MM, 1)},
        {"tip": np.array([0.0, 0.0, 15.0]) * MM},
    )
