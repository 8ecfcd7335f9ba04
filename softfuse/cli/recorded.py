"""A recording as the frames of a device's sensors, and the truth that it may hold."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Int

from softfuse.config import DeviceConfig
from softfuse.config.recording import RecordingSettings
from softfuse.errors import ConfigError
from softfuse.estimation.tracked import Frame, Tracked
from softfuse.experiment.accuracy import Samples
from softfuse.hardware.recording import Recording, read_recording
from softfuse.hardware.table.form import TableForm

TRUTH = ("sample", "true_x_mm", "true_y_mm", "true_force_N")
"""Columns of a recording that make an evaluation possible."""
_AT_ONCE = 1 << 14
"""Frames that are made from the columns side by side."""


def sensor_columns(config: DeviceConfig) -> list[str]:
    """The columns of a recording that the device's sensors write; raises ConfigError when it has none."""
    if config.sensors is None:
        raise ConfigError(f"{config.path}: sensors: missing, needed to estimate from a recording")
    return list(config.sensors.channels)


def table_form(settings: RecordingSettings) -> TableForm:
    """How recordings are written, as far as the settings tell."""
    return TableForm(**dict(settings))


def read_sensors(config: DeviceConfig, path: Path) -> Recording:
    """A recording of the device; raises as `sensor_columns` and `read_recording` do."""
    return read_recording(path, sensor_columns(config), table_form(config.recording))


def sensor_frames(config: DeviceConfig, recording: Recording) -> Iterator[Frame]:
    """The recording's frames with the readings in the order of the sensors, made one after the other."""
    assert config.sensors is not None  # sensor_columns has told
    n = len(recording.time_s)
    for start in range(0, n, _AT_ONCE):
        part = recording.rows(np.arange(start, min(start + _AT_ONCE, n)))
        groups = zip(*(unit * part.matrix(names) for names, unit in config.sensors.groups), strict=True)
        for at, readings in zip(part.time_s, groups, strict=True):
            yield Frame(at, readings)


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
