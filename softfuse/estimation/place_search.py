"""Where contacts are, from what sees them and from the readings, frame after frame.

`SoughtPlaces` follows those that the readings help to find. One that nothing sees is begun where the pattern
of the readings points to (`unseen_touch`), and begun anew where they say clearly that it is elsewhere; how
far it may be from where it is taken to be counts what else the pattern leaves open. It stays on the surface:
after each frame its place is carried back onto it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from softfuse.estimation.step import PlacePrior
from softfuse.estimation.unseen_touch import PatternFit
from softfuse.functional.chart import moved
from softfuse.functional.workspace import AbstractWorkspace

_REACH_M = 3e-3
"""How far a step moves a place at most: what depends on it is taken to be linear so far."""

_OPEN = 0.1
"""Share of presses elsewhere from which on a place is one of several."""


@dataclass(frozen=True, eq=False)
class SoughtPlaces:
    """Which contacts (c,) are sought, whether they have been seen (c,), which are free to move and not held
    (c,), and their offset o (c, 2) [m] from where they were seen.

    From there the next estimate starts: a contact that moves is followed, and what the readings add to it
    changes slowly. Errors of seen places last as long as a touch, so each frame has the whole prior, and what
    frames before have found is not counted again. While a contact has no force, its place changes nothing
    that could tell it: so long it is held.
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
        """What is known before the readings of places seen so surely, (c, 2) m along their tangents.

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


@dataclass(frozen=True, eq=False)
class Seen:
    """What is known of c contacts before the readings tell: which press (c,), and are seen by no sensor,
    `unseen` (c,); `places` (c, 3, 3); where sensors locate them (c, 3) [m] and how surely along the tangents
    (c, 2) [m], NaN where they do not.
    """

    pressing: Bool[np.ndarray, " c"]
    unseen: Bool[np.ndarray, " c"]
    places: Float[np.ndarray, "c 3 3"]
    location_m: Float[np.ndarray, "c 3"]
    sigma_m: Float[np.ndarray, "c 2"]


class Placed(NamedTuple):
    """Locations (c, 3) [m] of contacts, and the standard deviations (c, 2) [m] along their tangents; the
    variance (c,) [N²] that forces have besides, for presses elsewhere; and whether these are as likely as to
    be told, `ambiguous` (c,).
    """

    location_m: Float[np.ndarray, "c 3"]
    sigma_m: Float[np.ndarray, "c 2"]
    elsewhere_N2: Float[np.ndarray, " c"]
    ambiguous: Bool[np.ndarray, " c"]

    @property
    def variance_m2(self) -> Float[np.ndarray, " two_c"]:
        """Variances (2 c,) [m²] along the tangents of each contact, one after the other; 0 where unknown."""
        return np.nan_to_num(self.sigma_m.ravel()) ** 2


def as_seen(seen: Seen) -> Placed:
    """What the sensors say alone."""
    count = len(seen.location_m)
    return Placed(seen.location_m, seen.sigma_m, np.zeros(count), np.zeros(count, bool))


class PlaceSearch:
    """Follows the places of c contacts, each within a workspace, or where sensors see it if it has none."""

    def __init__(self, workspaces: Sequence[AbstractWorkspace | None]):
        """Begin with nothing sought."""
        self._workspaces = tuple(workspaces)
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        count = len(self._workspaces)
        self._sought = SoughtPlaces.none(count)
        self._base: list[Float[np.ndarray, "3 3"] | None] = [None] * count
        self._fit: PatternFit | None = None
        self._fitted = -1

    @property
    def sought(self) -> bool:
        """Whether readings tell a place in this frame."""
        return bool(self._sought.sought.any())

    def taken(self, seen: Seen) -> Float[np.ndarray, "c 3 3"]:
        """Where contacts are taken to be (c, 3, 3)."""
        return moved(self._bases(seen), self._sought.offset_m)

    def _bases(self, seen: Seen) -> Float[np.ndarray, "c 3 3"]:
        places = np.array(seen.places)
        for c, base in enumerate(self._base):
            if base is not None:
                places[c] = base
        return places

    def seek(
        self,
        seen: Seen,
        told: Bool[np.ndarray, " c"],
        force_N: Float[np.ndarray, " c"],
        fit: PatternFit | None,
    ) -> bool:
        """Another frame, in which readings tell places of the contacts (c,) that are `told`, with forces (c,)
        N before; `fit`: how well presses all over explain what nothing else does. Whether one is begun anew,
        as if nothing had pressed.
        """
        self._fit = None
        for c in range(len(self._base)):
            if not (seen.pressing[c] and seen.unseen[c]):
                self._base[c] = None
        if not (self.sought or told.any()):
            return False
        known = ~np.isnan(seen.sigma_m).any(axis=1)
        located = np.asarray(~np.isnan(seen.location_m).any(axis=1))
        sought = seen.pressing & told & known
        self._sought = self._sought.next(sought, located, force_N, self._rooms(seen))
        if fit is None:
            return False
        # The pattern is that of one press.
        contact = int(np.argmax(seen.pressing & seen.unseen))
        self._fit, self._fitted = fit, contact
        base = self._base[contact]
        better = fit.place[fit.best] if base is None else fit.better(self.taken(seen)[contact])
        if better is None:
            return False
        self._base[contact] = better
        self._sought = self._sought.begun_at(contact, np.zeros(2))
        return True

    def prior(self, seen: Seen) -> PlacePrior:
        """What is known of the places before the readings."""
        return self._sought.prior(seen.sigma_m, self._rooms(seen))

    def found(
        self,
        seen: Seen,
        offset_m: Float[np.ndarray, "c 2"],
        covariance_m2: Float[np.ndarray, "2*c 2*c"],
        force_N: Float[np.ndarray, " c"],
    ) -> tuple[Placed, Float[np.ndarray, "c 3 3"]]:
        """Where contacts are, and places (c, 3, 3), after a step to offsets (c, 2) m and forces (c,) N."""
        self._sought = self._sought.found(offset_m)
        taken = self.taken(seen)
        for c, base in enumerate(self._base):
            workspace = self._workspaces[c]
            if base is not None and workspace is not None:
                taken[c] = self._base[c] = workspace.landed(taken[c][None])[0]
                self._sought = self._sought.rebased(c)
        sought, free = self._sought.sought[:, None], self._sought.free[:, None]
        location = np.where(sought, taken[:, 0], seen.location_m)
        told = np.sqrt(np.diag(covariance_m2)).reshape(-1, 2)
        sigma = np.where(free, told, seen.sigma_m)
        elsewhere_N2, ambiguous = np.zeros(len(location)), np.zeros(len(location), bool)
        if self._fit is not None:
            c = self._fitted
            other = self._fit.elsewhere(taken[c], float(force_N[c]))
            here = (1 - other.share) * sigma[c] ** 2
            sigma[c] = np.sqrt(here + other.share * other.place_m2)
            elsewhere_N2[c] = other.share * other.force_N2
            ambiguous[c] = other.share > _OPEN
        return Placed(location, sigma, elsewhere_N2, ambiguous), taken

    def _rooms(self, seen: Seen) -> tuple[Float[np.ndarray, "c 2"], Float[np.ndarray, "c 2"]]:
        """How far along their tangents the bases of places may move, at least and at most."""
        low, high = np.full((2, len(self._workspaces), 2), np.inf)
        low = -low
        for c, (workspace, base) in enumerate(zip(self._workspaces, self._bases(seen), strict=True)):
            if workspace is not None:
                low[c], high[c] = (each[0] for each in workspace.room(base[None]))
        return low, high
