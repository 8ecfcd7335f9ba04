"""When an estimate is doubted, and by how much its model may be wrong."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from softfuse.estimation.estimator import Estimate
from softfuse.estimation.model_error import FLOOR, ModelError, read_spread
from softfuse.robot.robot import Robot
from softfuse.sensors.status import Status
from softfuse.sensors.suite import Observation


@dataclass(frozen=True)
class TrackerSettings:
    """When an estimate is doubted: `poor_fit` [-], a misfit above this part of the largest reading;
    `model_error`, by how much the model may be wrong, None: not known; `offset_s` [s], over which time what
    the model misses is averaged.
    """

    poor_fit: float = 0.25
    model_error: ModelError | None = None
    offset_s: float = 1.0

    @classmethod
    def of(cls, robot: Robot) -> "TrackerSettings":
        """Those of the robot's settings; SoftfuseError for the file of another robot's spread."""
        given = robot.settings.estimator
        path, readings = given.reading_spread, robot.model.n_readings
        spread = None if path is None else read_spread(path, readings)
        known = given.model_error is not None or spread is not None
        part = robot.by_reading(given.model_error or 0.0, 0.0)
        error = ModelError(part, spread=spread, floor=robot.by_reading(given.model_error_floor, FLOOR))
        return cls(given.poor_fit, error if known else None)


def doubts_of(
    now: Observation,
    sigma: Float[np.ndarray, " k"],
    found: Estimate,
    misfit: Float[np.ndarray, " k"],
    poor_fit: float,
) -> list[str]:
    """What is doubted of an estimate from readings of errors `sigma` (k,), with its misfit (k,)."""
    doubts: list[str] = []
    if found.corrected:
        doubts.append(Status.corrected)
    if float(found.report.taken) < 1.0:
        doubts.append(Status.lagging)
    if _poor(now, sigma, misfit, poor_fit):
        doubts.append(Status.poor_fit)
    if not float(found.report.kkt) <= 1e-6:
        doubts.append(Status.not_optimal)
    return doubts


def _poor(
    now: Observation, sigma: Float[np.ndarray, " k"], misfit: Float[np.ndarray, " k"], part: float
) -> bool:
    """Whether a misfit is beyond what it may be and a part of the largest reading [standard deviations]."""
    if not now.valid.any():
        return False
    size = np.where(now.valid, np.abs(now.reading) / sigma, 0.0)
    missing = np.where(now.valid, np.abs(misfit) / sigma, 0.0)
    return bool(missing.max() > max(part * size.max(), 5.0))
