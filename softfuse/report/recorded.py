"""A recording as the frames of a robot's sensors."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from softfuse.estimation.tracked import Frame
from softfuse.hardware.recording import Recording, read_recording
from softfuse.robot.robot import require_sensors
from softfuse.robot.settings import RobotSettings

_AT_ONCE = 1 << 14
"""Frames that are made from the columns side by side."""


def read_sensors(settings: RobotSettings, path: Path) -> Recording:
    """A recording of a robot's sensors.

    Raises ConfigError for a robot without sensors, RecordingError as `read_recording` does.
    """
    require_sensors(settings)
    return read_recording(path, list(settings.channels), settings.recording)


def sensor_frames(settings: RobotSettings, recording: Recording) -> Iterator[Frame]:
    """The recording's frames with the readings in the order of the robot's channels, one after the other."""
    n = len(recording.time_s)
    for start in range(0, n, _AT_ONCE):
        part = recording.rows(np.arange(start, min(start + _AT_ONCE, n)))
        raw = part.matrix(settings.channels)
        for at, readings in zip(part.time_s, raw, strict=True):
            yield Frame(float(at), readings)


@dataclass(frozen=True, eq=False)
class Part:
    """The frames of a recording that are estimated, flagged among all of its n frames, and alone."""

    estimated: Bool[np.ndarray, " n"]
    recording: Recording

    @classmethod
    def of(cls, whole: Recording, every: int) -> "Part":
        """Every so many frames, and the samples with truth."""
        estimated = np.arange(len(whole.time_s)) % every == 0
        if "sample" in whole.columns:
            estimated |= whole.columns["sample"] > 0
        return cls(estimated, whole.rows(np.flatnonzero(estimated)))
