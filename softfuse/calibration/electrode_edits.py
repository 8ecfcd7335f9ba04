"""Settings of crossed electrodes with the gains and the untouched counts that presses told."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from softfuse.calibration.electrode_gains import GainFit
from softfuse.robot.file import Edits
from softfuse.robot.settings import RobotSettings
from softfuse.sensors.crossed.settings import CrossedSettings

_LEAST_FRAMES = 50
"""Fewer readings of a line say nothing."""


@dataclass(frozen=True, eq=False)
class Untouched:
    """Counts (e,) of electrodes while nothing is near, medians over frames, which a hovering hand hardly
    moves, and standard deviations (e,) of single readings about them, by noise and drift while recorded.
    """

    counts: Float[np.ndarray, " e"]
    sigma: Float[np.ndarray, " e"]


def untouched(counts: Float[np.ndarray, "n e"], read: Bool[np.ndarray, "n e"]) -> Untouched | None:
    """What n frames of counts (n, e) say, `read` (n, e) with nothing near; None if too few of a line are."""
    if np.any(read.sum(axis=0) < _LEAST_FRAMES):
        return None
    there = np.where(read, counts, np.nan)
    return Untouched(np.nanmedian(there, axis=0), np.nanstd(there, axis=0))


def with_gains(config: RobotSettings, gains: GainFit) -> RobotSettings:
    """The settings of electrodes with the gains that presses told."""
    number, lines = _lines(config)
    each = np.asarray(lines.gains()) * np.exp(gains.value)
    row, column = _split(lines, np.array([float(f"{gain:.6g}") for gain in each]))
    changed = lines.model_copy(update={"row_gain": tuple(row), "column_gain": tuple(column)})
    sensors = (*config.sensors[:number], changed, *config.sensors[number + 1 :])
    return config.model_copy(update={"sensors": sensors})


def gain_edits(config: RobotSettings) -> Edits:
    """The edits that give another config's electrodes the gains of this one's."""
    number, lines = _lines(config)
    key = ("sensor", number)
    return {(*key, "row_gain"): list(lines.row_gain), (*key, "column_gain"): list(lines.column_gain)}


def baseline_edits(config: RobotSettings, untouched: Untouched) -> Edits:
    """The edits of a config that say what its electrodes read untouched."""
    number, lines = _lines(config)
    row, column = _split(lines, np.round(untouched.counts, 1))
    return {("sensor", number, "row_baseline"): row, ("sensor", number, "column_baseline"): column}


def _lines(config: RobotSettings) -> tuple[int, CrossedSettings]:
    """The first sensor of crossed electrodes, and its number."""
    lines = config.sensors_of(CrossedSettings)[0]
    return config.sensors.index(lines), lines


def _split(lines: CrossedSettings, each: Float[np.ndarray, " e"]) -> tuple[list[float], list[float]]:
    row, column = np.split(each, [len(lines.row_y)])
    return row.tolist(), column.tolist()
