"""What the sensors of a device say together about one frame, in the terms of the estimator."""

from abc import abstractmethod
from typing import Any, NamedTuple

import equinox as eqx
from jaxtyping import Array, Bool, Float

from softfuse.sensors.reading_drift import DriftModel, ReadingDrift
from softfuse.sensors.status import Status


class Sensed(NamedTuple):
    """One frame of c contacts and k readings."""

    reading: Float[Array, " k"]
    """(k,) readings since rest, in the order and units of `Model.reading` [SI]."""
    sigma: Float[Array, " k"]
    """(k,) their standard deviations."""
    valid: Bool[Array, " k"]
    """(k,) take part in the estimate."""
    touching: Bool[Array, " c"]
    """(c,) something touches here."""
    pressing: Bool[Array, " c"]
    """(c,) touches at a place that is allowed, known or to be told by the readings: it may have a force."""
    clear: Bool[Array, ""]
    """Nothing is near that could press: what the model misses now is its own error."""
    places: Array
    """(c, 3, 3) places, see `functional.chart`."""
    location_m: Float[Array, "c 3"]
    """(c, 3) middles of the contacts on the body at rest; NaN where unseen or where nothing touches [m]."""
    location_sigma_m: Float[Array, "c 2"]
    """(c, 2) standard deviations along the tangents of places; NaN where unknown [m]."""
    flags: dict[Status, Bool[Array, ""]]
    """What is to be said about the frame, and whether it is."""
    details: Any
    """The measurement of the device's own sensors."""
    drift: ReadingDrift | None = None
    """What the readings drift by; None where `AbstractSenses.drift` is."""


class AbstractSenses(eqx.Module):
    """All sensors of a device: pure, causal, one frame after the other."""

    @property
    @abstractmethod
    def channels(self) -> tuple[int, ...]:
        """Numbers of channels in each group of readings that a frame has."""

    @property
    def misses(self) -> bool:
        """Whether a contact may press that is seen nowhere, so that only readings tell its place."""
        return False

    @property
    def drift(self) -> DriftModel | None:
        """How readings drift while something presses; None where they do not."""
        return None

    @abstractmethod
    def init(self) -> Any:
        """State before the first frame; nothing touches."""

    @abstractmethod
    def update(
        self, state: Any, time_s: Float[Array, ""], readings: tuple[Float[Array, " n"], ...]
    ) -> tuple[Any, Sensed]:
        """One frame at `time_s` [s] of readings (n,) in each group; NaN stands for what is missing."""
