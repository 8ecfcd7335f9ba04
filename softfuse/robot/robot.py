"""A robot built from its settings: mesh, mechanical model and sensors, and where everything with a name is.

Drives are ordered contacts first, then cables, sealed chambers, driven chambers, each in the order of the
file; readings are those of the sensors in their order. `Addresses` says which number is whose: nothing else
counts them.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from softfuse.body.body import Body
from softfuse.body.element import ELEMENTS
from softfuse.body.stiffness_field import with_field
from softfuse.errors import ConfigError
from softfuse.functional.cavity import Cavity
from softfuse.functional.chart import facing
from softfuse.functional.material_points import MaterialPoints
from softfuse.functional.workspace import AbstractWorkspace
from softfuse.mechanics.gas import SealedGas
from softfuse.mechanics.load import AbstractContact, AbstractLoad
from softfuse.mechanics.model import Model
from softfuse.mechanics.multifrontal import Multifrontal
from softfuse.mechanics.prescribed import PrescribedForce
from softfuse.mechanics.reading import AbstractReading
from softfuse.mechanics.volume import VolumePorts
from softfuse.mesh.surface import outer_surface
from softfuse.robot.mesh import RobotMesh, build_mesh
from softfuse.robot.points import surface_tolerance
from softfuse.robot.settings import RobotSettings
from softfuse.sensors.parts import CablePart, ChamberPart, ContactPart, Parts
from softfuse.sensors.suite import SensorSuite

_KILOPASCAL = 1e3
"""Typical size of a driven pressure."""


@dataclass(frozen=True)
class Addresses:
    """Numbers by name: `drives`, of each cable and chamber that is not vented, among the actuators' drives;
    `readings`, of each sensor, among all readings; `slots`, of each contact, among those followed at once.
    """

    drives: Mapping[str, int]
    readings: Mapping[str, slice]
    slots: Mapping[str, slice]


@dataclass(frozen=True)
class Command:
    """A column's value times `factor` [SI] is what drive number `drive` of the actuators is commanded to, or,
    `of_answer`, what answers it.
    """

    channel: str
    factor: float
    drive: int
    of_answer: bool


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot: its settings, mesh, model, sensors, and what these may be attached to; `workspaces`: where
    readings may find the contacts of each slot (c,), None where sensors alone say.
    """

    settings: RobotSettings
    mesh: RobotMesh
    parts: Parts
    model: Model
    suite: SensorSuite
    addresses: Addresses
    commands: tuple[Command, ...]
    workspaces: tuple[AbstractWorkspace | None, ...]

    @property
    def name(self) -> str:
        """What people call it."""
        return self.settings.robot.name

    @property
    def reading_kinds(self) -> Int[np.ndarray, " k"]:
        """Which sensor each reading (k,) is of: those of one have one unit."""
        kinds = np.zeros(self.model.n_readings, int)
        for number, own in enumerate(self.addresses.readings.values()):
            kinds[own] = number
        return kinds

    def by_reading(self, given: float | Mapping[str, float], otherwise: float) -> Float[np.ndarray, " k"]:
        """What is given of the sensor of each reading (k,), by its name, or of all; `otherwise` of others."""
        names = self.addresses.readings
        of = given if isinstance(given, Mapping) else dict.fromkeys(names, given)
        return np.array([of.get(name, otherwise) for name in names], float)[self.reading_kinds]

    @property
    def ranges(self) -> tuple[Float[np.ndarray, " a"], Float[np.ndarray, " a"]]:
        """The lowest and highest of what the actuators (a,) are driven with: tensions [N], the absolute
        pressure at rest of gas that is sealed in, driven gauge pressures [Pa].
        """
        low, high = np.zeros((2, len(self.addresses.drives)))
        for cable in self.settings.cables:
            high[self.addresses.drives[cable.name]] = cable.max_tension
        for chamber in self.settings.chambers:
            if chamber.gas == "sealed":
                at = self.addresses.drives[chamber.name]
                low[at] = high[at] = self.settings.environment.atmosphere
            elif chamber.gas == "driven":
                assert chamber.highest is not None  # its settings have told
                at = self.addresses.drives[chamber.name]
                low[at], high[at] = chamber.lowest, chamber.highest
        return low, high

    def shortened(self, cables: Collection[str]) -> tuple[AbstractLoad, ...]:
        """The actuators' loads, cables of some names driven by their shortening instead of their tension."""
        numbers = {self.parts.cables[name].load for name in cables}
        loads, body = enumerate(self.model.actuators), self.model.body
        return tuple(load.by_answer(body) if k in numbers else load for k, load in loads)

    def points(self) -> MaterialPoints:
        """Its named points, none or more; raises ConfigError for one outside the body."""
        with self.settings.told("point"):
            points = np.reshape([point.at for point in self.settings.points], (-1, 3))
            body = self.parts.body
            return MaterialPoints.embedded(body, points, within=surface_tolerance(body))

    def centreline(self) -> MaterialPoints | None:
        """The points of its centreline from base to tip, if it has one; raises ConfigError for one outside
        the body.
        """
        if self.settings.centreline is None:
            return None
        with self.settings.told("centreline.points"):
            points, body = np.array(self.settings.centreline.points), self.parts.body
            return MaterialPoints.embedded(body, points, within=surface_tolerance(body))

    @property
    def unseen(self) -> Bool[np.ndarray, " c"]:
        """Which contacts (c,) no sensor sees, so that readings alone tell of them."""
        seen = {sensor.contact for sensor in self.suite.contact_sensors}
        flags = np.ones(len(self.workspaces), bool)
        for name, slots in self.addresses.slots.items():
            flags[slots] = name not in seen
        return flags


