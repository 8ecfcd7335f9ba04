"""A small device of two cavities, and volumes that a known force changes."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body import TAYLOR_HOOD, Body
from softfuse.equilibrium.multifrontal import Multifrontal
from softfuse.estimation.device import Device, simulate
from softfuse.estimation.step import Limits
from softfuse.functional import Cavity
from softfuse.functional.contact import Contact, ContactSurface
from softfuse.functional.pressure_cells import flat_punch
from softfuse.material import NeoHookean
from softfuse.mesh.pad import PadGeometry, pad_mesh
from softfuse.mesh.surface import cavities, outer_surface
from softfuse.mesh.tetmesh import quadratic

MM = 1e-3


def two_cavity_device(young: float = 0.6e6) -> Device:
    """A block of 70 × 40 × 18 mm over two cavities, some hundred nodes, pressed by a punch of 8 mm."""
    geometry = PadGeometry(
        (70 * MM, 40 * MM, 18 * MM), (26 * MM, 28 * MM, 6 * MM), ((-17 * MM, 0.0), (17 * MM, 0.0)), 6 * MM
    )
    mesh = quadratic(pad_mesh(geometry, 40 * MM, 40 * MM))
    body = Body.from_mesh(
        mesh, [NeoHookean.from_young(young, 0.49)], mesh.nodes[:, 2] < 1e-9, element=TAYLOR_HOOD
    )
    faces = outer_surface(mesh).faces
    surface = ContactSurface.facing(faces, mesh.nodes, np.array([0.0, 0.0, -1.0]))
    contact = Contact(surface, flat_punch((0.7, 1.0), (3, 6)), jnp.zeros(3), jnp.asarray(8 * MM))
    inner = tuple(Cavity(jnp.asarray(s.faces)) for s in cavities(mesh, geometry.centres()))
    return Device(body, inner, contact, Multifrontal.plan(body))


@pytest.fixture(scope="session")
def device() -> Device:
    """The small device."""
    return two_cavity_device()


@pytest.fixture(scope="session")
def volumes_under():
    """volumes_under(device, locations, force): volume changes (k,) at the equilibrium, compiled once."""
    return eqx.filter_jit(lambda d, at, force: d.volume_change(simulate(d, at, force).state.z))


@pytest.fixture(scope="session")
def one() -> Limits:
    """Limits of one contact."""
    return Limits(jnp.array([25.0]), jnp.asarray(1e-6))
