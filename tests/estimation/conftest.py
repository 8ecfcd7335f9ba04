"""A small device of two cavities, and volumes that a known force changes."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body import LINEAR, TAYLOR_HOOD, Body, mesh_for
from softfuse.body.element import Element
from softfuse.equilibrium.dense import Dense
from softfuse.equilibrium.linear_solver import AbstractLinearSolver
from softfuse.equilibrium.multifrontal import Multifrontal
from softfuse.equilibrium.punch import PunchContact
from softfuse.estimation.device import Device, simulate
from softfuse.estimation.limits import Limits
from softfuse.functional import Cavity
from softfuse.functional.contact import Contact, ContactSurface
from softfuse.functional.pressure_cells import flat_punch
from softfuse.material import NeoHookean
from softfuse.mesh.pad import PadGeometry, pad_mesh
from softfuse.mesh.surface import cavities, outer_surface

MM = 1e-3


def two_cavity_device(element: Element, solver: type[AbstractLinearSolver], poisson: float) -> Device:
    """A block of 70 × 40 × 18 mm over two cavities, some hundred nodes, pressed by a punch of 8 mm."""
    geometry = PadGeometry(
        (70 * MM, 40 * MM, 18 * MM), (26 * MM, 28 * MM, 6 * MM), ((-17 * MM, 0.0), (17 * MM, 0.0)), 6 * MM
    )
    mesh = mesh_for(element, pad_mesh(geometry, 40 * MM, 40 * MM))
    law = NeoHookean.from_young(0.6e6, poisson)
    body = Body.from_mesh(mesh, [law], mesh.nodes[:, 2] < 1e-9, element=element)
    faces = outer_surface(mesh).faces
    surface = ContactSurface.facing(faces, mesh.nodes, np.array([0.0, 0.0, -1.0]))
    contact = Contact(surface, flat_punch((0.7, 1.0), (3, 6)), jnp.zeros(3), jnp.asarray(8 * MM))
    inner = tuple(Cavity(jnp.asarray(s.faces)) for s in cavities(mesh, geometry.centres()))
    return Device(body, inner, PunchContact(contact), solver.plan(body))


@pytest.fixture(scope="session")
def device() -> Device:
    """The small device as it is used: Taylor-Hood, nearly incompressible, multifrontal solver."""
    return two_cavity_device(TAYLOR_HOOD, Multifrontal, 0.49)


@pytest.fixture(scope="session")
def plain_device() -> Device:
    """The small device with linear elements and a dense solver, which compile in no time."""
    return two_cavity_device(LINEAR, Dense, 0.3)


@pytest.fixture(scope="session")
def volumes_under():
    """volumes_under(device, locations, force): volume changes (k,) at the equilibrium, compiled once."""
    return eqx.filter_jit(lambda d, at, force: d.reading(simulate(d, at, force).state))


@pytest.fixture(scope="session")
def one() -> Limits:
    """Limits of one contact."""
    return Limits(jnp.zeros(1), jnp.array([25.0]), jnp.array([1e-6]))
