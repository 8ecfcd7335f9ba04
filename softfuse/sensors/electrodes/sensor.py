"""Single electrodes, each on a patch of skin of its own, anywhere on the body: which of them are touched.

A slot that passes from one electrode to another is without force for one frame: a force belongs to its place.
"""

from collections.abc import Sequence
from typing import Annotated, Literal, NamedTuple, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from annotated_types import Ge, Lt
from jaxtyping import Array, Bool, Float, Int
from pydantic import model_validator

from softfuse.functional.chart import FlatChart
from softfuse.io.quantity import (
    Number,
    PositiveInteger,
    PositiveLength,
    PositiveNumber,
    PositiveTime,
    wrong_value,
)
from softfuse.io.settings import Direction, Settings, Vector
from softfuse.sensors.base import AbstractContactSensor, Evidence, Touch
from softfuse.sensors.capacitive import BaselineSettings, CountsSettings
from softfuse.sensors.electrodes.detector import (
    ElectrodeDetector,
    ElectrodeReading,
    ElectrodeState,
    electrode_init,
    electrode_update,
)
from softfuse.sensors.parameters import parameters
from softfuse.sensors.true_contact import TrueContact

# Of virtual electrodes: counts at rest and by how much they differ, signal in contact and its bound, distance
# in which it falls to 1/e in widths of an electrode.
_REST, _REST_BOUND, _CONTACT, _CONTACT_BOUND = 16000.0, 3000.0, 3000.0, 0.15
_REACH = 1.0 / np.pi
_ACROSS = 1e-3
"""Least sine of the angle between an electrode's axis and the direction into the body."""
_STEPS = 3
"""Points along each edge of the square that stands for an electrode."""


class ElectrodesState(eqx.Module):
    """Memory between frames: of the electrodes, which of them are the contacts (c,), and whether these press
    (c,).
    """

    detector: ElectrodeState
    places: Int[Array, " c"]
    pressing: Bool[Array, " c"]


class _Seen(NamedTuple):
    """Memory within a frame."""

    state: ElectrodesState
    reading: ElectrodeReading


class SingleElectrodes(AbstractContactSensor):
    """n electrodes at `places` (n, 3, 3), with the covariance (n, 2, 2) [m²] of where on them a contact
    presses.
    """

    detector: ElectrodeDetector
    places: Float[Array, "n 3 3"]
    covariance_m2: Float[Array, "n 2 2"]

    @property
    def misses(self):
        """Contacts are where the electrodes are."""
        return False

    def init(self):
        """Untouched. Raises ConfigError for more slots than electrodes."""
        none = jnp.zeros(self.slots, int)
        return ElectrodesState(electrode_init(self.detector, self.slots), none, jnp.zeros(self.slots, bool))

    def touch(self, state, frame, raw, hint):
        """By the signal of each, in counts (n,)."""
        del hint
        detector, read = electrode_update(self.detector, state.detector, frame.dt_s, raw)
        slots = read.slots
        passed = state.pressing & slots.used & (slots.electrode != state.places)
        places = jnp.where(passed | ~slots.used, state.places, slots.electrode)
        later = ElectrodesState(detector, places, slots.used & ~passed)
        near = jnp.any(read.near)
        return _Seen(later, read), Touch(near, later.pressing, ~near, jnp.asarray(False))

    def locate(self, state, frame, context, squeezed_m3):
        """On the electrode."""
        del frame, context, squeezed_m3
        later, read = state.state, state.reading
        pressing = later.pressing
        flags = {f"{self.name} lost": jnp.any(read.lost | read.missing)}
        place, covariance = self.places[later.places], self.covariance_m2[later.places]
        return later, Evidence(pressing, pressing, pressing, place, covariance, flags, read)


class ElectrodePlace(Settings):
    """An electrode on the surface: its middle (3,) m, the direction (3,) from there into the body, and its
    size.

    size in m: along the direction `along` (3,), and across it; `along` None: whichever axis is most across.
    """

    name: str
    centre: Vector
    direction: Direction
    along: Direction | None = None
    size: tuple[PositiveLength, PositiveLength] = (10e-3, 10e-3)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.along is not None:
            along, into = (np.array(each) / np.linalg.norm(each) for each in (self.along, self.direction))
            if np.linalg.norm(np.cross(along, into)) < _ACROSS:
                raise wrong_value("runs along the direction: give it along the surface", key="along")
        return self

    def place(self) -> Float[np.ndarray, "3 3"]:
        """Its place (3, 3), see `functional.chart`."""
        chart = FlatChart.along(np.array(self.direction))
        d, first = np.asarray(chart.direction), np.asarray(chart.axes[0])
        if self.along is not None:
            first = np.array(self.along) - d * (d @ np.array(self.along))
            first = first / np.linalg.norm(first)
        return np.stack([np.array(self.centre), first, np.cross(first, d)])

    def covariance(self) -> Float[np.ndarray, "2 2"]:
        """Of a contact that may press anywhere on it (2, 2) [m²]."""
        return np.diag(np.square(self.size)) / 12.0

    def points(self) -> Float[np.ndarray, "q 3"]:
        """Points (q, 3) m that stand for it."""
        steps = np.linspace(-0.5, 0.5, _STEPS)
        a, b = (grid.ravel() for grid in np.meshgrid(*(steps * size for size in self.size), indexing="ij"))
        middle, u, v = self.place()
        return middle + a[:, None] * u + b[:, None] * v