def build_robot(settings: RobotSettings, mesh: RobotMesh | None = None) -> Robot:
    """The robot of its settings, on its own mesh or one that was built before.

    Raises ConfigError with the key's path where parts do not go together, MeshError when the mesh is not fit
    for it.
    """
    mesh = build_mesh(settings) if mesh is None else mesh
    body = _body(settings, mesh)
    faces = outer_surface(mesh.mesh).faces
    cavities = {
        chamber.name: Cavity.of(wall.faces)
        for chamber, wall in zip(settings.chambers, mesh.cavities, strict=True)
    }
    actuators, drives = _actuators(settings, body, cavities)
    rest = mesh.mesh.nodes
    slots, kinds, workspaces = _slots(settings, rest, faces)
    parts = Parts(
        body,
        faces,
        chambers={
            chamber.name: ChamberPart(
                cavities[chamber.name],
                drives.get(chamber.name),
                chamber.gas == "sealed",
                settings.environment.atmosphere,
                float(cavities[chamber.name](body.rest)),
                chamber.dead_volume,
                chamber.exponent,
            )
            for chamber in settings.chambers
        },
        cables={cable.name: CablePart(drives[cable.name], k) for k, cable in enumerate(settings.cables)},
        contacts={
            contact.name: ContactPart(
                contact.chart(faces, rest),
                contact.radius,
                contact.at_once,
                *contact.ranges,
                _somewhere(settings, workspaces[slots[contact.name].start], rest, faces),
            )
            for contact in settings.contacts
        },
        points={point.name: np.array(point.at) for point in settings.points},
        gravity=settings.environment.gravity,
        atmosphere=settings.environment.atmosphere,
    )
    suite, readings, numbers = _sensors(settings, parts)
    contacts = tuple(contact.contact(faces, rest) for contact in settings.contacts)
    _check_electrodes(settings, body, contacts)
    model = Model(body, readings, contacts, Multifrontal.plan(body), actuators, kinds)
    addresses = Addresses(drives, numbers, slots)
    return Robot(settings, mesh, parts, model, suite, addresses, _commands(settings, drives), workspaces)


def _body(settings: RobotSettings, mesh: RobotMesh) -> Body:
    body = Body.from_mesh(
        mesh.mesh,
        [material.material() for material in settings.body.materials],
        mesh.fixed,
        element=ELEMENTS[settings.body.element],
        densities=[material.density for material in settings.body.materials],
        gravity=settings.environment.gravity,
    )
    if settings.body.stiffness_field.some:
        body = with_field(body, jnp.array(settings.body.stiffness_field.coefficients))
    return body


