"""A grid of mutual capacitances: one frame of counts to touches, which keep their numbers.

Signals above the baseline -> is anything there (a source that explains more of the image than noise can) ->
the sources of the image -> tracks -> baseline for the next frame. The baseline is frozen while something
touches, creeps while something is near and follows otherwise. Signals of both signs are physical, so that a
baseline taken with a finger on the grid is not known by its sign: it shows as a touch that does not end, and
after `longest_touch_s` all baselines are taken anew.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from softfuse.sensors.capacitive import ArrayState, CapacitiveArray, array_init, array_signal, track_baseline
from softfuse.sensors.mutual.fit import MutualFit, Splitting, best_place, fit_sources, no_fit
from softfuse.sensors.mutual.model import MutualModel
from softfuse.sensors.mutual.touch_tracks import (
    TouchFollower,
    TouchTracks,
    expected,
    follow_touches,
    tracks_init,
)


class MutualGrid(eqx.Module):
    """Parameters; cells are numbered row by row in readings, all fields but `touches` are leaves."""

    array: CapacitiveArray
    model: MutualModel
    splitting: Splitting
    follower: TouchFollower
    near_sigma: Float[Array, ""]
    """Evidence, as a square root, from which something is there [standard deviations]."""
    touches: int = eqx.field(static=True)
    """At most so many are followed, touching or near."""


class MutualState(eqx.Module):
    """Memory between frames."""

    array: ArrayState
    tracks: TouchTracks


class MutualReading(eqx.Module):
    """What the grid says about one frame."""

    tracks: TouchTracks
    """Everything that touches or is near."""
    image: Float[Array, "c r"]
    """(c, r) counts above the baseline, 0 where invalid; first index along x."""
    fit: MutualFit
    """The sources of the image."""
    valid: Bool[Array, "c r"]
    """(c, r) cells that took part."""


def mutual_init(grid: MutualGrid) -> MutualState:
    """State before the first frame; the grid is taken to be untouched."""
    cells = grid.model.column_x_m.shape[0] * grid.model.row_y_m.shape[0]
    return MutualState(array_init(cells), tracks_init(grid.touches))


def mutual_update(
    grid: MutualGrid,
    state: MutualState,
    dt_s: Float[Array, ""],
    counts: Float[Array, " e"],
    squeezed: Bool[Array, ""] | bool = True,
) -> tuple[MutualState, MutualReading]:
    """One frame, dt_s after the last [s]: counts (r c,) row by row, NaN where missing.

    `squeezed`: something may just press harder; False only where that is known from elsewhere.
    """
    columns, rows = grid.model.column_x_m.shape[0], grid.model.row_y_m.shape[0]
    read = array_signal(grid.array, state.array, counts)
    image, valid = (each.reshape(rows, columns).T for each in (read.signal_counts, read.valid))
    squeezed = jnp.asarray(squeezed)
    known = expected(grid.model, grid.follower, state.tracks, dt_s, squeezed)
    weight = jnp.where(valid, 1.0 / grid.model.noise_counts, 0.0).ravel()
    _, _, evidence = best_place(grid.model, image.ravel(), weight)
    misfit = jnp.sum((image.ravel() * weight) ** 2)
    # Coupling that cancels shielding leaves more than noise, for their shapes differ: else nothing is there.
    fit = jax.lax.cond(
        (evidence > grid.near_sigma**2) | (known.there.any() & (misfit > grid.near_sigma**2)),
        lambda: fit_sources(grid.model, grid.splitting, known, image, valid),
        lambda: no_fit(grid.model, grid.touches),
    )
    tracks = follow_touches(grid.follower, state.tracks, dt_s, known, fit, squeezed)
    array = track_baseline(grid.array, state.array, dt_s, counts, tracks.there.any(), tracks.touching.any())
    overlong = jnp.any(tracks.touched_s > grid.follower.longest_touch_s)
    fresh = mutual_init(grid)
    later = jax.tree.map(lambda anew, on: jnp.where(overlong, anew, on), fresh, MutualState(array, tracks))
    later = eqx.tree_at(lambda s: s.tracks.last_number, later, tracks.last_number)
    return later, MutualReading(tracks, image, fit, valid)
