"""What `softfuse estimate` has to say about a recording of one kind of device: a study of it.

A study sees every frame and then gives its columns of estimates.csv, its part of summary.json, its sections
of report.html and the shapes worth keeping. What all devices share is in `recording_report`.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from softfuse.cli.joined import Joined
from softfuse.cli.readout import AbstractReadout, Value
from softfuse.estimation.shape_spread import displacement_sigma
from softfuse.estimation.tracked import Tracked
from softfuse.experiment.accuracy import Spread
from softfuse.hardware.recording import Recording
from softfuse.mechanics.model import Model
from softfuse.mechanics.solution import State
from softfuse.robot.file import RobotSettings
from softfuse.robot.mesh import RobotMesh


@dataclass(frozen=True, eq=False)
class Peak:
    """A frame in which something was largest, how large, and the device's state then."""

    frame: int
    size: float
    state: State


@dataclass(frozen=True, eq=False)
class Estimated:
    """A device, a recording of it, and what has been found in its frames so far."""

    config: RobotSettings
    device: Model
    mesh: RobotMesh
    recording: Recording
    found: list[Tracked] = field(default_factory=list)

    def shape_sigma_m(self, peak: Peak) -> Float[np.ndarray, "k 3"]:
        """Standard deviations (k, 3) m of the nodes' displacements then."""
        row = self.found[peak.frame]
        return displacement_sigma(self.device, peak.state, row.places, row.covariance)


class Peaks:
    """Keeps the peak of each run of frames, such as a touch, while the frames go by."""

    def __init__(self):
        """Nothing has been seen."""
        self.kept: list[Peak] = []
        self._within_run = False

    def see(self, frame: int, going: bool, size: float, state: State) -> None:
        """Look at the next frame, in which a run is `going` or not; without a positive size it only ends a
        run or lets it go on.
        """
        if not going:
            self._within_run = False
        elif size > 0:
            if not self._within_run:
                self.kept.append(Peak(frame, size, state))
            elif size > self.kept[-1].size:
                self.kept[-1] = Peak(frame, size, state)
            self._within_run = True


@dataclass(frozen=True)
class ErrorTable:
    """Errors against truth by group, in a unit for people.

    `key`: in summary.json; `title`: in the report; `name`: on the terminal.
    """

    key: str
    title: str
    name: str
    unit: str
    groups: dict[str, Spread]


class AbstractStudy(ABC):
    """Sees the frames of a recording one after the other; afterwards it can be asked."""

    @property
    @abstractmethod
    def readout(self) -> AbstractReadout:
        """What the columns of estimates.csv are."""

    @abstractmethod
    def see(self, now: Tracked, state: State) -> None:
        """Look at the next frame and the state that it leaves the device in."""

    @abstractmethod
    def values(self, frame: int) -> list[Value]:
        """The values of the readout's columns for a frame that it has seen."""

    @property
    @abstractmethod
    def peaks(self) -> list[Peak]:
        """The shapes to be kept, in the order of their frames."""

    @property
    @abstractmethod
    def errors(self) -> list[ErrorTable]:
        """Errors against truth; none where the recording does not hold it."""

    def joined_errors(self, joined: Joined) -> list[ErrorTable]:
        """Errors against truth of joined frames; none where it has no such."""
        del joined
        return []

    @abstractmethod
    def numbers(self) -> dict[str, Any]:
        """What it adds to summary.json besides the errors."""

    @abstractmethod
    def sections(self) -> list[tuple[str, str]]:
        """Headings and HTML of its sections in the report."""


def known(value: float) -> float | None:
    """A number for JSON, which has no NaN."""
    return float(value) if math.isfinite(value) else None
