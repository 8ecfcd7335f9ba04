"""Crossed lines of electrodes under a flat face: one contact of something that conducts, by the peak it
leaves.

Signals above the baseline -> touch, by their strength and by gas that is squeezed -> location by the peak
fit, which is followed from frame to frame while something is near -> baseline for the next frame. An
electrode that lies is found 17 frames later, see `peak_follow`. Lines are ordered rows first, then columns.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from softfuse.functional.chart import AbstractChart
from softfuse.sensors.base import AbstractContactSensor, Evidence, Image, Touch
from softfuse.sensors.capacitive import (
    ArrayReading,
    ArrayState,
    CapacitiveArray,
    array_init,
    array_signal,
    track_baseline,
    weighted_mean_location,
)
from softfuse.sensors.contact_places import chart_place
from softfuse.sensors.crossed.peak_follow import PeakTrack, follow_peak, no_peak
from softfuse.sensors.crossed.peak_model import PeakModel
from softfuse.sensors.crossed.touch import (
    TouchDetector,
    TouchState,
    known_baseline,
    starts_touched,
    touch_begun,
    touch_init,
    touch_strength,
    touch_update,
)


class ArrayPose(eqx.Module):
    """Where an array lies on the body: it is glued on, cast in, and stretches with the skin.

    A contact that the array places at l, in the coordinates it is drawn in, is on the body at

        x = c + R(α) D l,

    with a shift c, a turn α about the direction that the array is seen from, and a stretch D = diag(d_x,
    d_y). Its covariance is turned and stretched alike, and times the square of a factor: how much wider
    locations spread than the fit of a peak promises, unless its misfit says more. The fit takes the array for
    flat: a dent tilts what lies around it, and locations spread by a part of its depth besides.

    Fields: shift c (2,) [m], turn α [rad], stretch d (2,) [-], the factor on standard deviations [-], and the
    part of a dent's depth by which locations spread besides [-]; all are leaves.
    """

    shift_m: Float[Array, "2"]
    turn: Float[Array, ""]
    stretch: Float[Array, "2"]
    sigma_factor: Float[Array, ""]
    dent_part: Float[Array, ""]

    def on_body(self, location_m: Float[Array, "2"]) -> Float[Array, "2"]:
        """Where on the body (2,) m a place in the array's coordinates (2,) m is."""
        return self.shift_m + self._turned @ location_m

    def on_array(self, place_m: Float[Array, "2"]) -> Float[Array, "2"]:
        """Where in the array's coordinates (2,) m a place on the body (2,) m is."""
        return jnp.linalg.solve(self._turned, place_m - self.shift_m)

    def spread(
        self, covariance_m2: Float[Array, "2 2"], widening: Float[Array, ""], dent_m: Float[Array, ""]
    ) -> Float[Array, "2 2"]:
        """Covariance (2, 2) m² on the body of a location.

        Args: covariance_m2 (2, 2) in the array's coordinates [m²], which a misfit has made larger by
        widening >= 1 [-]; dent_m, depth of the dent [m]. Factor and dent are what made presses spread wider
        than promised without the widening, so that the larger of both counts.
        """
        misfit = self._turned @ covariance_m2 @ self._turned.T
        spread = self.sigma_factor**2 * misfit / widening + (self.dent_part * dent_m) ** 2 * jnp.eye(2)
        return jnp.where(jnp.trace(misfit) > jnp.trace(spread), misfit, spread)

    @property
    def _turned(self) -> Float[Array, "2 2"]:
        c, s = jnp.cos(self.turn), jnp.sin(self.turn)
        return jnp.array([[c, -s], [s, c]]) * self.stretch


class CrossedReading(eqx.Module):
    """What the lines say about one frame."""

    near: Bool[Array, ""]
    """Something is near or touches."""
    touching: Bool[Array, ""]
    """The lines see something touch."""
    location_m: Float[Array, "2"]
    """(2,) x, y of the contact on the array [m]; the array's middle while nothing is near."""
    covariance_m2: Float[Array, "2 2"]
    """(2, 2) its covariance [m²]; as wide as the array while nothing is near."""
    widening: Float[Array, ""]
    """By how much, at least 1, the peak's misfit makes that larger [-]."""
    located: Bool[Array, ""]
    """The fit ended on the array (at most half a pitch beyond the outermost lines) and is certain enough."""
    dent_m: Float[Array, ""]
    """Depth [m] of a dent of the contact's radius that holds the volume squeezed out of the chambers."""
    weighted_mean_m: Float[Array, "2"]
    """(2,) the paper's location [m], biased at the border; the array's middle without any signal."""
    residual_counts: Float[Array, ""]
    """Root mean square residual of the peak fit [counts]; 0 while nothing is near."""
    signal_counts: Float[Array, " e"]
    """(r + c,) counts above the baseline over the gain, rows first."""
    valid: Bool[Array, " e"]
    """(r + c,) lines that took part."""
    image: Float[Array, "c r"]
    """(c, r) image s_col (x) s_row, first index along x [counts²]."""


class CrossedState(eqx.Module):
    """Memory between frames."""

    array: ArrayState
    touch: TouchState
    peak: PeakTrack
    lying: Bool[Array, " e"]


class _Seen(NamedTuple):
    """Memory within a frame."""

    state: CrossedState
    counts: Float[Array, " e"]
    reading: ArrayReading


