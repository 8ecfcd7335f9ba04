"""From settings to the measurement models of sealed cavities and single electrodes."""

from softfuse.config.device import DeviceConfig
from softfuse.errors import ConfigError
from softfuse.sensors.electrodes.detector import ElectrodeDetector
from softfuse.sensors.pressure.filter import PressureSensor


def build_finger_sensors(config: DeviceConfig) -> tuple[PressureSensor, ElectrodeDetector]:
    """The pressure sensors and the electrodes; raises ConfigError when the device has others or none."""
    if config.sensors is None:
        raise ConfigError(f"{config.path}: sensors: missing, needed to estimate from a recording")
    pressure, electrodes = config.sensors.pressure, config.sensors.electrodes
    assert config.gas is not None  # pressures are only read from sealed cavities
    return pressure.filter(config.gas.atmosphere), electrodes.detector()
