"""Electrodes of a virtual pad: what they say about the grounded punch that hovers over it or is pressed in.

* Crossed lines: their capacitances [F] in the field of the punch (`pad_field`). Pressed in, the punch takes
  the electrodes below it along; those around it lag behind and come nearer to its wall. Electrodes are moved
  up and down with the body, those under the punch by the mean of their layer there, since the distance of a
  millimetre that matters is less than what a coarse mesh resolves point by point. Sideways they are left in
  place: the silicone under a flat punch hardly flows (not at all if incompressible and deep: Johnson, Contact
  Mechanics, 1985, Sec. 3.4).
* A grid of mutual capacitances: changes of its cells relative to those at rest [-] (`mutual_field`). They
  take from a press its force alone, which squeezes their layers. Not modelled: that a punch presses hardest
  at its rim, its wall, and electrodes that are bent with the surface.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from softfuse.experiment.virtual_pad import PadPose
from softfuse.sensors.crossed.field import ArrayField, CrossedLines, FieldSettings
from softfuse.sensors.mutual.field import MutualField, Thing


class AbstractPadElectrodes(ABC):
    """e electrodes; the representation of one says all about it, see `pose_cache`."""

    @property
    @abstractmethod
    def points(self) -> Float[np.ndarray, "m 3"]:
        """Places (m, 3) m on the pad at rest, z from its top, that must be followed when it is pressed."""

    @abstractmethod
    def near(self, at: tuple[float, float], gap: float) -> Float[np.ndarray, " e"]:
        """What they say (e,) under a punch with its middle at x, y [m], at a gap [m] from the surface."""

    @abstractmethod
    def pressed(
        self, at: tuple[float, float], pose: PadPose, moved: Float[np.ndarray, "m 3"]
    ) -> Float[np.ndarray, " e"]:
        """What they say (e,) in an equilibrium under a punch with its middle at x, y [m], where the points
        are then: moved (m, 3) m, z from the top at rest.
        """


@dataclass(frozen=True)
class LineElectrodes(AbstractPadElectrodes):
    """Crossed lines, rows first, and the field, with the punch in it."""

    lines: CrossedLines
    field: FieldSettings

    @cached_property
    def _array(self) -> ArrayField:
        return ArrayField(self.lines, self.field)

    @property
    def points(self) -> Float[np.ndarray, "m 3"]:
        """The middles of the electrodes' squares."""
        return self._array.panels.middle

    def near(self, at: tuple[float, float], gap: float) -> Float[np.ndarray, " e"]:
        """Capacitances (e,) F."""
        return self._array.lines(at, gap)

    def pressed(
        self, at: tuple[float, float], pose: PadPose, moved: Float[np.ndarray, "m 3"]
    ) -> Float[np.ndarray, " e"]:
        """Capacitances (e,) F."""
        return self._array.lines(at, -pose.depth, self._placed(at, moved))

    def _placed(self, at: tuple[float, float], moved: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        """Where the squares (m, 3) m count as being, those under the punch at the mean of a layer."""
        rest = self.points
        under = np.hypot(*(rest[:, :2] - at).T) < self.field.radius
        placed = np.column_stack([rest[:, :2], moved[:, 2]])
        for layer in np.unique(rest[:, 2]):
            those = under & (rest[:, 2] == layer)
            placed[those, 2] = moved[those, 2].mean() if those.any() else 0.0
        return placed


@dataclass(frozen=True)
class GridElectrodes(AbstractPadElectrodes):
    """A grid of mutual capacitances, cells row by row, in each row along x; radius of the punch in m."""

    field: MutualField
    radius: float

    @property
    def points(self) -> Float[np.ndarray, "m 3"]:
        """None."""
        return np.zeros((0, 3))

    def near(self, at: tuple[float, float], gap: float) -> Float[np.ndarray, " e"]:
        """Relative changes (e,)."""
        return self._under(Thing(at, distance=gap, radius=self.radius))

    def pressed(
        self, at: tuple[float, float], pose: PadPose, moved: Float[np.ndarray, "m 3"]
    ) -> Float[np.ndarray, " e"]:
        """Relative changes (e,)."""
        del moved
        return self._under(Thing(at, force=pose.force, radius=self.radius))

    def _under(self, punch: Thing) -> Float[np.ndarray, " e"]:
        return self.field.with_crosstalk(self.field.change([punch])).T.ravel()
