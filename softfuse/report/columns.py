"""What people read of an estimate, column by column, in files and live, derived from the names of a robot.

`contacts`; of all contacts together `x_mm`, `y_mm`, `z_mm`, `force_N` and their standard deviations; the same
of each where several may touch at once, `<contact><number>_...`, and `..._place` where places have names; of
each cable `<name>_mm` and `<name>_N`, of each chamber `<name>_Pa`, or `<name>_mm3` of one that is vented; of
each reading `<sensor>_<part>_<unit>` as measured, and by how much the model misses it, `..._misfit_<unit>`;
of each point `<name>_x_mm` ...; of the centreline `bend<link>_deg`, `curvature<link>_1_m` and `tip_bend_deg`;
`residual`, the root mean square misfit in standard deviations.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from softfuse.estimation.smoothing.smoother import Smoothed
from softfuse.estimation.stream import Estimate
from softfuse.estimation.tracked import Tracked
from softfuse.functional.chart import nearest
from softfuse.robot.names import named_places, safe_names, slot_names
from softfuse.robot.posture import Posture, Watched
from softfuse.robot.robot import Robot
from softfuse.sensors.status import Status

Value = float | str
"""A number, NaN where it is not known, or text, empty where there is none."""


@dataclass(frozen=True)
class Unit:
    """A unit: how columns' names end, how people write it, its number per SI unit, digits worth writing."""

    suffix: str
    label: str
    factor: float
    digits: int

    def of(self, name: str) -> str:
        """The name of a column in it."""
        return f"{name}_{self.suffix}" if self.suffix else name


UNITS = {
    "m": Unit("mm", "mm", 1e3, 3),
    "m^3": Unit("mm3", "mm³", 1e9, 3),
    "Pa": Unit("Pa", "Pa", 1.0, 2),
    "N": Unit("N", "N", 1.0, 4),
    "N m": Unit("Nmm", "N mm", 1e3, 3),
    "rad": Unit("deg", "deg", 180.0 / math.pi, 3),
    "1/m": Unit("1_m", "1/m", 1.0, 4),
    "m/s^2": Unit("m_s2", "m/s²", 1.0, 4),
    "K": Unit("K", "K", 1.0, 3),
    "": Unit("", "-", 1.0, 6),
}
"""By SI unit."""


def unit_of(si: str) -> Unit:
    """The unit for people of an SI unit; of one that is not among these, itself."""
    return UNITS.get(si) or Unit("".join(c if c.isalnum() else "_" for c in si), si, 1.0, 6)


@dataclass(frozen=True)
class Column:
    """One column: its name, which ends with the unit, and the digits worth writing of it; None for text."""

    name: str
    digits: int | None

    @classmethod
    def of(cls, name: str, si: str) -> "Column":
        """Of something with an SI unit."""
        unit = unit_of(si)
        return cls(unit.of(name), unit.digits)

    def written(self, value: Value) -> str:
        """The value as the field of a table; nothing where it is not known."""
        if self.digits is None or isinstance(value, str):
            return str(value)
        # Without the sign of a zero.
        return f"{round(value, self.digits) + 0.0:.{self.digits}f}" if math.isfinite(value) else ""


@dataclass(frozen=True, eq=False)
class Moment:
    """What there is to be read: an estimate, the posture of its state, all NaN where that was lost, and what
    the state is driven with (D,), contacts' forces [N] first.
    """

    tracked: Tracked
    posture: Posture
    drive: Float[np.ndarray, " D"]


def place_columns(prefix: str = "", *, sigma: bool = True) -> list[Column]:
    """Where and how hard, and how sure that is, beginning with a prefix."""
    what = [*((f"{axis}_mm", 3) for axis in "xyz"), ("force_N", 4)]
    sure = [*((f"{axis}_sigma_mm", 3) for axis in "xyz"), ("force_sigma_N", 4)]
    return [Column(prefix + name, digits) for name, digits in (*what, *(sure if sigma else sure[-1:]))]


