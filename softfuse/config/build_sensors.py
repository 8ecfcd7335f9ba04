"""From settings to the measurement models of the sensors."""

from softfuse.config.device import DeviceConfig
from softfuse.errors import ConfigError
from softfuse.sensors.pad import PadSensors


def build_sensors(config: DeviceConfig) -> PadSensors:
    """All measurement models of a pad; raises ConfigError when the device has other sensors or none, or no
    contact radius.
    """
    if config.sensors is None:
        raise ConfigError(f"{config.path}: sensors: missing, needed to estimate from a recording")
    if config.contact is None:
        raise ConfigError(f"{config.path}: contact: missing, its radius is needed to locate contacts")
    capacitive = config.sensors.capacitive
    return PadSensors(
        flow=config.sensors.flow.filter(),
        array=capacitive.array(),
        peak=capacitive.peak_model(config.contact.radius),
        touch=capacitive.touch.detector(capacitive.noise_counts),
    )
