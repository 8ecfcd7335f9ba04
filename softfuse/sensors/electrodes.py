"""Single electrodes, each on a patch of skin of its own, anywhere on the body: which of them are touched.

    signal s = counts - baseline [counts], positive when something grounded comes near;
    touched: s > on for `on_frames` frames, until s < off for `off_frames` frames.

Baseline and broken readings are those of an array (capacitive.py), decided for each electrode alone: followed
while nothing is near, frozen while touched, creeping while something is near. A frame without a usable
reading is no evidence: it neither begins nor ends a touch.

An electrode is lost, and not believed, when it is
* stuck: the same counts in `stuck_frames` frames, or at the converter's end for `lost_s`;
* stuck: its noise has vanished, that is the mean square difference between readings, 2 noise² in a live one,
  has fallen below quiet_fraction² of that (a dead amplifier still toggles between two codes);
* stuck: touched for longer than `longest_touch_s`. Its baseline then creeps: what stays on it (a drop of
  water, a drift) is calibrated away in a few creep times and the electrode believed again; when it leaves,
  the baseline recovers at once from the negative signal;
* missing for `lost_s`.
What the amplitude says about the force is left to the estimator: it is hardly anything. A slot that passes
from one electrode to another is without force for one frame: a force belongs to its place.
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
from softfuse.sensors.capacitive import (
    ArrayState,
    BaselineSettings,
    CapacitiveArray,
    CountsSettings,
    array_init,
    array_signal,
    count_equal_frames,
    track_baseline,
)
from softfuse.sensors.contact_places import SlotsUsed, assign_slots, slots_init
from softfuse.sensors.parameters import parameters
from softfuse.sensors.parts import TrueContact

# Of virtual electrodes: counts at rest and by how much they differ, signal in contact and its bound, distance
# in which it falls to 1/e in widths of an electrode.
_REST, _REST_BOUND, _CONTACT, _CONTACT_BOUND = 16000.0, 3000.0, 3000.0, 0.15
_REACH = 1.0 / np.pi
_ACROSS = 1e-3
"""Least sine of the angle between an electrode's axis and the direction into the body."""
_STEPS = 3
"""Points along each edge of the square that stands for an electrode."""
_LARGEST_DIFFERENCE_SIGMA = 3.0
"""A touch is a step between two readings: differences beyond this many standard deviations are no noise."""


class ElectrodesState(eqx.Module):
    """Memory between frames: of n electrodes, and which of them are the c contacts, and press."""

    array: ArrayState
    touched: Bool[Array, " n"]
    frames: Int[Array, " n"]
    touched_s: Float[Array, " n"]
    unusable_s: Float[Array, " n"]
    square_counts2: Float[Array, " n"]
    slots: SlotsUsed
    places: Int[Array, " c"]
    pressing: Bool[Array, " c"]


class ElectrodeReading(eqx.Module):
    """What the electrodes say about one frame."""

    signal_counts: Float[Array, " n"]
    """(n,) counts above the baseline, 0 without a usable reading."""
    near: Bool[Array, " n"]
    """(n,) something is near or touches; also while it is not believed to touch."""
    touched: Bool[Array, " n"]
    """(n,) something touches; never a lost electrode."""
    missing: Bool[Array, " n"]
    """(n,) no reading in this frame."""
    stuck: Bool[Array, " n"]
    """(n,) dead, at the converter's end, or touched for too long."""
    lost: Bool[Array, " n"]
    """(n,) stuck, or missing for too long: says nothing about contact."""
    slots: SlotsUsed
    """The touched electrodes that are followed."""


class _Seen(NamedTuple):
    """Memory within a frame."""

    state: ElectrodesState
    reading: ElectrodeReading


