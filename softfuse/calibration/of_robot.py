"""What a calibration may change of a robot, and settings that say what it found."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import singledispatch

import numpy as np
from jaxtyping import Bool, Float, Int

from softfuse.body.stiffness_field import TERMS
from softfuse.calibration.actuator_adjustment import CableCompliances, CableZeros, DeadVolumes
from softfuse.calibration.adjustment import (
    AbstractAdjustment,
    Adjustments,
    Gains,
    Layer,
    Stiffening,
    Stiffness,
    StiffnessField,
    Walls,
)
from softfuse.calibration.array_pose import PoseFit, PosePrior
from softfuse.calibration.presses import Applied, ContactPlaces
from softfuse.errors import ConfigError
from softfuse.material.base import AbstractMaterial
from softfuse.material.yeoh import Yeoh
from softfuse.mechanics.model import Model
from softfuse.mechanics.reading import AbstractReading
from softfuse.robot.file import Edits, Key
from softfuse.robot.material import Material
from softfuse.robot.robot import Robot
from softfuse.robot.settings import RobotSettings
from softfuse.sensors.crossed.settings import CrossedSettings


@dataclass(frozen=True, eq=False)
class Fitted:
    """A robot as it is known in presses: the `model`, whose cables are shortened by what is measured, or left
    alone, and which reads all that its sensors measure but that; the numbers `readings` (k,) of these among
    the robot's, the `kind` (k,) of each, see `model_error.missed`, and what people call them, `names` (k,);
    `shortened` (b,): which cables have a length that is measured or commanded.
    """

    robot: Robot
    model: Model
    readings: Int[np.ndarray, " k"]
    kind: Int[np.ndarray, " k"]
    names: tuple[str, ...]
    shortened: Bool[np.ndarray, " b"]

    @classmethod
    def of(cls, robot: Robot) -> "Fitted":
        """Of a robot. Raises ConfigError when it has no sensors."""
        settings, model = robot.settings, robot.model
        if not settings.sensors:
            raise ConfigError(f"{settings.path}: sensor: missing, a calibration fits what they read")
        answered = {*model.answered} | {each.drive for each in robot.commands if each.of_answer}
        drives = {cable.name: robot.addresses.drives[cable.name] for cable in settings.cables}
        shortened = [name for name, drive in drives.items() if drive in answered]
        kept, numbers, first = list[AbstractReading](), list[int](), 0
        for reading in (each for joined in model.readings for each in joined.single):
            own = range(first, first + reading.count)
            first += reading.count
            known = np.isin(reading.answered, [*drives.values()]) | (np.array(reading.driven) >= 0)
            if not known.all():
                kept.append(reading)
                numbers += own
        readings = np.array(numbers, int)
        names = robot.suite.readings
        return cls(
            robot,
            replace(model, actuators=robot.shortened(shortened), readings=tuple(kept)),
            readings,
            robot.reading_kinds[readings],
            tuple(names[k] for k in numbers),
            np.array([name in shortened for name in drives], bool),
        )

    @property
    def sensors(self) -> list[str]:
        """The names of the robot's sensors that have readings: `kind` counts them."""
        return list(self.robot.addresses.readings)

    def by_sensor(self, values: Float[np.ndarray, " k"]) -> dict[str, float]:
        """Values (k,) that are the same for all readings of a sensor, by its name."""
        return {self.sensors[kind]: float(values[self.kind == kind][0]) for kind in np.unique(self.kind)}

    @property
    def told(self) -> Int[np.ndarray, " k"]:
        """The drive of the model's actuators that each of the robot's readings (k,) tells; -1: none."""
        drives, own = self.robot.addresses.drives, self.robot.model
        cables = np.array([drives[cable.name] for cable in self.robot.settings.cables], int)
        shortened = cables[self.shortened]
        # A shortened cable is driven by what answers the robot's own.
        driven = np.where(np.isin(own.driven, shortened), -1, own.driven)
        return np.where(np.isin(own.answered, shortened), own.answered, driven)


def build_adjustments(fitted: Fitted) -> Adjustments:
    """What [calibration] says may differ from the robot's settings.

    Raises ConfigError when nothing may.
    """
    robot, config = fitted.robot, fitted.robot.settings
    may, model = config.calibration, fitted.model
    groups: list[AbstractAdjustment] = []
    if may.stiffness:
        groups.append(Stiffness.within(may.stiffness))
    if may.stiffening and Stiffening.possible(model):
        groups.append(Stiffening.within(may.stiffening))
    if may.contact_layer and config.contacts and (layer := config.contacts[0].layer) is not None:
        groups.append(Layer.of(layer, config.contacts[0].radius, model.body, may.contact_layer))
    if config.chambers and (may.cavity_shift or may.cavity_growth):
        centres = np.array([np.add(chamber.centre, chamber.shift) for chamber in config.chambers])
        names = [chamber.name for chamber in config.chambers]
        mesh = robot.mesh.mesh
        groups.append(Walls.of(mesh, centres, names, shift=may.cavity_shift, growth=may.cavity_growth))
    if may.stiffness_field:
        # After the walls: it is a field over the body as made.
        groups.append(StiffnessField.within(may.stiffness_field, config.body.stiffness_field.coefficients))
    if may.gain:
        groups.append(Gains.of(_called(fitted), _with_gain(fitted), may.gain))
    groups += _actuator_adjustments(fitted)
    if not groups:
        raise ConfigError(f"{config.path}: calibration: all is 0, so that there is nothing to fit")
    return Adjustments(tuple(groups))


