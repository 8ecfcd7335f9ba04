"""From settings to a virtual body that stands in for the device: what presses on it, and what its sensors
say.

Dimensions, stiffness at small strains, nominal sensors and noise are the config's; mesh, law of the material,
errors of making and the zeros of the sensors are its own, so that the estimator's model is not its truth.
"""

from dataclasses import dataclass
from pathlib import Path

from softfuse.errors import ConfigError
from softfuse.experiment.build_virtual_finger import FingerPlan, finger_plan
from softfuse.experiment.build_virtual_pad import PadPlan, pad_plan
from softfuse.experiment.programme import Programme
from softfuse.robot.body import BlockSource, FingerSource
from softfuse.robot.laws import materials_of
from softfuse.robot.settings import RobotSettings
from softfuse.sensors.electronics import ChannelElectronics


@dataclass(frozen=True, eq=False)
class VirtualBody:
    """What its channels should say, and what becomes of that; k channels in the order of the config's
    sensors.

    boards: the channels of each of two boards, electrodes first, if there are two.
    """

    programme: Programme
    electronics: ChannelElectronics
    boards: tuple[tuple[str, ...], tuple[str, ...]]


def build_virtual(config: RobotSettings, *, folder: Path | None, seed: int) -> VirtualBody:
    """A virtual body for the config, whose equilibria are kept in a folder; None: nowhere.

    seed: of the zeros and gains of its sensors; the body is always the same. Raises ConfigError when the
    config is none of a pad, a layout or a finger with sensors, MeshError or SolveError when it cannot be
    made or pressed.
    """
    plan = build_plan(config)
    programme = plan.programme(folder)
    assert config.sensors is not None  # the plan has told
    electrodes = plan.electrodes
    others = tuple(name for name in config.sensors.channels if name not in electrodes)
    return VirtualBody(
        programme.only(config.sensors.channels),
        plan.electronics(seed).taken([programme.channels.index(name) for name in config.sensors.channels]),
        (electrodes, others),
    )


def build_plan(config: RobotSettings) -> PadPlan | FingerPlan:
    """What a virtual body for the config is, and what is done to it; ConfigError as `build_virtual`."""
    if config.sensors is None:
        raise ConfigError(f"{config.path}: sensors: missing, a virtual device has nothing to send")
    if len(config.body.materials) != 1:
        raise ConfigError(f"{config.path}: body.material: a virtual body is of one material")
    (material,) = materials_of(config.body)
    shear = float(material.shear_modulus())
    poisson = 0.5 * float(material.lame) / (float(material.lame) + shear)
    match config.body.source:
        case BlockSource():
            return pad_plan(config, config.body.source, shear, poisson)
        case FingerSource():
            return finger_plan(config, config.body.source, shear, poisson)
    raise ConfigError(
        f'{config.path}: body.source.type: only a "pad", a "layout" and a "finger" have virtual bodies'
    )
