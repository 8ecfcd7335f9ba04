"""From settings to a device that can be simulated and estimated."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from softfuse.body.body import Body
from softfuse.body.element import ELEMENTS
from softfuse.body.stiffness_field import with_field
from softfuse.config.build_attached import build_attached
from softfuse.config.build_material import build_materials
from softfuse.config.build_mesh import DeviceMesh, build_mesh
from softfuse.config.contact import PatchSettings, PunchSettings, UniformSettings
from softfuse.config.device import DeviceConfig
from softfuse.errors import ConfigError
from softfuse.estimation.device import Device
from softfuse.estimation.estimator import StepSettings
from softfuse.estimation.limits import Limits, Rates
from softfuse.functional.cavity import Cavity
from softfuse.mechanics.load import Loads
from softfuse.mechanics.multifrontal import Multifrontal
from softfuse.mechanics.patch import PatchContact
from softfuse.mechanics.punch import PunchContact
from softfuse.mesh.surface import outer_surface

CONTACT_MODELS = {"punch": PunchSettings.cells, "uniform": UniformSettings.cells}
"""Pressure cells of each disc that a contact may be."""


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
    if config.body.stiffness_field.some:
        body = with_field(body, jnp.array(config.body.stiffness_field.coefficients))
    faces = outer_surface(mesh.mesh).faces
    contact = config.contact.contact(faces, mesh.mesh.nodes, config.electrodes)
    if isinstance(contact, PatchContact):
        _check_electrodes(config, contact, body)
    cavities = tuple(Cavity.of(cavity.faces) for cavity in mesh.cavities)
    attached = build_attached(config, body, cavities)
    vented = cavities if config.gas is None else ()
    gauges = tuple(range(Loads(attached).sizes.drives))
    return Device(body, vented, contact, Multifrontal.plan(body), attached, gauges)


def _check_electrodes(config: DeviceConfig, contact: PatchContact, body: Body) -> None:
    def landed(place):
        patches = contact.at(place)
        middles = jnp.stack([patch.location for patch in patches])
        on = patches[0].surface.land(body.rest, middles)
        apart = jnp.linalg.norm(jnp.einsum("ps,psi->pi", on.shape, body.rest[on.nodes]) - middles, axis=1)
        return jnp.all(on.met & (apart <= contact.radius))

    on_surface = np.asarray(jax.vmap(landed)(jnp.arange(len(config.electrodes))))
    if not on_surface.all():
        k = int(np.argmin(on_surface))
        raise ConfigError(
            f'{config.path}: electrode[{k}].centre: "{config.electrodes[k].name}" is not within '
            "contact.radius of where its direction enters the body: move it onto the surface, or turn the "
            "direction"
        )


def with_contact_model(device: Device, model: str) -> Device:
    """The same device pressed by another disc, "punch" or "uniform".

    Raises ConfigError when it is pressed by patches.
    """
    if not isinstance(device.contact, PunchContact):
        raise ConfigError(f'contact.model: a device that is pressed by a "patch" has no "{model}"')
    return eqx.tree_at(lambda d: d.contact.disc.cells, device, CONTACT_MODELS[model]())


def build_limits(config: DeviceConfig, contacts: int) -> Limits:
    """Bounds and regularisation of the estimate with the forces of so many contacts, then cables, then sealed
    cavities.

    Forces lie between 0 and max_force, tensions between 0 and max_tension; the gas that was sealed in stays.
    """
    if config.contact is None:
        raise ConfigError(f"{config.path}: contact: missing, its max_force bounds the estimate")
    forces = contacts * config.contact.forces(config.electrodes)
    upper = [config.contact.max_force] * forces + [cable.max_tension for cable in config.cables]
    lower = [0.0] * len(upper)
    damping = [config.estimator.regularisation] * len(upper)
    if config.gas is not None:
        filling = [config.gas.atmosphere] * len(config.cavities)
        lower, upper = lower + filling, upper + filling
        # Like SealedGas, count a thousandth of the atmosphere as a newton.
        damping += [config.estimator.regularisation / (1e-3 * pascal) ** 2 for pascal in filling]
    motion = config.estimator.largest_motion
    place = config.contact.place_sigma if isinstance(config.contact, PatchSettings) else None
    return Limits(
        jnp.array(lower, float),
        jnp.array(upper, float),
        jnp.array(damping, float),
        motion=None if motion is None else jnp.asarray(motion),
        place=None if place is None else jnp.asarray(place),
    )


def build_rates(config: DeviceConfig, contacts: int) -> Rates:
    """How fast the drives of `build_limits` and what answers them may change: limited for cables only."""
    if config.contact is None:
        raise ConfigError(f"{config.path}: contact: missing, needed to know the drives of the estimate")
    before = [np.inf] * (contacts * config.contact.forces(config.electrodes))
    after = [np.inf] * (0 if config.gas is None else len(config.cavities))
    tension = [np.inf if cable.tension_rate is None else cable.tension_rate for cable in config.cables]
    length = [np.inf if cable.length_rate is None else cable.length_rate for cable in config.cables]
    return Rates(*(jnp.array([*before, *cables, *after], float) for cables in (tension, length)))


def build_step_settings(config: DeviceConfig) -> StepSettings:
    """How the estimate steps are run."""
    given = config.estimator
    return StepSettings(steps_per_frame=given.steps_per_frame, catch_up_steps=given.catch_up_steps)