class Columns:
    """The columns of a robot's estimates."""

    def __init__(self, robot: Robot):
        """Raises ConfigError for points outside the body."""
        settings = robot.settings
        self.watched = Watched.on(robot)
        self.slots = slot_names(settings.contacts)
        self.named: tuple[dict[str, Float[np.ndarray, "3 3"]], ...] = tuple(
            named_places(settings, contact.name)
            for contact in settings.contacts
            for _ in range(contact.at_once)
        )
        """The places with names of each slot."""
        self.places = tuple(settings.places)
        """All places that have names; their numbers are those of truth columns."""
        self.cables = safe_names(cable.name for cable in settings.cables)
        self.chambers = safe_names(chamber.name for chamber in settings.chambers)
        self.points = safe_names(point.name for point in settings.points)
        self.readings = safe_names(robot.suite.readings)
        self.units = tuple(unit_of(si) for si in robot.suite.units)
        self._drives = robot.addresses.drives
        self._factor = np.array([unit.factor for unit in self.units])
        self._vented = [chamber.gas == "vented" for chamber in settings.chambers]
        self._sealed = [chamber.gas == "sealed" for chamber in settings.chambers]
        self._links = len(settings.centreline.points) - 1 if settings.centreline else 0
        slots = len(self.slots)
        normal = robot.model.adding(slots).any(axis=0)
        self._aside = [np.flatnonzero(own & ~normal) for own in robot.model.owning(slots).astype(bool)]
        self.columns = _apart(self._all(robot.suite.units))

    def _all(self, units: tuple[str, ...]) -> Iterable[Column]:
        if self.slots:
            yield Column("contacts", 0)
            yield from place_columns()
        for slot, named, aside in zip(self.slots, self.named, self._aside, strict=True):
            prefix = f"{slot}_"
            if named:
                yield Column(prefix + "place", None)
            if len(self.slots) > 1:
                yield from place_columns(prefix, sigma=False)
            yield from (Column(f"{prefix}{axis}_N", 4) for axis, _ in zip("uv", aside, strict=False))
        for name in self.cables.values():
            yield from (Column.of(name, "m"), Column.of(name, "N"))
        for name, vented in zip(self.chambers.values(), self._vented, strict=True):
            yield Column.of(name, "m^3" if vented else "Pa")
        for name, si in zip(self.readings.values(), units, strict=True):
            yield from (Column.of(name, si), Column.of(f"{name}_misfit", si))
        for name in self.points.values():
            yield from (Column.of(f"{name}_{axis}", "m") for axis in "xyz")
        for link in range(self._links):
            yield from (Column.of(f"bend{link}", "rad"), Column.of(f"curvature{link}", "1/m"))
        if self._links:
            yield Column.of("tip_bend", "rad")
        yield Column("residual", 3)

    def moment(self, now: Estimate) -> Moment:
        """What there is to be read of an estimate."""
        posture = self.watched.posture(now.state)
        lost = Status.inverted in now.tracked.statuses
        return Moment(now.tracked, posture.unknown() if lost else posture, np.asarray(now.state.drive))

    def read(self, now: Estimate) -> list[Value]:
        """The values of the columns."""
        return self.values(self.moment(now))

    def values(self, at: Moment) -> list[Value]:
        """The values of the columns at a moment."""
        # Plain numbers: these go into files.
        return [value if isinstance(value, str) else float(value) for value in self._values(at)]

    def _values(self, at: Moment) -> Iterable[Value]:
        now, posture = at.tracked, at.posture
        if self.slots:
            yield now.contacts
            yield from (*1e3 * now.centre_m, now.force_N, *1e3 * now.centre_sigma_m, now.force_sigma_N)
        for slot, named in enumerate(self.named):
            if named:
                yield self._place(now, slot)
            if len(self.slots) > 1:
                yield from 1e3 * now.location_m[slot]
                yield from (now.contact_force_N[slot], now.contact_sigma_N[slot])
            # Where its force is not known, these are not.
            yield from at.drive[self._aside[slot]] + 0.0 * now.contact_force_N[slot]
        for name in self.cables:
            drive = self._drives[name]
            yield from (1e3 * posture.answers[drive], posture.drives[drive])
        for k, name in enumerate(self.chambers):
            if self._vented[k]:
                yield 1e9 * posture.volume_m3[k]
            else:
                yield (posture.answers if self._sealed[k] else posture.drives)[self._drives[name]]
        for pair in zip(self._factor * self.measured(now), self._factor * now.misfit, strict=True):
            yield from pair
        yield from 1e3 * posture.point_m.ravel()
        for turn, curvature in zip(posture.turn, posture.curvature, strict=True):
            yield from (math.degrees(turn), curvature)
        if self._links:
            yield math.degrees(posture.tip_turn)
        yield now.residual

    def measured(self, now: Tracked) -> Float[np.ndarray, " k"]:
        """The readings (k,) [SI], NaN where they do not count."""
        return np.where(now.valid, now.reading, np.nan)

    def _place(self, now: Tracked, slot: int) -> str:
        """The name of the place of a contact; empty where it does not touch."""
        if not now.touching[slot]:
            return ""
        names, places = zip(*self.named[slot].items(), strict=True)
        return names[int(nearest(np.stack(places), now.places[slot]))]

    def contacts(self, now: Estimate) -> tuple[Float[np.ndarray, "c 3"], Float[np.ndarray, "c 3"]]:
        """Where contacts press in the deformed shape (c, 3) [m] and the vectors (c, 3) [N] of their forces,
        along the surface's normal; NaN where there is none.
        """
        tracked = now.tracked
        known = tracked.touching & (Status.inverted not in tracked.statuses)
        places, inward = self.watched.pressed(tracked.places, now.state)
        size = np.where(known, tracked.contact_force_N, np.nan)[:, None]
        return np.where(known[:, None], places, np.nan), size * inward


