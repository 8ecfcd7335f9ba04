"""A recording as the frames of a device's sensors, and the truth that it may hold."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Int

from softfuse.errors import ConfigError
from softfuse.estimation.tracked import Frame, Tracked
from softfuse.experiment.accuracy import Samples
from softfuse.hardware.recording import Recording
from softfuse.robot.file import RobotSettings

TRUTH = ("sample", "true_x_mm", "true_y_mm", "true_force_N")
"""Columns of a recording that make an evaluation possible."""


def sensor_columns(config: RobotSettings) -> list[str]:
    """The columns of a recording that the device's sensors write; raises ConfigError when it has none."""
    if config.sensors is None:
        raise ConfigError(f"{config.path}: sensors: missing, needed to estimate from a recording")
    return list(config.sensors.channels)


def sensor_frames(config: RobotSettings, recording: Recording) -> list[Frame]:
    """The recording's frames with the readings in the order of the sensors."""
    assert config.sensors is not None  # sensor_columns has told
    groups = zip(*(unit * recording.matrix(names) for names, unit in config.sensors.groups), strict=True)
    return [Frame(at, readings) for at, readings in zip(recording.time_s, groups, strict=True)]


def sample_frames(recording: Recording) -> Int[np.ndarray, " s"]:
    """The frames (s,) at which the truth is known and counts; none where the recording has no truth."""
    columns = recording.columns
    if not all(name in columns for name in TRUTH):
        return np.zeros(0, int)
    known = np.all([np.isfinite(columns[name]) for name in TRUTH], axis=0)
    return np.flatnonzero(known & (columns["sample"] > 0) & (columns["true_force_N"] > 0))


def samples_at(recording: Recording, found: Sequence[Tracked], at: Int[np.ndarray, " s"]) -> Samples:
    """Estimates and truth at the frames (s,)."""
    columns = recording.columns
    return Samples(
        level=columns["sample"][at].astype(int),
        location_m=np.array([found[i].centre_m[:2] for i in at]).reshape(-1, 2),
        force_N=np.array([found[i].force_N for i in at]),
        true_location_m=1e-3 * np.stack([columns["true_x_mm"], columns["true_y_mm"]], axis=1)[at],
        true_force_N=columns["true_force_N"][at],
        location_sigma_m=np.array([found[i].centre_sigma_m for i in at]).reshape(-1, 2),
        force_sigma_N=np.array([found[i].force_sigma_N for i in at]),
    )