def _with_gain(fitted: Fitted) -> Bool[np.ndarray, " k"]:
    """Which of the readings (k,) are of sensors that have a gain."""
    robot = fitted.robot
    flags = np.zeros(robot.model.n_readings, bool)
    for sensor in robot.settings.sensors:
        if hasattr(sensor, "gain") and sensor.name in robot.addresses.readings:
            flags[robot.addresses.readings[sensor.name]] = True
    return flags[fitted.readings]


def _called(fitted: Fitted) -> list[str]:
    """What people call each reading in a report: its chamber where only one sensor reads these."""
    return [name.split(" ", 1)[-1] for name in fitted.names]


def adjustments_of_presses(
    fitted: Fitted, adjustments: Adjustments, applied: Applied, called: dict[int, str]
) -> Adjustments:
    """Those that presses, which people call something, have to do with: none of cables that none of them
    pulls, and besides where on its named place each contact acts.
    """
    config, groups = fitted.robot.settings, adjustments.groups
    slack = [least for sensor in config.sensors for least in sensor.slacks.values()]
    cables = len(config.cables)
    if slack and not np.any(applied.prescribed[:, :cables] > min(slack)):
        groups = tuple(group for group in groups if not group.of_cables)
    lines = [each.line for each in config.contacts if each.line]
    if lines and config.places:
        length, sigma = lines[0]
        sigma = sigma or length / np.sqrt(12)
        groups = (*groups, ContactPlaces.of(applied, called, config.places, sigma))
    return Adjustments(groups)


def _actuator_adjustments(fitted: Fitted) -> list[AbstractAdjustment]:
    config, groups = fitted.robot.settings, list[AbstractAdjustment]()
    may = config.calibration
    cables = [cable for cable, on in zip(config.cables, fitted.shortened, strict=True) if on]
    if cables and may.cable_zero and any(sensor.slacks for sensor in config.sensors):
        numbers = np.flatnonzero(fitted.shortened)
        groups.append(CableZeros.of([cable.name for cable in cables], numbers, may.cable_zero))
    if cables and may.cable_compliance:
        most = [cable.max_tension for cable in cables]
        names = [cable.name for cable in cables]
        groups.append(CableCompliances.of(fitted.model, names, most, may.cable_compliance))
    sealed = _sealed(fitted)
    if sealed and may.dead_volume:
        groups.append(DeadVolumes.of(sealed, may.dead_volume))
    return groups


def _sealed(fitted: Fitted) -> list[str]:
    """The sealed chambers in the order of their drives."""
    robot = fitted.robot
    names = [chamber.name for chamber in robot.settings.chambers if chamber.gas == "sealed"]
    return sorted(names, key=lambda name: robot.addresses.drives[name])


def calibrated_edits(fitted: Fitted, adjustments: Adjustments, value: Float[np.ndarray, " p"]) -> Edits:
    """The edits of the settings that make the robot one with parameters (p,)."""
    config = fitted.robot.settings
    made = adjustments.adjusted(fitted.model, value)
    edits: dict[Key, str | float | list[str] | list[float] | None] = {}
    for group, part in zip(adjustments.groups, adjustments.of_group(value), strict=True):
        part = np.asarray(part)
        match group:
            case Stiffness() | Stiffening():
                for k, (material, law) in enumerate(
                    zip(config.body.materials, made.body.full.materials, strict=True)
                ):
                    for key, said in _material(law, material).items():
                        edits["body", "material", k, key] = said
            case Layer():
                compliance = float(group.typical * np.exp(part[0]))
                edits["contact", 0, "compliance"] = f"{1e9 * compliance:.6g} mm/MPa"
            case Walls():
                edits |= _chambers(config, dict(zip(group.names, part, strict=True)))
            case StiffnessField():
                for term, coefficient in zip(TERMS, np.asarray(group.configured) + part, strict=True):
                    edits["body", "stiffness_field", term] = _rounded(coefficient)
            case Gains():
                edits |= _gains(fitted, part)
            case CableZeros():
                names = [config.cables[k].name for k in np.flatnonzero(fitted.shortened)]
                edits |= _zeros(config, dict(zip(names, part, strict=True)))
            case CableCompliances():
                shortened = np.flatnonzero(fitted.shortened)
                for k, compliance in zip(shortened, group.typical * np.exp(part), strict=True):
                    edits["cable", int(k), "compliance"] = f"{1e3 * float(compliance):.6g} mm/N"
            case DeadVolumes():
                factors = dict(zip(_sealed(fitted), np.exp(part), strict=True))
                for k, chamber in enumerate(config.chambers):
                    if chamber.name in factors:
                        dead = 1e9 * chamber.dead_volume * factors[chamber.name]
                        edits["chamber", k, "dead_volume"] = f"{dead:.6g} mm^3"
    return edits