def smoothed_columns(slots: tuple[str, ...], prefix: str) -> list[Column]:
    """The columns of smoothed frames: where and how hard of each contact that may touch at once."""
    several = len(slots) > 1
    return [column for slot in slots for column in place_columns(prefix + (f"{slot}_" if several else ""))]


def smoothed_values(smoothed: Smoothed | None, contacts: int) -> list[float]:
    """The values of these columns of so many contacts, NaN where unknown."""
    if smoothed is None:
        return [math.nan] * (8 * contacts)
    force, sigma = smoothed.contact_force_N[:, None], smoothed.contact_sigma_N[:, None]
    at = 1e3 * smoothed.location_m, force, 1e3 * smoothed.location_sigma_m, sigma
    return np.concatenate(at, axis=1).ravel().tolist()


def smoothed_words(smoothed: Smoothed, contact: int) -> str:
    """A contact's force and place with their standard deviations, for people to look at."""
    told = f"{smoothed.contact_force_N[contact]:.2f} ± {smoothed.contact_sigma_N[contact]:.2f} N"
    place, sigma = 1e3 * smoothed.location_m[contact], 1e3 * smoothed.location_sigma_m[contact]
    if not np.isfinite(place).all():
        return told
    return f"{told} at ({', '.join(f'{x:.1f} ± {s:.1f}' for x, s in zip(place, sigma, strict=True))}) mm"


def _apart(columns: Iterable[Column]) -> tuple[Column, ...]:
    """Columns whose names all differ: one that is there already gets a number."""
    found: dict[str, Column] = {}
    for column in columns:
        name, k = column.name, 2
        while name in found:
            name, k = f"{column.name}_{k}", k + 1
        found[name] = Column(name, column.digits)
    return tuple(found.values())
