"""Where readings alone say that something presses: their pattern, compared with that of presses all over.

A press with a small force F at a place p of a grid changes the readings by F w(p), w(p) = ∂s/∂F of the body
at rest. Of readings y with errors of covariance L Lᵀ, the place where

    χ²(p) = min over F ≥ 0 of |L⁻¹ (y − F w(p))|²

is least explains them best. That is rough, as under larger forces patterns change, but it finds the region
from which the estimate's own steps go on to the place itself, and tells of others that the readings do not
rule out: presses there have a share of exp(−χ²/2) over that of all.
"""

import logging
from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from softfuse.errors import SoftfuseError
from softfuse.estimation.model_error import missed, whitening
from softfuse.estimation.rest_response import rest_response
from softfuse.functional.workspace import AbstractWorkspace
from softfuse.mechanics.model import Model
from softfuse.rom.atlas import Atlas

log = logging.getLogger(__name__)

_SIDE = 13
"""Places of the grid along x and along y."""
_CHANGED = 0.05
"""Part of a reading by which the pattern at rest may be off that under a force."""
_CLEARLY = 9.0
"""By how much χ² has to be less elsewhere for the search to begin anew there."""


def _slopes_on_charts(atlas: Atlas, places: Float[np.ndarray, "s 3 3"]) -> Float[np.ndarray, "s k"]:
    """∂s/∂F (s, k) [SI/N] at rest, each place on the chart of its region."""
    each = []
    for place in places:
        number = atlas.regions.find(place)
        device = atlas.full if number is None else atlas.chart(number).device
        each.append(np.asarray(rest_response(device, jnp.asarray(place)[None]).by_force)[0])
    return np.array(each)


@dataclass(frozen=True, eq=False)
class ReadingPattern:
    """Readings per newton `slope` (s, k) [SI/N] of presses at places (s, 3, 3), `pitch_m` (2,) apart."""

    place: Float[np.ndarray, "s 3 3"]
    pitch_m: Float[np.ndarray, "2"]
    slope: Float[np.ndarray, "s k"]

    @classmethod
    def of(cls, device: Model | Atlas, workspace: AbstractWorkspace, side: int = _SIDE) -> "ReadingPattern":
        """Of presses on a grid over a workspace."""
        places, pitch = workspace.grid(side)
        if isinstance(device, Atlas):
            try:
                return cls(places, pitch, _slopes_on_charts(device, places))
            except SoftfuseError as error:
                log.warning("the full body is used: %s", error)
        full = device.full if isinstance(device, Atlas) else device
        return cls(places, pitch, np.asarray(rest_response(full, jnp.asarray(places)).by_force))

    def fitted(
        self,
        reading: Float[np.ndarray, " k"],
        covariance: Float[np.ndarray, "k k"],
        valid: Bool[np.ndarray, " k"],
    ) -> "PatternFit":
        """How well a press at each place explains valid readings (k,) of a covariance (k, k)."""
        reading = np.where(valid, reading, 0.0)
        white = whitening(covariance + np.diag(missed(reading, _CHANGED) ** 2), valid)
        seen, slope = white @ reading, self.slope @ white.T
        size = np.maximum(np.sum(slope**2, axis=1), np.finfo(float).tiny)
        force = np.maximum(slope @ seen, 0.0) / size
        return PatternFit(self.place, self.pitch_m, force, seen @ seen - force**2 * size)


def offsets(place: Float[np.ndarray, "3 3"], others: Float[np.ndarray, "s 3 3"]) -> Float[np.ndarray, "s 2"]:
    """How far others (s, 3, 3) are from a place (3, 3), along its tangents (s, 2) [m]."""
    return (others[:, 0] - place[0]) @ place[1:].T


class Elsewhere(NamedTuple):
    """What share [-] presses elsewhere have, and the mean squares of how far places, along the estimate's
    tangents (2,) [m²], and the force [N²] of these are from the estimate.
    """

    share: float
    place_m2: Float[np.ndarray, "2"]
    force_N2: float


@dataclass(frozen=True, eq=False)
class PatternFit:
    """The force (s,) [N] that explains readings best at each place (s, 3, 3), `pitch_m` (2,) apart, and its
    χ² (s,).
    """

    place: Float[np.ndarray, "s 3 3"]
    pitch_m: Float[np.ndarray, "2"]
    force_N: Float[np.ndarray, " s"]
    missing: Float[np.ndarray, " s"]

    def better(self, place: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"] | None:
        """The best place (3, 3), None where it is not clearly better than another one (3, 3)."""
        here = np.argmin(np.sum(offsets(place, self.place) ** 2, axis=1))
        best = np.argmin(self.missing)
        return self.place[best] if self.missing[here] - self.missing[best] > _CLEARLY else None

    def elsewhere(self, place: Float[np.ndarray, "3 3"], force_N: float) -> Elsewhere:
        """Presses that explain the readings too, further than the grid's pitch from one at a place (3, 3)
        with a force [N].
        """
        off = offsets(place, self.place)
        away = np.any(np.abs(off) > self.pitch_m, axis=1)
        part = np.exp(-0.5 * (self.missing - self.missing.min()))
        part = np.where(away, part / part.sum(), 0.0)
        share = part.sum()
        part = part / max(share, np.finfo(float).tiny)
        return Elsewhere(float(share), part @ off**2, float(part @ (self.force_N - force_N) ** 2))
