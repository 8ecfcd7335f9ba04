"""From settings to what turns the frames of a device's sensors into contacts, forces and shape."""

import jax.numpy as jnp

from softfuse.config.build_device import build_limits, build_step_settings
from softfuse.config.build_sensors import build_sensors
from softfuse.config.contact import DiscSettings
from softfuse.config.device import DeviceConfig
from softfuse.estimation.device import Device
from softfuse.estimation.tracker import Tracker, TrackerSettings
from softfuse.sensing.pad_senses import PadSenses, fitted_location, mean_location

_LOCATE = {"peak-fit": fitted_location, "weighted-mean": mean_location}


def build_tracker(config: DeviceConfig, device: Device) -> Tracker:
    """The tracker of the config's sensors on the device; compiled.

    Raises ConfigError when the config has no sensors or no contact.
    """
    sensors = build_sensors(config)
    disc = config.contact
    assert isinstance(disc, DiscSettings) and config.sensors is not None  # or there were no sensors built
    workspace = disc.workspace
    senses = PadSenses(
        sensors,
        jnp.stack([jnp.asarray(workspace.x), jnp.asarray(workspace.y)], axis=1),
        _LOCATE[config.sensors.capacitive.location],
    )
    settings = TrackerSettings(config.estimator.poor_fit)
    return Tracker(senses, device, build_limits(config, 1), settings, build_step_settings(config))
