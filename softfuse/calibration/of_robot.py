"""From settings to the parameters that a calibration fits, and from fitted parameters back to settings."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from softfuse.body.body import Body
from softfuse.body.stiffness_field import TERMS
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
from softfuse.calibration.attached_adjustment import CableCompliances, CableZeros, DeadVolumes
from softfuse.calibration.contact_places import ContactPlaces
from softfuse.calibration.presses import Applied
from softfuse.config.contact import DiscSettings, PatchSettings
from softfuse.errors import ConfigError
from softfuse.experiment.sweep_series import with_shortened
from softfuse.material.base import AbstractMaterial
from softfuse.material.yeoh import Yeoh
from softfuse.mechanics.model import Model
from softfuse.mechanics.punch import PunchContact
from softfuse.robot.file import Edits, Key
from softfuse.robot.material import Material, OneModulus, SeveralModuli
from softfuse.robot.mesh import RobotMesh
from softfuse.robot.points import ElectrodePlace
from softfuse.robot.settings import RobotSettings


def fitted_device(config: RobotSettings, device: Model) -> Model:
    """A config's device as it is known in presses: its cables are shortened by lengths that are measured, or
    left alone, and it reads the volumes or the pressures of its cavities.
    """
    cables = len(config.cables)
    sealed = len(config.cavities) if config.gas is not None else 0
    lengths = config.sensors is not None and config.sensors.cable is not None
    return replace(with_shortened(device, (lengths,) * cables), gauges=tuple(range(cables, cables + sealed)))


def build_adjustments(config: RobotSettings, device: Model, mesh: RobotMesh) -> Adjustments:
    """What [calibration] says may differ from the config, of its `fitted_device` on a mesh.

    Raises ConfigError when the device has no sensors, cables of unknown length, or nothing may differ.
    """
    may = config.calibration
    if config.sensors is None:
        raise ConfigError(f"{config.path}: sensors: missing, a calibration fits what they read")
    if config.cables and config.sensors.sealed is not None and config.sensors.cable is None:
        raise ConfigError(
            f"{config.path}: sensors.cable: missing, a calibration must know by how much cables are shortened"
        )
    names = [cavity.name for cavity in config.cavities]
    groups: list[AbstractAdjustment] = []
    if may.stiffness:
        groups.append(Stiffness.within(may.stiffness))
    if may.stiffening and Stiffening.possible(device):
        groups.append(Stiffening.within(may.stiffening))
    if may.contact_layer and isinstance(config.contact, DiscSettings):
        groups.append(Layer.of(device, may.contact_layer))
    if may.cavity_shift or may.cavity_growth:
        centres = np.array([np.add(cavity.centre, cavity.shift) for cavity in config.cavities])
        groups.append(Walls.of(mesh.mesh, centres, names, shift=may.cavity_shift, growth=may.cavity_growth))
    if may.stiffness_field:
        # After the walls: it is a field over the body as made.
        groups.append(StiffnessField.within(may.stiffness_field, config.body.stiffness_field.coefficients))
    if may.gain:
        groups.append(Gains.of(names, may.gain))
    groups += _attached_adjustments(config, device)
    if not groups:
        raise ConfigError(f"{config.path}: calibration: all is 0, so that there is nothing to fit")
    return Adjustments(tuple(groups))


def adjustments_of_presses(
    config: RobotSettings, adjustments: Adjustments, applied: Applied, called: dict[int, str]
) -> Adjustments:
    """Those that presses, which people call something, have to do with: none of cables that none of them
    pulls, and besides where on its electrode each contact acts.
    """
    lengths = None if config.sensors is None else config.sensors.cable
    groups = adjustments.groups
    if lengths is not None and not np.any(applied.prescribed[:, : len(config.cables)] > lengths.slack):
        groups = tuple(group for group in groups if not isinstance(group, CableZeros | CableCompliances))
    if isinstance(config.contact, PatchSettings) and config.contact.forces(config.electrodes) > 1:
        electrodes = {each.name: np.array(each.place) for each in config.electrodes}
        sigma = _place_sigma(config.contact, config.electrodes)
        groups = (*groups, ContactPlaces.of(applied, called, electrodes, sigma))
    return Adjustments(groups)


def _attached_adjustments(config: RobotSettings, device: Model) -> list[AbstractAdjustment]:
    may, groups = config.calibration, list[AbstractAdjustment]()
    lengths = config.sensors is not None and config.sensors.cable is not None
    cables = [cable.name for cable in config.cables] if lengths else []
    if cables and may.cable_zero:
        groups.append(CableZeros.of(cables, may.cable_zero))
    if cables and may.cable_compliance:
        most = [cable.max_tension for cable in config.cables]
        groups.append(CableCompliances.of(device, cables, most, may.cable_compliance))
    if config.gas is not None and may.dead_volume:
        groups.append(DeadVolumes.of([cavity.name for cavity in config.cavities], may.dead_volume))
    return groups


def _place_sigma(contact: PatchSettings, electrodes: Sequence[ElectrodePlace]) -> float:
    """Of where a contact acts on its electrode [m]; anywhere on it where the config does not say."""
    if contact.place_sigma is not None:
        return contact.place_sigma
    return float(np.mean([np.linalg.norm(electrode.span) for electrode in electrodes])) / np.sqrt(12)


def calibrated_edits(
    config: RobotSettings, device: Model, adjustments: Adjustments, value: Float[np.ndarray, " p"]
) -> Edits:
    """The edits of a config that make its device one with parameters (p,)."""
    made = adjustments.adjusted(device, value)
    # build_adjustments has told.
    assert isinstance(made.body, Body) and config.sensors is not None
    edits: dict[Key, str | float | list[str] | list[float] | None] = {}
    for group, part in zip(adjustments.groups, adjustments.of_group(value), strict=True):
        part = np.asarray(part)
        match group:
            case Stiffness() | Stiffening():
                for k, (material, law) in enumerate(
                    zip(config.body.materials, made.body.materials, strict=True)
                ):
                    for key, said in _material(material, law).items():
                        edits["body", "material", k, key] = said
            case Layer():
                disc = made.contacts[0]
                assert isinstance(disc, PunchContact)
                compliance = float(disc.disc.compliance)
                edits["contact", "compliance"] = f"{1e9 * compliance:.6g} mm/MPa"
            case Walls():
                edits |= _cavities(config, dict(zip(group.names, part, strict=True)))
            case StiffnessField():
                for term, coefficient in zip(TERMS, np.asarray(group.configured) + part, strict=True):
                    edits["body", "stiffness_field", term] = _rounded(coefficient)
            case Gains():
                key = "flow" if config.sensors.vented else "pressure"
                gain = np.broadcast_to(getattr(config.sensors, key).gain, part.shape) * np.exp(part)
                edits["sensors", key, "gain"] = [_rounded(each) for each in gain]
            case CableZeros():
                assert config.sensors.cable is not None
                zero = np.broadcast_to(config.sensors.cable.zero, part.shape) + part
                edits["sensors", "cable", "zero"] = _millimetres(zero)
            case CableCompliances():
                for k, compliance in enumerate(group.typical * np.exp(part)):
                    edits["cable", k, "compliance"] = f"{1e3 * float(compliance):.6g} mm/N"
            case DeadVolumes():
                assert config.gas is not None
                dead = np.broadcast_to(config.gas.dead_volume, part.shape) * np.exp(part)
                edits["gas", "dead_volume"] = [f"{1e9 * each:.6g} mm^3" for each in dead]
    return edits


def build_pose_prior(config: RobotSettings) -> PosePrior:
    """In which tolerance [calibration] says that the electrodes lie on the body."""
    may = config.calibration
    return PosePrior(may.array_shift, may.array_turn, may.array_stretch, may.array_sigma, may.array_dent)


def pose_edits(config: RobotSettings, pose: PoseFit | None) -> Edits:
    """The edits of a config that put its crossed electrodes where presses found them; none without."""
    if pose is None:
        return {}
    assert config.sensors is not None  # they were felt
    was, (x, y, turn, *stretch) = config.sensors.capacitive.pose, pose.value
    key = ("sensors", "capacitive", "pose")
    return {
        (*key, "shift"): _millimetres(np.add(was.shift, [x, y])),
        (*key, "turn"): f"{np.rad2deg(was.turn + turn):.6g} deg",
        (*key, "stretch"): [_rounded(each) for each in np.multiply(was.stretch, np.exp(stretch))],
        (*key, "sigma_factor"): _rounded(was.sigma_factor * pose.factor),
        (*key, "dent_part"): _rounded(pose.dent_part),
    }


def _material(settings: Material, law: AbstractMaterial) -> dict[str, str | list[str] | None]:
    """The keys of a material that make it a law."""
    if not isinstance(law, Yeoh):
        factor = float(law.shear_modulus()) / settings.shear_modulus
        return {key: _megapascals(value) for key, value in settings.stiffness_times(factor).items()}
    edits: dict[str, str | list[str] | None] = {"law": "yeoh"}
    if isinstance(settings, OneModulus):
        edits["young"] = None
    elif isinstance(settings, SeveralModuli) and settings.bulk is not None:
        edits["bulk"] = _megapascals(float(law.lame) + 2 / 3 * float(law.shear_modulus()))
    constants = {"c1": law.c1, "c2": law.c2, "c3": law.c3}
    return edits | {key: _megapascals(float(constant)) for key, constant in constants.items()}


def _cavities(config: RobotSettings, by_name: dict[str, float]) -> dict[Key, list[str]]:
    edits: dict[Key, list[str]] = {}
    for k, cavity in enumerate(config.cavities):
        for what, drawn in (("shift", cavity.shift), ("growth", cavity.growth)):
            names = [f"{cavity.name} {what} {axis}" for axis in "xyz"]
            if all(name in by_name for name in names):
                edits["cavity", k, what] = _millimetres(np.add(drawn, [by_name[name] for name in names]))
    return edits


def _rounded(value: float) -> float:
    return float(f"{value:.6g}")


def _millimetres(lengths: Sequence[float] | np.ndarray) -> list[str]:
    return [f"{1e3 * length:.6g} mm" for length in lengths]


def _megapascals(pressure: float | tuple[float, ...]) -> str | list[str]:
    if isinstance(pressure, tuple):
        return [f"{1e-6 * each:.6g} MPa" for each in pressure]
    return f"{1e-6 * pressure:.6g} MPa"
