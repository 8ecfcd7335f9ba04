"""A single-ended array of crossed lines of diamonds: what its keys mean, and what its lines say in
simulation.
"""

from collections.abc import Sequence
from functools import cache
from typing import Annotated, Literal, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from annotated_types import Ge, Gt, Le, Lt
from jaxtyping import Array, Float
from pydantic import model_validator

from softfuse.io.quantity import (
    Angle,
    Length,
    Number,
    PositiveInteger,
    PositiveLength,
    PositiveNumber,
    wrong_value,
)
from softfuse.io.settings import Settings
from softfuse.sensors.base import Gains
from softfuse.sensors.capacitive import BaselineSettings, CapacitiveArray, ElectrodeLinesSettings
from softfuse.sensors.crossed.field import ArrayField, CrossedLines, FieldSettings
from softfuse.sensors.crossed.peak_model import PeakModel
from softfuse.sensors.crossed.sensor import ArrayPose, CrossedElectrodes
from softfuse.sensors.crossed.touch import TouchDetector
from softfuse.sensors.parameters import parameters
from softfuse.sensors.parts import Parts, TrueContact
from softfuse.sensors.place_information import charge_of, place_told_by_lines

Fraction = Annotated[Number, Gt(0), Lt(1)]

# Of virtual lines: counts per farad, parasitic counts and by how much they differ, bound of gains, a slow
# drift.
_COUNTS_PER_F, _PARASITIC, _PARASITIC_BOUND, _GAIN_BOUND = 2000e12, 20000.0, 500.0, 0.005
_SLOW_SIGMA, _SLOW_TIME_S = 10.0, 300.0


class TouchSettings(Settings):
    """When something is near, touches, and is gone: standard deviations, counts, fractions, frames.

    The largest of 8 + 8 noises adds up to 2.8 standard deviations on average and exceeds 8 once in 10^6
    frames. contact_on_counts is about 40 % of what the paper's 20 mm indenter gives on electrodes at 1.0 and
    1.5 mm depth.
    """

    near_on_sigma: PositiveNumber = 8.0
    near_off_sigma: PositiveNumber = 6.0
    contact_on_counts: PositiveNumber = 3000.0
    flow_sigma: PositiveNumber = 8.0
    release_fraction: Fraction = 0.6
    return_fraction: Annotated[Number, Gt(0), Le(1)] = 0.7
    on_frames: PositiveInteger = 3
    off_frames: PositiveInteger = 3

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.near_off_sigma > self.near_on_sigma:
            raise wrong_value(f"must not exceed near_on_sigma = {self.near_on_sigma:g}", key="near_off_sigma")
        if self.return_fraction < self.release_fraction:
            raise wrong_value(
                f"must not be below release_fraction = {self.release_fraction:g}", key="return_fraction"
            )
        return self


class PeakSettings(Settings):
    """How sure the peak fit is beforehand, as standard deviations, and how it is found.

    Radius of the contact and gap to it in m, common offset of the lines in counts, misfit of the model
    relative to the largest signal. outlier: root mean square residual from which a lying line is looked for,
    in standard deviations; iterations: of a fit that begins anew.
    """

    radius_sigma: PositiveLength = 0.5e-3
    gap_sigma: PositiveLength = 0.5e-3
    offset_sigma_counts: PositiveNumber = 100.0
    model_error: PositiveNumber = 0.005
    outlier: PositiveNumber = 3.0
    iterations: PositiveInteger = 8


class PoseSettings(Settings):
    """Where the array lies on the body, see `crossed.sensor`.

    shift in m along x and y, turn in rad, stretch along x and y; sigma_factor: by how much locations spread
    wider than the fit of a peak promises; dent_part: by which part of a dent's depth they do besides.
    """

    shift: tuple[Length, Length] = (0.0, 0.0)
    turn: Angle = 0.0
    stretch: tuple[PositiveNumber, PositiveNumber] = (1.0, 1.0)
    sigma_factor: PositiveNumber = 1.0
    dent_part: Annotated[Number, Ge(0)] = 0.0

    def pose(self) -> ArrayPose:
        """The pose."""
        return parameters(ArrayPose, self)