class CrossedElectrodes(AbstractContactSensor):
    """The lines, in the place where they lie on the chart of the contact that they see.

    `low_m`, `high_m` (2,): where middles of contacts may be [m]; `weighted_mean`: whether that is the
    location.
    """

    misses = True  # what does not conduct is not seen
    weighted_mean: bool = eqx.field(static=True)
    array: CapacitiveArray
    peak: PeakModel
    detector: TouchDetector
    pose: ArrayPose
    chart: AbstractChart
    low_m: Float[Array, "2"]
    high_m: Float[Array, "2"]

    def image(self, details):
        """Of all crossings."""
        x_m, y_m = (np.asarray(each) for each in (self.peak.column_x_m, self.peak.row_y_m))
        return Image(np.asarray(details.image).T, x_m, y_m)

    def init(self):
        """Untouched, unless the first frame tells."""
        return CrossedState(
            array_init(len(self.channels)),
            touch_init(),
            no_peak(self.peak),
            jnp.zeros(len(self.channels), bool),
        )

    def touch(self, state, frame, raw, hint):
        """By the strength of the signals, in counts (r + c,), and gas that is squeezed."""
        rows = self.peak.row_y_m.shape[0]
        begun = starts_touched(self.array, self.detector, state.array, raw, rows)

        def if_begun(one, other):
            return jax.tree.map(lambda a, b: jnp.where(begun, a, b), one, other)

        known = if_begun(known_baseline(self.array, state.array), state.array)
        reading = array_signal(self.array, known, raw)
        strength = touch_strength(reading.signal_counts[:rows], reading.signal_counts[rows:])
        touch = touch_update(self.detector, state.touch, strength, hint.still(~hint.begins).squeezed())
        touch = if_begun(touch_begun(strength), touch)
        seen = _Seen(CrossedState(known, touch, state.peak, state.lying), raw, reading)
        return seen, Touch(touch.near, touch.touching[None], ~touch.touching, begun)

    def locate(self, state, frame, context, squeezed_m3):
        """By the peak; a dent as deep as that volume spreads it."""
        counts, reading, state = state.counts, state.reading, state.state
        touch = state.touch
        # A line found lying stays out until nothing is near.
        trusted = reading.valid & ~state.lying
        peak, (location, covariance, widening, residual, honest, located) = _peak(
            self.peak, state.peak, reading.signal_counts, trusted, touch.near
        )
        touching = touch.touching | context.unseen
        array = track_baseline(self.array, state.array, frame.dt_s, counts, touch.near, touching)
        later = CrossedState(array, touch, peak, touch.near & (state.lying | (trusted & ~honest)))
        rows = self.peak.row_y_m.shape[0]
        signal = reading.signal_counts
        mean = weighted_mean_location(self.peak.row_y_m, self.peak.column_x_m, signal, honest)
        dent = squeezed_m3 / (jnp.pi * self.peak.radius_m**2)
        at = self.pose.on_body(mean if self.weighted_mean else location)
        inside = jnp.all((at >= self.low_m) & (at <= self.high_m))
        place, spread = chart_place(self.chart, at, self.pose.spread(covariance, widening, dent))
        # In the first frame no line has a baseline yet.
        lost = jnp.where(frame.first, ~jnp.isfinite(counts), ~honest)
        found = touch.touching & located
        return later, Evidence(
            touch.touching[None],
            found[None],
            (found & inside)[None],
            place[None],
            spread[None],
            {f"{self.name} lost": jnp.any(lost)},
            CrossedReading(
                near=touch.near,
                touching=touch.touching,
                location_m=location,
                covariance_m2=covariance,
                widening=widening,
                located=located,
                dent_m=dent,
                weighted_mean_m=mean,
                residual_counts=residual,
                signal_counts=signal,
                valid=honest,
                image=jnp.outer(signal[rows:], signal[:rows]),
            ),
        )


def _peak(
    peak: PeakModel,
    track: PeakTrack,
    signal: Float[Array, " e"],
    valid: Bool[Array, " e"],
    near: Bool[Array, ""],
):
    """The track, and location, covariance, its widening, residual, honest lines, whether to believe; no fit
    while nothing is near.
    """
    low = jnp.stack([peak.column_x_m[0], peak.row_y_m[0]])
    high = jnp.stack([peak.column_x_m[-1], peak.row_y_m[-1]])
    lines = jnp.asarray([peak.column_x_m.shape[0], peak.row_y_m.shape[0]])
    half_pitch = 0.5 * (high - low) / (lines - 1)
    middle = 0.5 * (low + high)
    unknown = jnp.diag((high - low) ** 2 / 12.0)

    def fitted():
        later, fit, honest = follow_peak(peak, track, signal, valid)
        inside = jnp.all((fit.location_m > low - half_pitch) & (fit.location_m < high + half_pitch))
        certain = jnp.all(jnp.diagonal(fit.covariance_m2) < half_pitch**2)
        finite = jnp.all(jnp.isfinite(fit.location_m))
        located = inside & certain & finite
        return later, (fit.location_m, fit.covariance_m2, fit.widening, fit.residual_counts, honest, located)

    def absent():
        none = jnp.zeros_like(middle[0])
        nowhere = middle, unknown, none + 1.0, none, valid, jnp.asarray(False)
        return no_peak(peak), nowhere

    return jax.lax.cond(near, fitted, absent)
