"""A grid of mutual capacitances under a flat face: several contacts, conducting or not, by its image.

Signals above the baseline -> is anything there (a source that explains more of the image than noise can) ->
the sources of the image -> tracks, which keep their numbers -> baseline for the next frame. The baseline is
frozen while something touches, creeps while something is near and follows otherwise. Signals of both signs
are physical, so that a baseline taken with a finger on the grid is not known by its sign: it shows as a touch
that does not end, and after `longest_touch_s` all baselines are taken anew.

Each track that has a contact slot is a contact; of those that touch at once, the first keep theirs. Gas tells
in turn what an image hardly can: without flow out of the chambers nothing presses harder, so that what seems
to has gone.
"""

from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from softfuse.functional.chart import AbstractChart
from softfuse.sensors.base import AbstractContactSensor, Evidence, Image, Touch
from softfuse.sensors.capacitive import ArrayState, CapacitiveArray, array_init, array_signal, track_baseline
from softfuse.sensors.contact_places import SlotsUsed, apart, assign_slots, chart_places, slots_init, within
from softfuse.sensors.mutual.fit import MutualFit, Splitting, best_place, fit_sources, no_fit
from softfuse.sensors.mutual.model import MutualModel
from softfuse.sensors.mutual.touch_tracks import (
    TouchFollower,
    TouchTracks,
    expected,
    follow_touches,
    tracks_init,
)

_SQUEEZED_SIGMA = 3.0  # of the flow: below, nothing flows


class MutualReading(eqx.Module):
    """What the grid says about one frame."""

    tracks: TouchTracks
    """Everything that touches or is near."""
    slots: SlotsUsed
    """Which track is which contact."""
    image: Float[Array, "c r"]
    """(c, r) counts above the baseline, 0 where invalid; first index along x."""
    fit: MutualFit
    """The sources of the image."""
    valid: Bool[Array, "c r"]
    """(c, r) cells that took part."""


class MutualState(eqx.Module):
    """Memory between frames: of the grid, of the slots (n,), and where their contacts were (n, 2) [m]."""

    array: ArrayState
    tracks: TouchTracks
    slots: SlotsUsed
    at_m: Float[Array, "n 2"]


class _Seen(NamedTuple):
    """Memory within a frame."""

    state: MutualState
    reading: MutualReading
    lost: Bool[Array, ""]


