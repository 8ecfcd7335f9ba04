"""What calibrating a kind of device needs: how recordings tell what was done to it, and what is to be said of
how sure it is then.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Self

import numpy as np
from jaxtyping import Float, Int

from softfuse.calibration.array_pose import PoseFit
from softfuse.calibration.electrode_baseline import Untouched
from softfuse.calibration.electrode_gains import GainFit
from softfuse.calibration.fit import Fit
from softfuse.calibration.presses import Answer, Applied, Presses
from softfuse.hardware.recording import Recording
from softfuse.robot.file import Edits, RobotSettings
from softfuse.sensors.senses import AbstractSenses, Sensed


@dataclass(frozen=True)
class Quantity:
    """What the fitted readings are, and the unit in which people read them, so many in SI's."""

    name: str
    unit: str
    per_si: float


@dataclass(frozen=True, eq=False)
class Felt:
    """Presses, and what was sensed of each of their samples (s,); of each press what people call it and where
    it is; and the recordings (r,) with what was sensed of all their frames up to the last sample.
    """

    presses: Presses
    sensed: tuple[Sensed, ...]
    called: dict[int, str]
    at: dict[int, str]
    recordings: tuple[tuple[Recording, tuple[Sensed, ...]], ...]


@dataclass(frozen=True, eq=False)
class Electrodes:
    """Where crossed electrodes lie on the body, their gains, and what they read untouched; None for what is
    not known.
    """

    pose: PoseFit | None = None
    gains: GainFit | None = None
    untouched: Untouched | None = None


@dataclass(frozen=True, eq=False)
class Certainty:
    """The edits of a config that say how sure a fitted device is, and what was found of its electrodes."""

    edits: Edits
    electrodes: Electrodes


@dataclass(frozen=True, eq=False)
class AbstractCalibration(ABC):
    """Of the device of a config; `quantity`: what it reads; `columns`: those that a recording must have."""

    quantity: ClassVar[Quantity]
    columns: ClassVar[str]
    settings: RobotSettings

    @abstractmethod
    def frames(self, recording: Recording) -> Int[np.ndarray, " s"]:
        """The frames (s,) at which it is known what presses."""

    @abstractmethod
    def contacts(self, recording: Recording) -> int:
        """How many at once a recording knows of, at least one."""

    @abstractmethod
    def senses(self) -> AbstractSenses:
        """The device's, whose standard deviations are those of noise alone."""

    @abstractmethod
    def presses(
        self, recording: Recording, at: Int[np.ndarray, " s"], sensed: Sequence[Sensed], contacts: int
    ) -> Presses:
        """Samples at frames (s,) of which so much was sensed, with so many contacts; a sample of no known
        press has a negative number.
        """

    def sharpened(self, felt: Felt) -> Self | None:
        """The same of sensors as presses tell them, with which these are to be felt again; None where sensors
        are as configured.
        """
        del felt
        return None

    @abstractmethod
    def at(self, applied: Applied, press: int) -> str:
        """Where a press is, as people read it."""

    @abstractmethod
    def further(self, applied: Applied) -> Applied:
        """Further presses all over the device, each with the largest force of those that were made; none
        belongs to another.
        """

    def places_mm(self, further: Applied) -> Float[np.ndarray, "s 2"] | None:
        """Where they are on a map; None where there is none."""
        del further
        return None

    @abstractmethod
    def certainty(self, felt: Felt, found: Fit, further: Applied, answer: Answer, out: Path) -> Certainty:
        """How sure the fitted device is, which answers so to further presses; files go beside `out`."""


def press_numbers(recording: Recording, at: Int[np.ndarray, " s"]) -> Int[np.ndarray, " s"]:
    """Of the presses that samples (s,) belong to; one of no known press is one by itself, below 0."""
    columns = recording.columns
    press = columns["press"][at] if "press" in columns else np.full(len(at), np.nan)
    return np.where(np.isfinite(press), press, -1 - np.arange(len(at))).astype(int)
