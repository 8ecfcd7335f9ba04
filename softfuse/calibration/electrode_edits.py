"""From fitted gains and baselines of crossed electrodes back to settings."""

import numpy as np
from jaxtyping import Float

from softfuse.calibration.electrode_baseline import Untouched
from softfuse.calibration.electrode_gains import GainFit
from softfuse.config.build_sensors import line_gains
from softfuse.robot.file import Edits
from softfuse.robot.settings import RobotSettings

_KEY = ("sensors", "capacitive")


def with_gains(config: RobotSettings, gains: GainFit) -> RobotSettings:
    """The configuration of electrodes with the gains that presses told."""
    sensors = config.sensors
    assert sensors is not None  # they were felt
    row, column = _gains(config, gains)
    crossed = sensors.capacitive.model_copy(update={"row_gain": tuple(row), "column_gain": tuple(column)})
    return config.model_copy(update={"sensors": sensors.model_copy(update={"crossed": crossed})})


def gain_edits(config: RobotSettings) -> Edits:
    """The edits that give another config's electrodes the gains of this one's."""
    assert config.sensors is not None
    crossed = config.sensors.capacitive
    return {
        (*_KEY, "row_gain"): list(crossed.row_gain),
        (*_KEY, "column_gain"): list(crossed.column_gain),
    }


def baseline_edits(config: RobotSettings, untouched: Untouched | None) -> Edits:
    """The edits of a config that say what its electrodes read untouched; none where that is not known."""
    if untouched is None:
        return {}
    row, column = _split(config, np.round(untouched.counts, 1))
    return {(*_KEY, "row_baseline"): row, (*_KEY, "column_baseline"): column}


def _gains(config: RobotSettings, gains: GainFit) -> tuple[list[float], list[float]]:
    """Of rows, of columns: the configured ones times what was found."""
    assert config.sensors is not None
    each = np.asarray(line_gains(config.sensors.capacitive)) * np.exp(gains.value)
    return _split(config, np.array([float(f"{gain:.6g}") for gain in each]))


def _split(config: RobotSettings, each: Float[np.ndarray, " e"]) -> tuple[list[float], list[float]]:
    assert config.sensors is not None
    row, column = np.split(each, [len(config.sensors.capacitive.row_y)])
    return row.tolist(), column.tolist()