class ElectrodeSettings(CountsSettings):
    """Single-ended electrodes, each with a patch of skin of its own, on which a [[contact]] presses.

    electrodes: where they are, one for each channel. on and off in counts, near_sigma in standard deviations;
    longest_touch, lost, quiet in s, see `electrodes.detector`.
    """

    type: Literal["electrodes"] = "electrodes"
    electrodes: tuple[ElectrodePlace, ...]
    on_counts: PositiveNumber = 600.0
    off_counts: PositiveNumber = 400.0
    near_sigma: PositiveNumber = 8.0
    on_frames: PositiveInteger = 3
    off_frames: PositiveInteger = 3
    longest_touch: PositiveTime = 120.0
    lost: PositiveTime = 0.1
    quiet_fraction: Annotated[Number, Ge(0), Lt(1)] = 0.1
    quiet: PositiveTime = 1.0
    baseline: BaselineSettings = BaselineSettings()

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.off_counts > self.on_counts:
            raise wrong_value(f"must not exceed on_counts = {self.on_counts:g}", key="off_counts")
        self._count(len(self.electrodes), f"{len(self.electrodes)} electrodes")
        return self

    def detector(self) -> ElectrodeDetector:
        """When each electrode is near something, touched, and no longer believed."""
        count = len(self.channels)
        return parameters(
            ElectrodeDetector,
            self,
            array=self._array(self.baseline),
            on_counts=jnp.full(count, self.on_counts, float),
            off_counts=jnp.full(count, self.off_counts, float),
        )

    def sensor(self, parts):
        """Raises ConfigError for a contact that there is not, or more at once than electrodes."""
        part, count = parts.contact_of(self.name, self.contact), len(self.electrodes)
        if part.slots > count:
            raise self._wrong(f"{part.slots} contacts at once on {count} electrodes: give at most so many")
        places = jnp.asarray(np.stack([electrode.place() for electrode in self.electrodes]))
        covariance = jnp.asarray(np.stack([electrode.covariance() for electrode in self.electrodes]))
        return SingleElectrodes(
            self.name, self.channels, self.contact, part.slots, self.detector(), places, covariance
        )

    @property
    def places(self):
        """The electrodes."""
        return {electrode.name: electrode.place() for electrode in self.electrodes}

    def points(self, parts):
        """Those that stand for the electrodes."""
        del parts
        return np.concatenate([electrode.points() for electrode in self.electrodes])

    def signal(self, parts, contacts: Sequence[TrueContact], moved: Float[np.ndarray, "m 3"]):
        """Nearness (e,), 1 where an electrode lies wholly on what touches: Σ exp(−d/ℓ), averaged over its
        points.

        d is their distance from the surface of a cylinder or ball that stands where it touches now. The field
        of a strip of width w decays like that, ℓ = w/π (Laplace's equation between two zeros w apart). In
        contact d = 0: no force is in it.
        """
        points = np.asarray(moved).reshape(len(self.electrodes), -1, 3)
        reach = _REACH * np.array([max(electrode.size) for electrode in self.electrodes])[:, None]
        total = np.zeros(len(self.electrodes))
        for contact in contacts:
            if contact.middle is None:
                raise self._wrong("what touches has no middle, from which distances could be measured")
            axis, apart = np.array(contact.axis), points - contact.middle
            along = apart @ axis
            across = np.linalg.norm(apart - along[..., None] * axis, axis=-1)
            beyond = np.maximum(np.abs(along) - contact.half_length, 0.0)
            if contact.half_length == 0:
                distance = np.maximum(np.hypot(across, along) - contact.radius, 0.0)
            else:
                distance = np.hypot(np.maximum(across - contact.radius, 0.0), beyond)
            total += np.exp(-distance / reach).mean(axis=-1)
        return total

    def ideal(self, parts, time_s, values):
        """Counts of nearness (m, e)."""
        del parts, time_s
        return _REST + _CONTACT * np.asarray(values)

    def electronics(self, parts, rng):
        """Electrodes that differ at rest and in contact."""
        del parts
        count = len(self.channels)
        return self._electronics(
            _REST,
            gain=1.0 + rng.uniform(-_CONTACT_BOUND, _CONTACT_BOUND, count),
            zero=rng.uniform(-_REST_BOUND, _REST_BOUND, count),
        )