class CrossedSettings(ElectrodeLinesSettings):
    """A single-ended array of crossed lines of diamonds, at depths below the surface, in m.

    channels: columns of a recording, rows first. row_gain, column_gain [-]: counts of a line for what a
    nominal one says with one, one value or one for each. row_baseline, column_baseline: counts of each line
    untouched, for a start while something touches.
    """

    type: Literal["crossed-diamonds"] = "crossed-diamonds"
    row_depth: PositiveLength
    column_depth: PositiveLength
    row_gain: Gains = (1.0,)
    column_gain: Gains = (1.0,)
    row_baseline: tuple[Number, ...] | None = None
    column_baseline: tuple[Number, ...] | None = None
    location: Literal["peak-fit", "weighted-mean"] = "peak-fit"
    baseline: BaselineSettings = BaselineSettings()
    touch: TouchSettings = TouchSettings()
    peak: PeakSettings = PeakSettings()
    pose: PoseSettings = PoseSettings()

    @model_validator(mode="after")
    def _check(self) -> Self:
        for key, lines in (("row_y", self.row_y), ("column_x", self.column_x)):
            if len(lines) < 2:
                raise wrong_value("an array has at least two lines in each direction", key=key)
        lines = len(self.row_y) + len(self.column_x)
        self._count(lines, f"{lines} lines of row_y and column_x")
        for name, lines, gain, baseline in (
            ("row", self.row_y, self.row_gain, self.row_baseline),
            ("column", self.column_x, self.column_gain, self.column_baseline),
        ):
            self._one_each(f"{name}_gain", gain, len(lines))
            if baseline is not None and len(baseline) != len(lines):
                raise wrong_value(f"{len(baseline)} values for {len(lines)}", key=f"{name}_baseline")
        if (self.row_baseline is None) != (self.column_baseline is None):
            name, other = ("row", "column") if self.row_baseline is None else ("column", "row")
            message = f"missing, while {other}_baseline is given: give both or none"
            raise wrong_value(message, key=f"{name}_baseline")
        return self

    def gains(self) -> Float[Array, " e"]:
        """The gains of all lines (e,), rows first."""
        each = ((self.row_gain, self.row_y), (self.column_gain, self.column_x))
        return jnp.concatenate([jnp.broadcast_to(jnp.array(gain, float), (len(at),)) for gain, at in each])

    def array(self) -> CapacitiveArray:
        """The electronics of the lines and how their baseline is followed."""
        untouched = jnp.full(len(self.row_y) + len(self.column_x), jnp.inf)
        if self.row_baseline is not None and self.column_baseline is not None:
            untouched = jnp.array([*self.row_baseline, *self.column_baseline], float)
        return self._array(self.baseline, gain=self.gains(), untouched_counts=untouched)

    def peak_model(self, radius_m: float) -> PeakModel:
        """The peak that a contact of a radius [m] leaves; the deeper layer collects the flux around the
        array's rim.

        The rim strip of the deeper layer is as wide as the distance between the layers (the height by which
        the array's side face exposes it), that of the other layer zero.
        """
        gap = self.row_depth - self.column_depth
        return parameters(
            PeakModel,
            self,
            self.peak,
            row_rim_m=max(gap, 0.0),
            column_rim_m=max(-gap, 0.0),
            radius_m=radius_m,
        )

    def place_information(self, radius_m):
        """Of contacts as strong as make it tell contact (contact_on_counts)."""
        peak = self.peak_model(radius_m)
        charge = charge_of(peak, self.touch.contact_on_counts)

        def told(columns, rows, places):
            moved = eqx.tree_at(lambda m: (m.column_x_m, m.row_y_m), peak, (columns, rows))
            return place_told_by_lines(moved, charge, places)

        return told

    def sensor(self, parts):
        """Raises ConfigError for a contact that there is not, or that presses on no flat face."""
        part, chart = parts.contact_of(self.name, self.contact), self._chart(parts)
        return parameters(
            CrossedElectrodes,
            self,
            slots=1,  # profiles of two contacts cannot be told apart
            weighted_mean=self.location == "weighted-mean",
            array=self.array(),
            peak=self.peak_model(part.radius),
            detector=parameters(TouchDetector, self.touch, self),
            pose=self.pose.pose(),
            chart=chart,
            low_m=part.low,
            high_m=part.high,
        )

    @property
    def _lines(self) -> CrossedLines:
        return CrossedLines(self.row_y, self.column_x, self.row_depth, self.column_depth)

    def points(self, parts):
        """Middles (m, 3) m of the squares that the lines are cut into."""
        part, chart = parts.contact_of(self.name, self.contact), self._chart(parts)
        middle = _field(self._lines, part.radius).panels.middle
        pose, d = self.pose.pose(), np.asarray(chart.direction)
        at = np.array([chart.place(pose.on_body(jnp.asarray(each[:2])))[0] for each in middle])
        depth = -_face_height(parts, d) - middle[:, 2]
        return at + (depth - at @ d)[:, None] * d

    def signal(self, parts, contacts: Sequence[TrueContact], moved: Float[np.ndarray, "m 3"]):
        """Capacitances (e,) F in the field of a grounded cylinder that hovers or is pressed in.

        Pressed in, it takes the lines below it along; those around it lag behind and come nearer to its wall.
        They are moved up and down with the body, those under it by the mean of their layer there, since the
        distance of a millimetre that matters is less than what a coarse mesh resolves point by point.
        Sideways they are left in place: the silicone under a flat punch hardly flows (not at all if
        incompressible and deep: Johnson, Contact Mechanics, 1985, Sec. 3.4).
        """
        part, chart = parts.contact_of(self.name, self.contact), self._chart(parts)
        field = _field(self._lines, part.radius)
        if not contacts:
            return field.alone
        if len(contacts) > 1:
            raise self._wrong("crossed lines see one contact, not several at once")
        (contact,) = contacts
        d, rest = np.asarray(chart.direction), field.panels.middle
        local = chart.coordinates(contact.place)
        x, y = np.asarray(self.pose.pose().on_array(jnp.asarray(local)))
        placed = np.column_stack([rest[:, :2], -(moved @ d) - _face_height(parts, d)])
        under = np.hypot(rest[:, 0] - x, rest[:, 1] - y) < part.radius
        for layer in np.unique(rest[:, 2]):
            those = under & (rest[:, 2] == layer)
            if those.any():
                placed[those, 2] = placed[those, 2].mean()
        return field.lines((float(x), float(y)), contact.gap, placed)

    def ideal(self, parts, time_s, values):
        """Counts of capacitances (m, e) F."""
        del parts, time_s
        return _PARASITIC + _COUNTS_PER_F * np.asarray(values)

    def electronics(self, parts, rng):
        """Lines that differ in gain and parasitic capacitance, and drift."""
        del parts
        count = len(self.channels)
        return self._electronics(
            _PARASITIC,
            gain=1.0 + rng.uniform(-_GAIN_BOUND, _GAIN_BOUND, count),
            zero=rng.uniform(-_PARASITIC_BOUND, _PARASITIC_BOUND, count),
            slow_sigma=_SLOW_SIGMA,
            slow_time=_SLOW_TIME_S,
        )


@cache
def _field(lines: CrossedLines, radius: float) -> ArrayField:
    return ArrayField(lines, FieldSettings(radius=radius))


def _face_height(parts: Parts, direction: Float[np.ndarray, "3"]) -> float:
    """How far [m] the outermost point of the body's faces is against a direction (3,), from the origin."""
    nodes = np.unique(np.asarray(parts.faces))
    return float(np.max(-np.asarray(parts.body.rest)[nodes] @ direction))
