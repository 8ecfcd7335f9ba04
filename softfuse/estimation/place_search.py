"""Where contacts are, from what sees them and from the readings, frame after frame.

`SoughtPlaces` follows those that the readings help to find. One that nothing sees is begun where the pattern
of the readings points to (`ReadingPattern`), and begun anew where they say clearly that it is elsewhere; how
far it may be from where it is taken to be counts what else the pattern leaves open.
"""

from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Bool, Float

from softfuse.estimation.reading_pattern import PatternFit, ReadingPattern, offsets
from softfuse.estimation.sought_places import SoughtPlaces
from softfuse.estimation.step import PlacePrior
from softfuse.functional.chart import moved
from softfuse.functional.workspace import AbstractWorkspace
from softfuse.mechanics.model import Model
from softfuse.rom.atlas import Atlas
from softfuse.sensors.senses import Sensed


class Placed(NamedTuple):
    """Locations (c, 3) [m] of contacts, and the standard deviations (c, 2) [m] along their tangents; and the
    variance (c,) [N²] that forces have besides, for presses elsewhere.
    """

    location_m: Float[np.ndarray, "c 3"]
    sigma_m: Float[np.ndarray, "c 2"]
    elsewhere_N2: Float[np.ndarray, " c"]

    @property
    def variance_m2(self) -> Float[np.ndarray, " 2c"]:
        """Variances (2 c,) [m²] along the tangents of each contact, one after the other; 0 where unknown."""
        return np.nan_to_num(self.sigma_m.ravel()) ** 2


def unseen(sensed: Sensed) -> Bool[np.ndarray, " c"]:
    """Contacts (c,) that press, but are not seen anywhere."""
    return np.asarray(sensed.pressing) & ~_all_known(sensed.location_m)


def _all_known(numbers: Array | Float[np.ndarray, "c d"]) -> Bool[np.ndarray, " c"]:
    return np.logical_not(np.isnan(np.asarray(numbers)).any(axis=1))


def as_seen(sensed: Sensed) -> Placed:
    """What the senses say alone."""
    location = np.asarray(sensed.location_m)
    return Placed(location, np.asarray(sensed.location_sigma_m), np.zeros(len(location)))


class PlaceSearch:
    """Follows the places of c contacts of a device within a workspace."""

    def __init__(self, device: Model | Atlas, workspace: AbstractWorkspace, contacts: int):
        """Begin with nothing sought."""
        self._device, self._workspace, self._contacts = device, workspace, contacts
        self._pattern: Future[ReadingPattern] | None = None
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self._sought = SoughtPlaces.none(self._contacts)
        self._fit: PatternFit | None = None

    @property
    def sought(self) -> bool:
        """Whether readings tell a place in this frame."""
        return bool(self._sought.sought.any())

    def prepare(self) -> Future[ReadingPattern]:
        """What finds contacts that nothing sees; begun on a thread of its own, as it takes some seconds."""
        if self._pattern is None:
            thread = ThreadPoolExecutor(1)
            self._pattern = thread.submit(ReadingPattern.of, self._device, self._workspace)
            thread.shutdown(wait=False)
        return self._pattern

    def taken(self, sensed: Sensed) -> Float[np.ndarray, "c 3 3"]:
        """Where contacts are taken to be (c, 3, 3)."""
        return np.asarray(moved(np.asarray(sensed.places), self._sought.offset_m))

    def seek(
        self,
        sensed: Sensed,
        told: Bool[np.ndarray, " c"],
        force_N: Float[np.ndarray, " c"],
        reading: Float[np.ndarray, " k"],
        covariance: Float[np.ndarray, "k k"],
    ) -> bool:
        """Another frame, in which readings (k,) of a covariance (k, k) tell places of the contacts (c,) that
        are `told`, with forces (c,) N before. Whether one is begun anew, as if nothing had pressed.
        """
        self._fit = None
        if not (self.sought or told.any()):
            return False
        places, pressing = np.asarray(sensed.places), np.asarray(sensed.pressing)
        seen, known = _all_known(sensed.location_m), _all_known(sensed.location_sigma_m)
        sought = pressing & told & known
        self._sought = self._sought.next(sought, seen, force_N, self._workspace.room(places))
        # The pattern is that of one press in a workspace.
        if pressing.sum() != 1 or not unseen(sensed).any():
            return False
        contact = int(np.argmax(pressing))
        self._fit = self.prepare().result().fitted(reading, covariance, np.asarray(sensed.valid))
        better = self._fit.better(self.taken(sensed)[contact])
        if better is None:
            return False
        self._sought = self._sought.begun_at(contact, offsets(places[contact], better[None])[0])
        return True

    def prior(self, sensed: Sensed) -> PlacePrior:
        """What is known of the places before the readings."""
        room = self._workspace.room(np.asarray(sensed.places))
        return self._sought.prior(np.asarray(sensed.location_sigma_m), room)

    def found(
        self,
        sensed: Sensed,
        offset_m: Float[np.ndarray, "c 2"],
        covariance_m2: Float[np.ndarray, "2c 2c"],
        force_N: Float[np.ndarray, " c"],
    ) -> Placed:
        """Where contacts are after a step that found offsets (c, 2) m of a covariance, and forces (c,) N."""
        self._sought = self._sought.found(offset_m)
        sought, free = self._sought.sought[:, None], self._sought.free[:, None]
        taken = self.taken(sensed)
        location = np.where(sought, taken[:, 0], sensed.location_m)
        told = np.sqrt(np.diag(covariance_m2)).reshape(-1, 2)
        sigma = np.where(free, told, sensed.location_sigma_m)
        elsewhere_N2 = np.zeros(self._contacts)
        if self._fit is not None:
            contact = int(np.argmax(sensed.pressing))
            other = self._fit.elsewhere(taken[contact], float(force_N[contact]))
            here = (1 - other.share) * sigma[contact] ** 2
            sigma[contact] = np.sqrt(here + other.share * other.place_m2)
            elsewhere_N2[contact] = other.share * other.force_N2
        return Placed(location, sigma, elsewhere_N2)
