"""What was found in the frames of a finger, one quantity after the other."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from softfuse.cli.finger_truth import FingerTruth
from softfuse.estimation.tracked import Tracked
from softfuse.experiment.contact_accuracy import NOWHERE, ContactSamples
from softfuse.experiment.posture import Posture
from softfuse.experiment.shape_accuracy import ShapeSamples
from softfuse.mechanics.solution import State
from softfuse.sensors.status import Status


@dataclass(frozen=True, eq=False)
class FingerFrame:
    """One frame with c contacts: `posture`, all NaN without an estimate; `electrode` (c,), `NOWHERE` where
    nothing touches; `place_m` (c, 3): where it touches now; `force_N` (c, 3): vector of its force; both NaN
    without contact or estimate; `pressure_Pa` (k,): measured, NaN where it is not or its zero is unknown.
    """

    now: Tracked
    posture: Posture
    electrode: Int[np.ndarray, " c"]
    place_m: Float[np.ndarray, "c 3"]
    force_N: Float[np.ndarray, "c 3"]
    pressure_Pa: Float[np.ndarray, " k"]


def finger_frame(now: Tracked, state: State, posture: Posture) -> FingerFrame:
    """A frame from what was tracked, the state after it, and that state's posture.

    A contact is at the mean of its electrode's patches, weighted by their forces.
    """
    posture = posture.unknown() if Status.inverted in now.statuses else posture
    contacts = len(now.touching)
    electrode = np.where(now.touching, now.details.electrodes.slots.electrode, NOWHERE)
    patches, inward = posture.patch_m[electrode], posture.inward[electrode]
    drive = np.asarray(state.drive)[: contacts * patches.shape[1]].reshape(contacts, -1)
    pressed = drive.sum(axis=1, keepdims=True) > 0
    weight = np.where(pressed, drive, 1.0)
    weight = weight / weight.sum(axis=1, keepdims=True)
    unknown = np.where(now.touching, 0.0, np.nan)[:, None]
    place = np.einsum("cm,cmi->ci", weight, patches) + unknown
    force = np.einsum("cm,cmi->ci", drive, inward) + unknown
    valid = now.details.pressure.valid
    pressure = np.where(valid, now.reading[len(now.reading) - len(valid) :], np.nan)
    return FingerFrame(now, posture, electrode, place, force, pressure)


@dataclass(frozen=True, eq=False)
class FingerSeries:
    """n frames of a finger with b cables, and the truth about them as far as it is known."""

    frames: list[FingerFrame]
    cables: int
    truth: FingerTruth

    def _tracked(self, name: str) -> np.ndarray:
        return np.array([getattr(frame.now, name) for frame in self.frames])

    def _posture(self, name: str) -> np.ndarray:
        return np.array([getattr(frame.posture, name) for frame in self.frames])

    @property
    def time_s(self) -> Float[np.ndarray, " n"]:
        """Time [s]."""
        return self._tracked("time_s")

    @property
    def electrode(self) -> Int[np.ndarray, "n c"]:
        """Electrodes of the contacts."""
        return np.array([frame.electrode for frame in self.frames])

    @property
    def contact_N(self) -> Float[np.ndarray, "n c"]:
        """Forces of the contacts."""
        return self._tracked("contact_force_N")

    @property
    def force_N(self) -> Float[np.ndarray, " n"]:
        """Sum of the contacts' forces."""
        return self._tracked("force_N")

    @property
    def point_m(self) -> Float[np.ndarray, "n p 3"]:
        """Positions of the points of the config."""
        return self._posture("point_m")

    @property
    def turn(self) -> Float[np.ndarray, "n l"]:
        """Bending [rad] of the centreline's links."""
        return self._posture("turn")

    @property
    def tip_turn(self) -> Float[np.ndarray, " n"]:
        """Bending [rad] of the tip against rest."""
        return self._posture("tip_turn")

    @property
    def shortening_m(self) -> Float[np.ndarray, "n b"]:
        """By how much the cables are shorter."""
        return self._posture("answers")[:, : self.cables]

    @property
    def tension_N(self) -> Float[np.ndarray, "n b"]:
        """Tensions of the cables."""
        return self._tracked("attached")[:, : self.cables]

    @property
    def measured_m(self) -> Float[np.ndarray, "n b"]:
        """Measured shortenings, NaN where they are not."""
        return np.array([frame.now.details.cable_m for frame in self.frames])

    @property
    def pressure_Pa(self) -> Float[np.ndarray, "n k"]:
        """Measured gauge pressures, NaN where they are not."""
        return np.array([frame.pressure_Pa for frame in self.frames])

    @property
    def misfit_Pa(self) -> Float[np.ndarray, "n k"]:
        """Measured minus modelled pressures."""
        return self._tracked("misfit")[:, self.cables :]

    @property
    def shape_samples(self) -> ShapeSamples | None:
        """Where the points are and truly are at the samples; None where the recording does not know."""
        truth, at = self.truth, self.truth.samples
        if truth.point_m is None or not at.size:
            return None
        measured = np.max(self.shortening_m, axis=1, initial=0.0)
        cable = np.where(np.isfinite(truth.cable_m), truth.cable_m, measured)
        return ShapeSamples(truth.press[at], truth.level[at], cable[at], self.point_m[at], truth.point_m[at])

    @property
    def contact_samples(self) -> ContactSamples | None:
        """What presses where and truly does at the samples; None where the recording does not know."""
        truth, at = self.truth, self.truth.samples
        if not truth.force_N.shape[1] or not at.size:
            return None
        return ContactSamples(
            truth.level[at], self.electrode[at], self.contact_N[at], truth.electrode[at], truth.force_N[at]
        )
