"""Places of contacts that the readings help to find, from frame to frame.

What looks for contacts says where it sees them, p̂, and how sure it is; a contact that only the readings tell
of may be anywhere. How far the last estimate was from there, o, is where the next one starts from: a contact
that moves is followed, and what the readings add to it changes slowly. Errors of seen places last as long as
a touch, so each frame has the whole prior, and what frames before have found is not counted again.

While a contact has no force, its place changes nothing that could tell it: so long it is held.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from softfuse.estimation.step import PlacePrior

_REACH_M = 3e-3
"""How far a step moves a place at most: what depends on it is taken to be linear so far."""


@dataclass(frozen=True, eq=False)
class SoughtPlaces:
    """Which contacts (c,) are sought, whether they have been seen (c,), which are free to move and not held
    (c,), and their offset o (c, 2) [m].
    """

    sought: Bool[np.ndarray, " c"]
    seen: Bool[np.ndarray, " c"]
    free: Bool[np.ndarray, " c"]
    offset_m: Float[np.ndarray, "c 2"]

    @classmethod
    def none(cls, contacts: int) -> "SoughtPlaces":
        """Nothing has been sought."""
        no = np.zeros(contacts, bool)
        return cls(no, no, no, np.zeros((contacts, 2)))

    def next(
        self,
        sought: Bool[np.ndarray, " c"],
        seen: Bool[np.ndarray, " c"],
        force_N: Float[np.ndarray, " c"],
        room_m: tuple[Float[np.ndarray, "c 2"], Float[np.ndarray, "c 2"]],
    ) -> "SoughtPlaces":
        """Where to start from in another frame, of contacts that have had forces (c,) N and may be, at least
        and at most, so far (c, 2) m from where they were seen.
        """
        same = sought & self.sought & (seen == self.seen)
        offset = np.where(same[:, None], np.clip(self.offset_m, *room_m), 0.0)
        return SoughtPlaces(sought, seen, sought & (force_N > 0), offset)

    def begun_at(self, contact: int, offset_m: Float[np.ndarray, "2"]) -> "SoughtPlaces":
        """With one contact begun anew, held at another offset (2,) m."""
        offset, free = self.offset_m.copy(), self.free.copy()
        offset[contact], free[contact] = offset_m, False
        return replace(self, offset_m=offset, free=free)

    def rebased(self, contact: int) -> "SoughtPlaces":
        """With one contact's place counted from where it is now."""
        offset = self.offset_m.copy()
        offset[contact] = 0.0
        return replace(self, offset_m=offset)

    def prior(
        self,
        sigma_m: Float[np.ndarray, "c 2"],
        room_m: tuple[Float[np.ndarray, "c 2"], Float[np.ndarray, "c 2"]],
    ) -> PlacePrior:
        """What is known of places before the readings, with standard deviations (c, 2) m along their
        tangents as seen.

        Contacts that are held are where they are taken to be.
        """
        free = self.free[:, None]
        spread = np.diag(np.where(free, sigma_m, 0.0).ravel())
        low, high = (room - self.offset_m for room in room_m)
        reach = np.clip(low, -_REACH_M, 0.0), np.clip(high, 0.0, _REACH_M)
        return PlacePrior(np.where(free, self.offset_m, 0.0), spread, *reach)

    def found(self, offset_m: Float[np.ndarray, "c 2"]) -> "SoughtPlaces":
        """With offsets (c, 2) m that a step has found."""
        return replace(self, offset_m=np.where(self.free[:, None], offset_m, self.offset_m))