def _actuators(
    settings: RobotSettings, body: Body, cavities: Mapping[str, Cavity]
) -> tuple[tuple[AbstractLoad, ...], dict[str, int]]:
    """The loads of cables, of sealed gas and of driven chambers, and the number of each drive."""
    loads: list[AbstractLoad] = []
    drives: dict[str, int] = {}
    for k, cable in enumerate(settings.cables):
        with settings.told(f"cable[{k}]"):
            loads.append(cable.load(body))
        drives[cable.name] = len(drives)
    atmosphere = settings.environment.atmosphere
    for exponent in sorted({chamber.exponent for chamber in settings.chambers if chamber.gas == "sealed"}):
        alike = [each for each in settings.chambers if each.gas == "sealed" and each.exponent == exponent]
        walls = tuple(cavities[chamber.name] for chamber in alike)
        dead = jnp.array([chamber.dead_volume for chamber in alike])
        with settings.told("chamber"):
            loads.append(SealedGas.of(walls, body, dead, atmosphere=atmosphere, exponent=exponent))
        drives |= {chamber.name: len(drives) + k for k, chamber in enumerate(alike)}
    driven = [chamber for chamber in settings.chambers if chamber.gas == "driven"]
    if driven:
        with settings.told("chamber"):
            ports = VolumePorts.of(tuple(cavities[chamber.name] for chamber in driven), body)
        loads.append(PrescribedForce.on(ports, body, jnp.full(len(driven), _KILOPASCAL)))
        drives |= {chamber.name: len(drives) + k for k, chamber in enumerate(driven)}
    return tuple(loads), drives


def _sensors(
    settings: RobotSettings, parts: Parts
) -> tuple[SensorSuite, tuple[AbstractReading, ...], dict[str, slice]]:
    """All sensors, what they measure, and which readings are whose."""
    try:
        suite = SensorSuite.of(settings.sensors, parts)
    except ConfigError as error:  # which names the sensor
        raise ConfigError(f"{settings.path}: {error}") from error
    each = []
    for k, sensor in enumerate(settings.sensors):
        with settings.told(f"sensor[{k}]"):
            each.append(sensor.functional(parts))
    readings = tuple(reading for reading in each if reading is not None)
    return suite, readings, {name: suite.outputs[name] for name in suite.outputs.names}


@eqx.filter_jit
def _lands(contact: AbstractContact, body: Body, places: Float[Array, "e 3 3"]) -> Bool[Array, " e"]:
    return jax.vmap(lambda place: contact.lands(body, place))(places)


def _check_electrodes(settings: RobotSettings, body: Body, contacts: Sequence[AbstractContact]) -> None:
    """Raise ConfigError for an electrode that is off the surface on which its contact presses."""
    kinds = {contact.name: kind for contact, kind in zip(settings.contacts, contacts, strict=True)}
    for k, sensor in enumerate(settings.sensors):
        if sensor.places:
            kind = kinds[sensor.places[0].contact]
            places = jnp.asarray(np.stack([seen.place for seen in sensor.places]))
            for number in np.flatnonzero(~np.asarray(_lands(kind, body, places)))[:1]:
                seen = sensor.places[number]
                raise ConfigError(
                    f'{settings.path}: sensor[{k}].{seen.key}.centre: "{seen.name}" is not within the radius '
                    f'of contact "{seen.contact}" of where its direction enters the body: move it onto the '
                    "surface, or turn the direction"
                )


def _slots(
    settings: RobotSettings, rest: Float[np.ndarray, "k 3"], faces: np.ndarray
) -> tuple[dict[str, slice], tuple[int, ...], tuple[AbstractWorkspace | None, ...]]:
    """Which slots each contact has, of which contact each slot is, and where readings may find it."""
    slots: dict[str, slice] = {}
    kinds: list[int] = []
    workspaces: list[AbstractWorkspace | None] = []
    for k, contact in enumerate(settings.contacts):
        with settings.told(f"contact[{k}].surface"):
            workspace = contact.workspace(faces, rest)
        slots[contact.name] = slice(len(kinds), len(kinds) + contact.at_once)
        kinds += [k] * contact.at_once
        workspaces += [workspace] * contact.at_once
    return slots, tuple(kinds), tuple(workspaces)


def _somewhere(
    settings: RobotSettings,
    workspace: AbstractWorkspace | None,
    rest: Float[np.ndarray, "k 3"],
    faces: np.ndarray,
) -> Float[np.ndarray, "3 3"]:
    """A place (3, 3) where a contact may press: in its workspace, or where a sensor sees it."""
    if workspace is not None:
        return workspace.grid(2)[0][0]
    return next(iter(settings.places.values()), facing(rest[faces[0, 0]], (0, 0, -1)))


def _commands(settings: RobotSettings, drives: Mapping[str, int]) -> tuple[Command, ...]:
    commands = []
    for part in (*settings.cables, *settings.chambers):
        if part.command is not None:
            given, drive = part.command, drives[part.name]
            commands.append(Command(given.channel, given.factor, drive, given.of == "length"))
    return tuple(commands)


def require_sensors(settings: RobotSettings) -> None:
    """Raise ConfigError for a robot without sensors."""
    if not settings.sensors:
        raise ConfigError(f"{settings.path}: sensor: missing, needed to estimate from a recording")
