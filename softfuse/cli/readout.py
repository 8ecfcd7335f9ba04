"""What people read of an estimate, column by column, in mm, N, mm³, Pa, degrees: in files and live."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from softfuse.cli.finger_series import FingerFrame, finger_frame
from softfuse.config.contact import DiscSettings, PatchSettings
from softfuse.estimation.tracked import Tracked
from softfuse.experiment.contact_accuracy import NOWHERE
from softfuse.experiment.watched import build_watched
from softfuse.mechanics.model import Model
from softfuse.mechanics.solution import State
from softfuse.robot.file import RobotSettings
from softfuse.robot.mesh import RobotMesh

Value = float | str
"""A number, NaN where it is not known, or text, empty where there is none."""


@dataclass(frozen=True)
class Column:
    """One column: its name, which ends with the unit, and how many digits of a number are worth writing; None
    for text.
    """

    name: str
    digits: int | None

    def written(self, value: Value) -> str:
        """The value as the field of a table; nothing where it is not known."""
        if self.digits is None or isinstance(value, str):
            return str(value)
        return f"{value:.{self.digits}f}" if math.isfinite(value) else ""


class AbstractReadout(ABC):
    """Reads the columns of one kind of device off its estimates."""

    @property
    @abstractmethod
    def columns(self) -> tuple[Column, ...]:
        """The columns, from `contacts` to `residual`."""

    @abstractmethod
    def read(self, now: Tracked, state: State) -> list[Value]:
        """The values of the columns for an estimate and the state that it leaves the device in."""

    @abstractmethod
    def forces(self, now: Tracked, state: State) -> tuple[Float[np.ndarray, "c 3"], Float[np.ndarray, "c 3"]]:
        """Where contacts press [m] and the vectors of their forces [N]; NaN where there is none."""

    @abstractmethod
    def cavities(self, now: Tracked) -> Float[np.ndarray, " k"]:
        """What is measured of each cavity, volume change [m³] or pressure [Pa]; NaN where it is not."""

    @abstractmethod
    def image(self, now: Tracked) -> Float[np.ndarray, "r s"] | None:
        """What the electrodes see, over rows and columns; None where they are not in a grid."""


_OF_DISC = (("x_mm", 3), ("y_mm", 3), ("force_N", 4))
_SIGMAS = (("x_sigma_mm", 3), ("y_sigma_mm", 3), ("force_sigma_N", 4))


class PadReadout(AbstractReadout):
    """Where and how hard, of each contact when there may be several, and the volume change of each cavity."""

    def __init__(self, config: RobotSettings):
        """The columns of a pad."""
        volumes = [Column(f"dV{k}_mm3", 3) for k in range(len(config.cavities))]
        place = [Column(what, digits) for what, digits in (*_OF_DISC, *_SIGMAS)]
        assert isinstance(config.contact, DiscSettings)  # crossed electrodes and grids go with no other
        most = config.contact.max_contacts
        self._several = range(most if most > 1 else 0)
        of_each = (*_OF_DISC, _SIGMAS[-1])
        each = [Column(f"contact{c}_{what}", digits) for c in self._several for what, digits in of_each]
        self._columns = (Column("contacts", 0), *place, *each, *volumes, Column("residual", 3))
        self._direction = np.array(config.contact.direction)

    @property
    def columns(self):
        """Contacts, middle and sum of the forces and how sure they are, each contact, volumes, residual
        [mm³].
        """
        return self._columns

    def read(self, now, state):
        """In mm, N and mm³."""
        del state
        place = [1e3 * float(x) for x in now.centre_m[:2]]
        sure = [*(1e3 * float(x) for x in now.centre_sigma_m), now.force_sigma_N]
        volumes = [1e9 * float(v) for v in now.reading]
        each = []
        for c in self._several:
            force, sigma = float(now.contact_force_N[c]), float(now.contact_sigma_N[c])
            each += [*(1e3 * float(x) for x in now.location_m[c, :2]), force, sigma]
        return [now.contacts, *place, now.force_N, *sure, *each, *volumes, 1e9 * now.residual]

    def forces(self, now, state):
        """At its place on the body at rest, along the direction in which the contact pushes."""
        del state
        size = np.where(now.touching, now.contact_force_N, np.nan)
        return now.location_m, size[:, None] * self._direction

    def cavities(self, now):
        """Volume changes."""
        return now.reading

    def image(self, now):
        """Rows upwards, as seen from above."""
        return now.details.image.T[::-1]


_OF_CONTACT = (
    *(("electrode", None), ("x_mm", 3), ("y_mm", 3), ("z_mm", 3)),
    *(("force_N", 4), ("force_sigma_N", 4)),
)


class FingerReadout(AbstractReadout):
    """Contacts, cables, pressures, points, bending of the centreline."""

    def __init__(self, config: RobotSettings, device: Model, mesh: RobotMesh):
        """The columns of a finger; raises ConfigError for points outside the body."""
        self._watched = build_watched(config, device, mesh)
        self._electrodes = [electrode.name for electrode in config.electrodes]
        links = range(len(config.centreline.points) - 1 if config.centreline else 0)
        assert isinstance(config.contact, PatchSettings)  # single electrodes go with no other
        self._cables = len(config.cables)
        contacts, cables = range(config.contact.max_contacts), range(self._cables)
        cavities, points = range(len(config.cavities)), [point.name for point in config.points]
        self._columns = (
            Column("contacts", 0),
            *(Column(f"contact{c}_{what}", digits) for c in contacts for what, digits in _OF_CONTACT),
            *(Column("force_N", 4), Column("force_sigma_N", 4)),
            *(Column(f"cable{k}_{unit}", digits) for k in cables for unit, digits in (("mm", 3), ("N", 4))),
            *(Column(f"pressure{k}_{what}", 2) for k in cavities for what in ("Pa", "misfit_Pa")),
            *(Column(f"{name}_{axis}_mm", 3) for name in points for axis in "xyz"),
            *(
                Column(f"{name}{j}_{unit}", digits)
                for j in links
                for name, unit, digits in (("bend", "deg", 3), ("curvature", "1_m", 4))
            ),
            *([Column("tip_bend_deg", 3)] if links else []),
            Column("residual", 3),
        )

    @property
    def columns(self):
        """Of each contact, cable, cavity, point and link; residual [Pa]."""
        return self._columns

    def frame(self, now: Tracked, state: State) -> FingerFrame:
        """What there is to be read."""
        return finger_frame(now, state, self._watched.posture(state))

    def read(self, now, state):
        """In mm, N, Pa, degrees and 1/m; a contact's place is where it is now."""
        return self.values(self.frame(now, state))

    def forces(self, now, state):
        """Where they touch now, along the surface's current normal."""
        seen = self.frame(now, state)
        return seen.place_m, seen.force_N

    def cavities(self, now):
        """Gauge pressures."""
        return now.reading[self._cables :]

    def image(self, now):
        """Single electrodes make no image."""
        del now
        return None

    def values(self, seen: FingerFrame) -> list[Value]:
        """The values of the columns for a frame."""
        now, posture, values = seen.now, seen.posture, []
        forces = zip(now.contact_force_N, now.contact_sigma_N, strict=True)
        for e, place, force in zip(seen.electrode, seen.place_m, forces, strict=True):
            values += ["" if e == NOWHERE else self._electrodes[e], *1e3 * place, *force]
        values += [now.force_N, now.force_sigma_N]
        for shorter, tension in zip(
            posture.answers[: self._cables], now.attached[: self._cables], strict=True
        ):
            values += [1e3 * shorter, tension]
        misfit = now.misfit[self._cables :]
        for pair in zip(seen.pressure_Pa, misfit, strict=True):
            values += pair
        values += [*1e3 * posture.point_m.ravel()]
        for turn, curvature in zip(posture.turn, posture.curvature, strict=True):
            values += [np.rad2deg(turn), curvature]
        values += [np.rad2deg(posture.tip_turn)] if len(posture.turn) else []
        known = misfit[np.isfinite(misfit)]
        residual = float(np.sqrt(np.mean(known**2))) if known.size else math.nan
        # Plain numbers: these go into files.
        plain = [value if isinstance(value, str) else float(value) for value in values]
        return [now.contacts, *plain, residual]


def readout_of(config: RobotSettings, device: Model, mesh: RobotMesh) -> AbstractReadout:
    """The readout of the device's kind of sensors, which it has."""
    assert config.sensors is not None  # sensor_columns has told
    return PadReadout(config) if config.sensors.vented else FingerReadout(config, device, mesh)