class MutualElectrodes(AbstractContactSensor):
    """The grid in the chart of the contact that it sees; cells are numbered row by row in readings.

    `low_m`, `high_m` (2,): where middles of contacts may be [m], in which places are taken to be as far as
    images allow.
    """

    misses = False  # what does not conduct couples
    array: CapacitiveArray
    model: MutualModel
    splitting: Splitting
    follower: TouchFollower
    near_sigma: Float[Array, ""]
    """Evidence, as a square root, from which something is there [standard deviations]."""
    touches: int = eqx.field(static=True)
    """At most so many are followed, touching or near."""
    chart: AbstractChart
    low_m: Float[Array, "2"]
    high_m: Float[Array, "2"]

    def image(self, details):
        """Of all crossings."""
        x_m, y_m = (np.asarray(each) for each in (self.model.column_x_m, self.model.row_y_m))
        return Image(np.asarray(details.image).T, x_m, y_m)

    def init(self):
        """Untouched. Raises ConfigError when there are more contacts than touches that the grid follows."""
        waiting = apart(self.low_m, self.high_m, self.slots)
        return MutualState(*self._untouched(), slots_init(self.slots, self.touches), waiting)

    def _untouched(self) -> tuple[ArrayState, TouchTracks]:
        return array_init(len(self.channels)), tracks_init(self.touches)

    def touch(self, state, frame, raw, hint):
        """By the image of the cells (r c,), row by row, in counts."""
        flow, level = hint.still(hint.level), hint.still(~hint.level)
        squeezed = flow.squeezed() > _SQUEEZED_SIGMA
        # Gas that is squeezed already does not tell whether it is squeezed further.
        squeezed = squeezed | (level.squeezed() > _SQUEEZED_SIGMA)
        if not hint.outflow.size:
            squeezed = jnp.asarray(True)
        later, read = self.filtered(state, frame.dt_s, raw, squeezed)
        # In the first frame no cell has a baseline yet.
        lost = jnp.where(frame.first, ~jnp.isfinite(raw).all(), ~read.valid.all())
        near, touching = read.tracks.there.any(), read.tracks.touching.any()
        return _Seen(later, read, lost), Touch(near, read.slots.used, ~touching, jnp.asarray(False))

    def filtered(
        self,
        state: MutualState,
        dt_s: Float[Array, ""],
        counts: Float[Array, " e"],
        squeezed: Bool[Array, ""] | bool = True,
    ) -> tuple[MutualState, MutualReading]:
        """One frame, dt_s after the last [s]: counts (r c,) row by row, NaN where missing.

        `squeezed`: something may just press harder; False only where that is known from elsewhere.
        """
        model = self.model
        columns, rows = model.column_x_m.shape[0], model.row_y_m.shape[0]
        read = array_signal(self.array, state.array, counts)
        image, valid = (each.reshape(rows, columns).T for each in (read.signal_counts, read.valid))
        squeezed = jnp.asarray(squeezed)
        known = expected(model, self.follower, state.tracks, dt_s, squeezed)
        weight = jnp.where(valid, 1.0 / model.noise_counts, 0.0).ravel()
        _, _, evidence = best_place(model, image.ravel(), weight)
        misfit = jnp.sum((image.ravel() * weight) ** 2)
        # Coupling that cancels shielding leaves more than noise, for their shapes differ: else nothing is
        # there.
        fit = jax.lax.cond(
            (evidence > self.near_sigma**2) | (known.there.any() & (misfit > self.near_sigma**2)),
            lambda: fit_sources(model, self.splitting, known, image, valid),
            lambda: no_fit(model, self.touches),
        )
        tracks = follow_touches(self.follower, state.tracks, dt_s, known, fit, squeezed)
        near, touching = tracks.there.any(), tracks.touching.any()
        array = track_baseline(self.array, state.array, dt_s, counts, near, touching)
        overlong = jnp.any(tracks.touched_s > self.follower.longest_touch_s)
        array, later = jax.tree.map(
            lambda anew, on: jnp.where(overlong, anew, on), self._untouched(), (array, tracks)
        )
        later = replace(later, last_number=tracks.last_number)
        slots = assign_slots(state.slots, jnp.maximum(tracks.shield, tracks.coupling), tracks.touching)
        reading = MutualReading(tracks, slots, image, fit, valid)
        return MutualState(array, later, slots, state.at_m), reading

    def locate(self, state, frame, context, squeezed_m3):
        """In the workspace as far as the image allows."""
        del frame, context, squeezed_m3
        before, read = state.state, state.reading
        slots, tracks = read.slots, read.tracks
        touching = slots.used
        at, spread = tracks.place_m[slots.electrode], tracks.place_sigma_m[slots.electrode]
        located = touching & jnp.all(jnp.isfinite(at) & jnp.isfinite(spread), axis=1)
        inside, mean, deviation = within(at, spread, jnp.stack([self.low_m, self.high_m]))
        at, spread = (jnp.where(inside[:, None], *each) for each in ((mean, at), (deviation, spread)))
        # What is outside is told where it is, but nothing is pressed there.
        at_m = jnp.where((located & inside)[:, None], at, before.at_m)
        told = jnp.where(located[:, None], at, at_m)
        place, covariance = chart_places(self.chart, told, jnp.where(located[:, None], spread, 0.0))
        later = replace(before, at_m=at_m)
        flags = {f"{self.name} lost": state.lost}
        return later, Evidence(touching, located, located & inside, place, covariance, flags, read)