def _gains(fitted: Fitted, part: Float[np.ndarray, " g"]) -> dict[Key, float | list[float]]:
    """Gains times exp of what was found (g,) of those readings that have one; a single number stays one."""
    factor = np.ones(fitted.robot.model.n_readings)
    factor[fitted.readings[_with_gain(fitted)]] = np.exp(part)
    edits: dict[Key, float | list[float]] = {}
    for k, sensor in enumerate(fitted.robot.settings.sensors):
        given = getattr(sensor, "gain", None)
        own = fitted.robot.addresses.readings.get(sensor.name)
        if (
            given is not None
            and own is not None
            and np.isin(np.arange(own.start, own.stop), fitted.readings).all()
        ):
            gain = [_rounded(each) for each in given * factor[own]]
            edits["sensor", k, "gain"] = gain if np.ndim(given) else gain[0]
    return edits


def _zeros(config: RobotSettings, shift: dict[str, float]) -> dict[Key, list[str]]:
    """Where cables get taut, more by shifts [m] of some by name."""
    edits: dict[Key, list[str]] = {}
    for k, sensor in enumerate(config.sensors):
        if sensor.slacks:
            edits["sensor", k, "zero"] = _millimetres(sensor.zeros_after(shift))
    return edits


def build_pose_prior(config: RobotSettings) -> PosePrior:
    """In which tolerance [calibration] says that the electrodes lie on the body."""
    may = config.calibration
    return PosePrior(may.array_shift, may.array_turn, may.array_stretch, may.array_sigma, may.array_dent)


def pose_edits(config: RobotSettings, pose: PoseFit) -> Edits:
    """The edits of a config that put its crossed electrodes where presses found them."""
    (lines,) = config.sensors_of(CrossedSettings)[:1]
    was, (x, y, turn, *stretch) = lines.pose, pose.value
    key = ("sensor", config.sensors.index(lines), "pose")
    return {
        (*key, "shift"): _millimetres(np.add(was.shift, [x, y])),
        (*key, "turn"): f"{np.rad2deg(was.turn + turn):.6g} deg",
        (*key, "stretch"): [_rounded(each) for each in np.multiply(was.stretch, np.exp(stretch))],
        (*key, "sigma_factor"): _rounded(was.sigma_factor * pose.factor),
        (*key, "dent_part"): _rounded(pose.dent_part),
    }


@singledispatch
def _material(law: AbstractMaterial, settings: Material) -> dict[str, str | list[str] | None]:
    """The keys of a material that make it a law."""
    factor = float(law.shear_modulus()) / settings.shear_modulus
    return {key: _megapascals(value) for key, value in settings.stiffness_times(factor).items()}


@_material.register
def _(law: Yeoh, settings: Material) -> dict[str, str | list[str] | None]:
    constants = {"c1": law.c1, "c2": law.c2, "c3": law.c3}
    edits: dict[str, str | list[str] | None] = {"law": "yeoh"}
    for key in settings.stiffness_times(1.0).keys() - constants.keys():
        edits[key] = None
    if "bulk" in edits:
        edits["bulk"] = _megapascals(float(law.lame) + 2 / 3 * float(law.shear_modulus()))
    return edits | {key: _megapascals(float(constant)) for key, constant in constants.items()}


def _chambers(config: RobotSettings, by_name: dict[str, float]) -> dict[Key, list[str]]:
    edits: dict[Key, list[str]] = {}
    for k, chamber in enumerate(config.chambers):
        for what, drawn in (("shift", chamber.shift), ("growth", chamber.growth)):
            names = [f"{chamber.name} {what} {axis}" for axis in "xyz"]
            if all(name in by_name for name in names):
                edits["chamber", k, what] = _millimetres(np.add(drawn, [by_name[name] for name in names]))
    return edits


def _rounded(value: float) -> float:
    return float(f"{value:.6g}")


def _millimetres(lengths: Sequence[float] | np.ndarray) -> list[str]:
    return [f"{1e3 * length:.6g} mm" for length in lengths]


def _megapascals(pressure: float | tuple[float, ...]) -> str | list[str]:
    if isinstance(pressure, tuple):
        return [f"{1e-6 * each:.6g} MPa" for each in pressure]
    return f"{1e-6 * pressure:.6g} MPa"
