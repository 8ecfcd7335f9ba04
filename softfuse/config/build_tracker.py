"""From settings to what turns the frames of a device's sensors into contacts, forces and shape."""

from dataclasses import replace

import jax.numpy as jnp

from softfuse.config.build_device import build_limits, build_step_settings
from softfuse.config.build_finger_sensors import build_finger_sensors
from softfuse.config.build_mutual import build_mutual_senses
from softfuse.config.build_sensors import build_sensors
from softfuse.config.contact import DiscSettings, PatchSettings
from softfuse.config.device import DeviceConfig
from softfuse.errors import ConfigError
from softfuse.estimation.atlas import Atlas
from softfuse.estimation.device import Device
from softfuse.estimation.model_error import ModelError
from softfuse.estimation.reading_spread import read_spread
from softfuse.estimation.tracker import Tracker, TrackerSettings
from softfuse.sensors.finger_senses import FingerSenses
from softfuse.sensors.mutual_senses import MutualSenses
from softfuse.sensors.pad_senses import PadSenses, fitted_location, mean_location
from softfuse.sensors.senses import AbstractSenses

_LOCATE = {"peak-fit": fitted_location, "weighted-mean": mean_location}


def build_senses(config: DeviceConfig) -> AbstractSenses:
    """The config's sensors, in the terms of the estimator.

    Raises ConfigError when it has no sensors, or a contact that they cannot find.
    """
    if config.sensors is None:
        raise ConfigError(f"{config.path}: sensors: missing, needed to estimate from a recording")
    if config.sensors.vented is None:
        return _finger_senses(config)
    return build_mutual_senses(config) if config.sensors.grid else _pad_senses(config)


def _pad_senses(config: DeviceConfig) -> PadSenses:
    sensors = build_sensors(config)
    assert config.sensors is not None
    if not isinstance(config.contact, DiscSettings):
        raise ConfigError(
            f'{config.path}: contact.model: crossed electrodes find a "punch" or "uniform" disc'
        )
    workspace = config.contact.workspace
    low_high = jnp.stack([jnp.asarray(workspace.x), jnp.asarray(workspace.y)], axis=1)
    lines = config.sensors.capacitive
    return PadSenses(sensors, low_high, _LOCATE[lines.location], lines.pose.pose())


def _finger_senses(config: DeviceConfig) -> FingerSenses:
    pressure, electrodes = build_finger_sensors(config)
    assert config.sensors is not None
    if not isinstance(config.contact, PatchSettings):
        raise ConfigError(f'{config.path}: contact.model: single electrodes need the model "patch"')
    lengths = config.sensors.cable
    # Noise and slack of lengths that nobody measures do not matter.
    noise, slack, zero = (lengths.noise, lengths.slack, lengths.zero) if lengths else (1.0, 1.0, (0.0,))
    cables = jnp.ones(len(config.cables))
    return FingerSenses(
        pressure,
        electrodes,
        jnp.broadcast_to(jnp.array(config.sensors.pressure.gain), (len(config.cavities),)),
        jnp.asarray(config.sensors.pressure.model_error),
        jnp.array([electrode.centre for electrode in config.electrodes]),
        cable_zero_m=jnp.array(zero) * cables,
        cable_sigma_m=noise * cables,
        slack_m=slack * cables,
        average_s=jnp.asarray(config.sensors.pressure.average),
        contacts=config.contact.max_contacts,
        supplies=0 if config.sensors.pressure.reference_channel is None else 1,
        lengths=len(lengths.channels) if lengths else 0,
    )


def build_model_error(config: DeviceConfig) -> ModelError:
    """By how much the config's model may be wrong; raises SoftfuseError when the file of its spread is not
    that of such a device.
    """
    path, part = config.estimator.reading_spread, config.estimator.model_error
    if path is None:
        return ModelError(part)
    if not isinstance(config.contact, DiscSettings):
        raise ConfigError(f"{config.path}: estimator.reading_spread: only discs press at places of a grid")
    return ModelError(part, spread=read_spread(path, len(config.cavities)))


def build_tracker(config: DeviceConfig, device: Device | Atlas) -> Tracker:
    """The tracker of the config's sensors on the device, or on the charts of it; compiled.

    Raises ConfigError when the config has no sensors or no contact.
    """
    senses = build_senses(config)
    contacts = senses.contacts if isinstance(senses, FingerSenses | MutualSenses) else 1
    limits = build_limits(config, contacts)
    settings = TrackerSettings(config.estimator.poor_fit, build_model_error(config))
    if isinstance(config.contact, DiscSettings):
        x, y = config.contact.workspace.x, config.contact.workspace.y
        settings = replace(settings, workspace_m=tuple(zip(x, y, strict=True)))
    return Tracker(senses, device, limits, settings, build_step_settings(config))
