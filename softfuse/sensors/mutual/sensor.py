"""A grid of mutual capacitances under a flat face: several contacts, conducting or not, by its image.

Each touch of the grid that has a contact slot is a contact; of those that touch at once, the first keep
theirs (`slots`). Gas tells in turn what an image hardly can: without flow out of the chambers nothing presses
harder, so that what seems to has gone.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from softfuse.functional.chart import AbstractChart
from softfuse.sensors.base import AbstractContactSensor, Evidence, Image, Touch
from softfuse.sensors.contact_places import SlotsUsed, assign_slots, chart_places, slots_init, within
from softfuse.sensors.mutual.grid import MutualGrid, MutualReading, MutualState, mutual_init, mutual_update

_SQUEEZED_SIGMA = 3.0  # of the flow: below, nothing flows


class GridReading(eqx.Module):
    """What the grid says about one frame."""

    grid: MutualReading
    slots: SlotsUsed
    """Which track is which contact."""

    @property
    def image(self) -> Float[Array, "c r"]:
        """(c, r) counts above the baseline, first index along x."""
        return self.grid.image


class GridState(eqx.Module):
    """Memory between frames: of the grid, of the slots (n,), and where their contacts were (n, 2) [m]."""

    grid: MutualState
    slots: SlotsUsed
    at_m: Float[Array, "n 2"]


class _Seen(NamedTuple):
    """Memory within a frame."""

    state: GridState
    reading: MutualReading
    lost: Bool[Array, ""]


class MutualElectrodes(AbstractContactSensor):
    """The grid in the chart of the contact that it sees.

    `low_m`, `high_m` (2,): where middles of contacts may be [m], in which places are taken to be as far as
    images allow.
    """

    grid: MutualGrid
    chart: AbstractChart
    low_m: Float[Array, "2"]
    high_m: Float[Array, "2"]

    @property
    def misses(self):
        """What does not conduct couples."""
        return False

    def image(self, details):
        """Of all crossings."""
        x_m, y_m = (np.asarray(each) for each in (self.grid.model.column_x_m, self.grid.model.row_y_m))
        return Image(np.asarray(details.image).T, x_m, y_m)

    def init(self):
        """Untouched. Raises ConfigError when there are more contacts than touches that the grid follows."""
        # Contacts that nothing has touched yet wait apart: two in one place would be one.
        share = (jnp.arange(self.slots) + 0.5)[:, None] / self.slots
        waiting = self.low_m + share * (self.high_m - self.low_m)
        return GridState(mutual_init(self.grid), slots_init(self.slots, self.grid.touches), waiting)

    def touch(self, state, frame, raw, hint):
        """By the image of the cells (r c,), row by row, in counts."""
        flow, level = hint.still(hint.level), hint.still(~hint.level)
        squeezed = flow.squeezed() > _SQUEEZED_SIGMA
        # Gas that is squeezed already does not tell whether it is squeezed further.
        squeezed = squeezed | (level.squeezed() > _SQUEEZED_SIGMA)
        if not hint.outflow.size:
            squeezed = jnp.asarray(True)
        grid, read = mutual_update(self.grid, state.grid, frame.dt_s, raw, squeezed)
        tracks = read.tracks
        slots = assign_slots(state.slots, jnp.maximum(tracks.shield, tracks.coupling), tracks.touching)
        # In the first frame no cell has a baseline yet.
        lost = jnp.where(frame.first, ~jnp.isfinite(raw).all(), ~read.valid.all())
        near, touching = tracks.there.any(), tracks.touching.any()
        seen = _Seen(GridState(grid, slots, state.at_m), read, lost)
        return seen, Touch(near, slots.used, ~touching, jnp.asarray(False))

    def locate(self, state, frame, context, squeezed_m3):
        """In the workspace as far as the image allows."""
        del frame, context, squeezed_m3
        before, read = state.state, state.reading
        slots, tracks = before.slots, read.tracks
        touching = slots.used
        at, spread = tracks.place_m[slots.electrode], tracks.place_sigma_m[slots.electrode]
        located = touching & jnp.all(jnp.isfinite(at) & jnp.isfinite(spread), axis=1)
        inside, mean, deviation = within(at, spread, jnp.stack([self.low_m, self.high_m]))
        at, spread = (jnp.where(inside[:, None], *each) for each in ((mean, at), (deviation, spread)))
        # What is outside is told where it is, but nothing is pressed there.
        at_m = jnp.where((located & inside)[:, None], at, before.at_m)
        told = jnp.where(located[:, None], at, at_m)
        place, covariance = chart_places(self.chart, told, jnp.where(located[:, None], spread, 0.0))
        later = GridState(before.grid, slots, at_m)
        flags = {f"{self.name} lost": state.lost}
        return later, Evidence(
            touching, located, located & inside, place, covariance, flags, GridReading(read, slots)
        )
