"""From settings to the measurement models of sealed cavities and single electrodes."""

from functools import partial

from softfuse.robot.settings import RobotSettings
from softfuse.config.sealed_sensors import ElectrodeSettings, LeakSettings, PressureSettings, TareSettings
from softfuse.errors import ConfigError
from softfuse.sensors import (
    ElectrodeDetector,
    LeakTest,
    PressureSensor,
    Tare,
    capacitive_array,
    electrode_detector,
    leak_test,
    mpx5100a,
    mpx5100d,
    mpx5100g,
    tare_settings,
)


def build_finger_sensors(config: RobotSettings) -> tuple[PressureSensor, ElectrodeDetector]:
    """The pressure sensors and the electrodes; raises ConfigError when the device has others or none."""
    if config.sensors is None:
        raise ConfigError(f"{config.path}: sensors: missing, needed to estimate from a recording")
    pressure, electrodes = config.sensors.pressure, config.sensors.electrodes
    assert config.gas is not None  # pressures are only read from sealed cavities
    return pressure_sensor(pressure, config.gas.atmosphere), electrode_thresholds(electrodes)


def pressure_sensor(settings: PressureSettings, atmosphere: float) -> PressureSensor:
    """The pressure sensors, one per channel, at rest under the atmosphere in Pa."""
    parts = {
        "MPX5100A": partial(mpx5100a, atmosphere_Pa=atmosphere),
        "MPX5100D": mpx5100d,
        "MPX5100G": mpx5100g,
    }
    return parts[settings.type](
        len(settings.channels),
        supply_V=settings.supply,
        noise_V=settings.noise,
        clip_low_V=settings.low,
        clip_high_V=settings.high,
        gain_sigma=settings.gain_sigma,
        hold_off_s=settings.hold_off,
        lag=settings.lag_frames,
        tare=_tare(settings.tare),
        leak=_leak(settings.leak),
    )


def _tare(settings: TareSettings) -> Tare:
    return tare_settings(
        offset_sigma_Pa=settings.offset_sigma,
        drift_Pa_s=settings.drift,
        settle_s=settings.settle,
        follow_s=settings.follow,
        gate_sigma=settings.gate_sigma,
        relearn_s=settings.relearn,
    )


def _leak(settings: LeakSettings) -> LeakTest:
    return leak_test(
        slowest_s=settings.slowest,
        sigma=settings.sigma,
        window_s=settings.window,
        repeat_Pa=settings.repeat,
        drift_Pa_s=settings.drift,
        unknown_Pa=settings.unknown,
        memory_s=settings.memory,
        prior_1_s=1.0 / settings.fastest,
    )


def electrode_thresholds(settings: ElectrodeSettings) -> ElectrodeDetector:
    """When each electrode is near something, touched, and no longer believed."""
    baseline = settings.baseline
    return electrode_detector(
        len(settings.channels),
        on_counts=settings.on_counts,
        off_counts=settings.off_counts,
        near_sigma=settings.near_sigma,
        on_frames=settings.on_frames,
        off_frames=settings.off_frames,
        longest_touch_s=settings.longest_touch,
        lost_s=settings.lost,
        quiet_fraction=settings.quiet_fraction,
        quiet_s=settings.quiet,
        array=capacitive_array(
            noise_counts=settings.noise_counts,
            lowest_counts=settings.lowest_counts,
            highest_counts=settings.highest_counts,
            stuck_frames=settings.stuck_frames,
            baseline_time_s=baseline.time,
            creep_time_s=baseline.creep_time,
            recovery_time_s=baseline.recovery_time,
            negative_sigma=baseline.negative_sigma,
        ),
    )
