"""From settings to a device that can be simulated and estimated."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from softfuse.body.body import Body
from softfuse.body.element import ELEMENTS
from softfuse.config.build_material import build_materials
from softfuse.config.build_mesh import DeviceMesh, build_mesh
from softfuse.config.device import DeviceConfig
from softfuse.equilibrium.multifrontal import Multifrontal
from softfuse.equilibrium.punch import PunchContact
from softfuse.errors import ConfigError
from softfuse.estimation.device import Device
from softfuse.estimation.estimator import StepSettings
from softfuse.estimation.limits import Limits
from softfuse.functional.cavity import Cavity
from softfuse.functional.contact import Contact, ContactSurface
from softfuse.functional.pressure_cells import flat_punch, uniform
from softfuse.mesh.surface import outer_surface

CONTACT_MODELS = {"punch": flat_punch, "uniform": uniform}
"""Pressure cells of each contact model that a config may name."""



def build_device(config: DeviceConfig, mesh: DeviceMesh | None = None) -> Device:
    """The device of a config, on its own mesh or one that was built before.

    Raises ConfigError when the config has no contact, MeshError when the mesh is not fit for it.
    """
    if config.contact is None:
        raise ConfigError(f"{config.path}: contact: missing, needed to press on the device")
    mesh = build_mesh(config) if mesh is None else mesh
    body = Body.from_mesh(
        mesh.mesh,
        build_materials(config),
        mesh.fixed,
        element=ELEMENTS[config.body.element],
        densities=[material.density for material in config.body.materials],
        gravity=config.body.gravity,
    )
    surface = ContactSurface.facing(
        outer_surface(mesh.mesh).faces, mesh.mesh.nodes, np.array(config.contact.direction)
    )
    contact = Contact(
        surface, CONTACT_MODELS[config.contact.model](), jnp.zeros(3), jnp.asarray(config.contact.radius)
    )
    cavities = tuple(Cavity(jnp.asarray(cavity.faces)) for cavity in mesh.cavities)
    return Device(body, cavities, PunchContact(contact), Multifrontal.plan(body))


def with_contact_model(device: Device, model: str) -> Device:
    """The same device pressed by another contact model, "punch" or "uniform"."""
    return eqx.tree_at(lambda d: d.contact.disc.cells, device, CONTACT_MODELS[model]())


def build_limits(config: DeviceConfig, contacts: int) -> Limits:
    """Bounds and regularisation of the estimate with so many contacts."""
    if config.contact is None:
        raise ConfigError(f"{config.path}: contact: missing, its max_force bounds the estimate")
    return Limits(
        jnp.zeros(contacts),
        jnp.full(contacts, config.contact.max_force),
        jnp.full(contacts, config.estimator.regularisation),
    )


def build_step_settings(config: DeviceConfig) -> StepSettings:
    """How the estimate steps are run."""
    return StepSettings(steps_per_frame=config.estimator.steps_per_frame)