class SingleElectrodes(AbstractContactSensor):
    """n electrodes at `places` (n, 3, 3), with the covariance (n, 2, 2) [m²] of where on them a contact
    presses, and thresholds as above.
    """

    misses = False  # contacts are where the electrodes are
    places: Float[Array, "n 3 3"]
    covariance_m2: Float[Array, "n 2 2"]
    array: CapacitiveArray
    on_counts: Float[Array, " n"]
    off_counts: Float[Array, " n"]
    near_sigma: Float[Array, ""]
    """Signal at which something is near [standard deviations of one reading]."""
    on_frames: Int[Array, ""]
    off_frames: Int[Array, ""]
    longest_touch_s: Float[Array, ""]
    lost_s: Float[Array, ""]
    quiet_fraction: Float[Array, ""]
    """0 where the counts do not resolve the noise."""
    quiet_s: Float[Array, ""]
    """Time constant over which the noise is measured [s]."""

    def init(self):
        """Untouched. Raises ConfigError for more slots than electrodes."""
        n = self.on_counts.shape[0]
        nothing, no = jnp.zeros(n), jnp.zeros(n, bool)
        return ElectrodesState(
            array=array_init(n),
            touched=no,
            frames=jnp.zeros(n, int),
            touched_s=nothing,
            unusable_s=nothing,
            square_counts2=nothing + 2.0 * self.array.noise_counts**2,
            slots=slots_init(self.slots, n),
            places=jnp.zeros(self.slots, int),
            pressing=jnp.zeros(self.slots, bool),
        )

    def touch(self, state, frame, raw, hint):
        """By the signal of each, in counts (n,)."""
        del hint
        later, read = self.filtered(state, frame.dt_s, raw)
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

    def filtered(
        self, state: ElectrodesState, dt_s: Float[Array, ""], counts: Float[Array, " n"]
    ) -> tuple[ElectrodesState, ElectrodeReading]:
        """One frame, dt_s after the last [s], 0 for the first: counts (n,), NaN where missing."""
        array = self.array
        signal = array_signal(array, state.array, counts)
        square = self._mean_square_difference(state, dt_s, counts)
        quiet = square < self.quiet_fraction**2 * 2.0 * array.noise_counts**2

        begins = signal.signal_counts > self.on_counts
        ends = signal.signal_counts < self.off_counts
        counted = state.frames + (signal.valid & jnp.where(state.touched, ends, begins))
        frames = jnp.where(signal.valid & (counted == state.frames), 0, counted)
        flip = frames >= jnp.where(state.touched, self.off_frames, self.on_frames)
        touched = state.touched ^ flip
        touched_s = jnp.where(touched, state.touched_s + dt_s, 0.0)
        overlong = touched_s > self.longest_touch_s

        missing = ~jnp.isfinite(counts)
        at_end = (counts <= array.lowest_counts) | (counts >= array.highest_counts)
        unusable_s = jnp.where(signal.valid, 0.0, state.unusable_s + dt_s)
        gone = unusable_s > self.lost_s
        dead = quiet | (count_equal_frames(state.array, counts) >= array.stuck_frames)
        stuck = dead | overlong | (gone & at_end)
        lost = stuck | gone

        # A touch that lasts too long is remembered, to know when it ends, that of a dead electrode is not.
        remembered = touched & ~dead & ~gone
        believed = remembered & ~overlong
        near = signal.valid & (signal.signal_counts > self.near_sigma * array.noise_counts)
        slots = assign_slots(state.slots, signal.signal_counts, believed)
        passed = state.pressing & slots.used & (slots.electrode != state.places)
        later = ElectrodesState(
            array=track_baseline(array, state.array, dt_s, counts, near | remembered, believed),
            touched=remembered,
            frames=jnp.where(flip | dead | gone, 0, frames),
            touched_s=jnp.where(remembered, touched_s, 0.0),
            unusable_s=unusable_s,
            square_counts2=square,
            slots=slots,
            places=jnp.where(passed | ~slots.used, state.places, slots.electrode),
            pressing=slots.used & ~passed,
        )
        return later, ElectrodeReading(
            signal_counts=signal.signal_counts,
            near=near | believed,
            touched=believed,
            missing=missing,
            stuck=stuck,
            lost=lost,
            slots=slots,
        )

    def _mean_square_difference(
        self, state: ElectrodesState, dt_s: Float[Array, ""], counts: Float[Array, " n"]
    ) -> Float[Array, " n"]:
        """Mean square difference between readings (n,) [counts^2]; a missing one changes nothing."""
        difference = counts - state.array.last_counts
        known = jnp.isfinite(difference)
        largest = 2.0 * (_LARGEST_DIFFERENCE_SIGMA * self.array.noise_counts) ** 2
        square = jnp.minimum(jnp.where(known, difference, 0.0) ** 2, largest)
        weight = jnp.where(known, 1.0 - jnp.exp(-dt_s / self.quiet_s), 0.0)
        return state.square_counts2 + weight * (square - state.square_counts2)


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
    longest_touch, lost, quiet in s, see above.
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

    def sensor(self, parts):
        """Raises ConfigError for a contact that there is not, or more at once than electrodes."""
        part, count = parts.contact_of(self.name, self.contact), len(self.electrodes)
        if part.slots > count:
            raise self._wrong(f"{part.slots} contacts at once on {count} electrodes: give at most so many")
        return parameters(
            SingleElectrodes,
            self,
            slots=part.slots,
            places=jnp.asarray(np.stack([electrode.place() for electrode in self.electrodes])),
            covariance_m2=jnp.asarray(np.stack([electrode.covariance() for electrode in self.electrodes])),
            array=self._array(self.baseline),
            on_counts=jnp.full(count, self.on_counts, float),
            off_counts=jnp.full(count, self.off_counts, float),
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
