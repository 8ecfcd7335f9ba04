"""What sensors may be attached to, by name: the robot's builder makes it, sensors only read it; and what they
may see.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from softfuse.body.base import AbstractBody
from softfuse.errors import ConfigError
from softfuse.functional.cavity import Cavity
from softfuse.functional.chart import FlatChart, facing

ATMOSPHERE_PA = 101325.0
"""Absolute pressure around what nobody has measured it for [Pa]."""

ROOM_K = 293.15
"""Temperature where none is given [K]."""

GRAVITY_M_S2 = (0.0, 0.0, -9.81)
"""Gravity where none is given [m/s²]."""


@dataclass(frozen=True, eq=False)
class ChamberPart:
    """A chamber: its enclosed volume, its number among the actuators' drives, None where it is vented; what
    is outside [Pa, absolute], its volume at rest and that of tube and port [m³]; whether its gas is `sealed`
    in, so that its pressure answers, or else driven to a pressure.
    """

    cavity: Cavity
    drive: int | None = None
    sealed: bool = False
    atmosphere: float = ATMOSPHERE_PA
    rest_volume: float = 0.0
    dead_volume: float = 0.0
    exponent: float = 1.0


@dataclass(frozen=True, eq=False)
class CablePart:
    """A pulled cable: its number among the actuators' drives, and among their loads; its tension is the
    drive, its shortening the answer.
    """

    drive: int
    load: int


@dataclass(frozen=True, eq=False)
class ContactPart:
    """What may press: the coordinates of its places, None where it has none; radius [m], how many at once,
    and the lowest and highest coordinates (2,) [m] of middles; `somewhere`: where it may press (3, 3).
    """

    chart: FlatChart | None
    radius: float
    slots: int = 1
    low: Float[np.ndarray, "2"] = field(default_factory=lambda: np.full(2, -np.inf))
    high: Float[np.ndarray, "2"] = field(default_factory=lambda: np.full(2, np.inf))
    somewhere: Float[np.ndarray, "3 3"] = field(default_factory=lambda: facing(np.zeros(3), (0, 0, -1)))


@dataclass(frozen=True, eq=False)
class TrueContact:
    """What really presses on a virtual body, or hovers over it, at a place (3, 3) of the body at rest.

    gap: from the surface [m], negative by how deep it is pressed in; force [N]; radius [m]. middle (3,) and
    axis (3,): of what touches as it stands now [m]; half_length [m]: of a cylinder along the axis, 0 for a
    ball.
    """

    place: Float[np.ndarray, "3 3"]
    gap: float = 0.0
    force: float = 0.0
    radius: float = 8e-3
    middle: Float[np.ndarray, "3"] | None = None
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    half_length: float = 0.0


@dataclass(frozen=True, eq=False)
class Parts:
    """The body, its outer faces (f, s), and all that has a name; gravity (3,) [m/s²], atmosphere [Pa,
    absolute] and temperature [K] around it.
    """

    body: AbstractBody
    faces: Int[np.ndarray, "f s"]
    chambers: Mapping[str, ChamberPart] = field(default_factory=dict)
    cables: Mapping[str, CablePart] = field(default_factory=dict)
    contacts: Mapping[str, ContactPart] = field(default_factory=dict)
    points: Mapping[str, Float[np.ndarray, "3"]] = field(default_factory=dict)
    gravity: tuple[float, float, float] = GRAVITY_M_S2
    atmosphere: float = ATMOSPHERE_PA
    temperature: float = ROOM_K

    def chambers_of(self, sensor: str, names: Sequence[str]) -> list[ChamberPart]:
        """The chambers that a sensor names; raises ConfigError for one that there is not."""
        return [_named(self.chambers, "chamber", sensor, name) for name in names]

    def cables_of(self, sensor: str, names: Sequence[str]) -> list[CablePart]:
        """The cables that a sensor names; raises ConfigError for one that there is not."""
        return [_named(self.cables, "cable", sensor, name) for name in names]

    def contact_of(self, sensor: str, name: str) -> ContactPart:
        """The contact that a sensor names; raises ConfigError where there is none of that name."""
        return _named(self.contacts, "contact", sensor, name)

    def point_of(self, sensor: str, name: str) -> Float[np.ndarray, "3"]:
        """The place (3,) m at rest of a point that a sensor names; raises ConfigError where there is none."""
        return np.asarray(_named(self.points, "point", sensor, name), float)


def _named(parts, kind: str, sensor: str, name: str):
    if name not in parts:
        known = ", ".join(f'"{each}"' for each in parts) or "none"
        raise ConfigError(f'sensor "{sensor}": there is no {kind} "{name}", but {known}')
    return parts[name]
