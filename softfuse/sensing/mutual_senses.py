"""A pad with vented cavities under a grid of mutual capacitances, in the terms of the estimator.

Each touch of the grid that has a contact slot is a contact; of those that touch at once, the first keep
theirs (`slots`). Volumes come from the flow, whose zero is tracked while nothing touches. It tells in turn
what an image hardly can: without flow out of the cavities nothing presses harder, so that what seems to has
gone.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from softfuse.sensing.flow import (
    FlowReading,
    FlowSensor,
    FlowState,
    flow_drift,
    flow_init,
    flow_update,
    squeeze_evidence,
)
from softfuse.sensing.frame_time import FrameClock, clock_init, frame_step
from softfuse.sensing.mutual import MutualGrid, MutualReading, MutualState, mutual_init, mutual_update
from softfuse.sensing.senses import AbstractSenses, Sensed
from softfuse.sensing.slots import ContactSlots, assign_slots, slots_init
from softfuse.sensing.status import Status
from softfuse.sensing.truncated_place import within

_SQUEEZED_SIGMA = 3.0  # of the flow: below, nothing flows


class MutualMeasurement(eqx.Module):
    """What flow sensors and grid say about one frame."""

    flow: FlowReading
    grid: MutualReading
    slots: ContactSlots
    """Which track is which contact."""

    @property
    def image(self) -> Float[Array, "c r"]:
        """(c, r) counts above the baseline, first index along x."""
        return self.grid.image


class MutualSenseState(eqx.Module):
    """Memory between frames."""

    clock: FrameClock
    flow: FlowState
    grid: MutualState
    slots: ContactSlots
    places_m: Float[Array, "n 3"]


class MutualSenses(AbstractSenses):
    """Flow sensors and a grid; groups of readings: flow [V], cells row by row [counts].

    `workspace_m` (2, 2): lowest and highest x, y of a contact's middle [m], in which places are taken to be
    as far as images allow; `contacts`: followed at once.
    """

    flow: FlowSensor
    grid: MutualGrid
    workspace_m: Float[Array, "2 2"]
    contacts: int = eqx.field(static=True)

    @property
    def channels(self):
        """Cavities, cells."""
        model = self.grid.model
        return self.flow.zero_V.shape[0], model.column_x_m.shape[0] * model.row_y_m.shape[0]

    @property
    def drift(self):
        """That of the flow sensors' zero."""
        return flow_drift(self.flow)

    def init(self):
        """State before the first frame; the pad is taken to be untouched.

        Raises ConfigError when there are more contacts than touches that the grid follows.
        """
        low, high = self.workspace_m
        # Contacts that nothing has touched yet wait apart: two in one place would be one.
        share = (jnp.arange(self.contacts) + 0.5)[:, None] / self.contacts
        waiting = jnp.concatenate([low + share * (high - low), jnp.zeros((self.contacts, 1))], axis=1)
        return MutualSenseState(
            clock=clock_init(),
            flow=flow_init(self.flow),
            grid=mutual_init(self.grid),
            slots=slots_init(self.contacts, self.grid.touches),
            places_m=waiting,
        )

    def update(self, state, time_s, readings):
        """One frame of flow (k,) [V] and cells (r c,) [counts]."""
        volts, counts = readings
        started = jnp.isfinite(state.clock.time_s)
        clock, time = frame_step(state.clock, time_s)
        dt = time.dt_s
        squeezed = squeeze_evidence(self.flow, state.flow) > _SQUEEZED_SIGMA
        grid_state, grid = mutual_update(self.grid, state.grid, dt, counts, squeezed)
        tracks = grid.tracks
        flow_state, flow = flow_update(self.flow, state.flow, dt, volts, tracks.touching.any())
        slots = assign_slots(state.slots, jnp.maximum(tracks.shield, tracks.coupling), tracks.touching)
        touching = slots.used
        at, spread = tracks.place_m[slots.electrode], tracks.place_sigma_m[slots.electrode]
        located = touching & jnp.all(jnp.isfinite(at) & jnp.isfinite(spread), axis=1)
        inside, mean, deviation = within(at, spread, self.workspace_m)
        at, spread = (jnp.where(inside[:, None], *each) for each in ((mean, at), (deviation, spread)))
        known = flow.volume_valid.any()
        flat = jnp.concatenate([at, jnp.zeros((self.contacts, 1))], axis=1)
        places = jnp.where((located & inside)[:, None], flat, state.places_m)
        flags = {
            Status.bad_time: ~time.forward,
            Status.clock_anew: time.anew,
            Status.flow_missing: jnp.any(flow.missing),
            Status.flow_saturated: jnp.any(flow.saturated),
            Status.electrode_lost: self._lost(started, grid.valid, counts),
            Status.location_unknown: jnp.any(touching & ~located),
            Status.outside: jnp.any(located & ~inside),
            Status.volume_unknown: jnp.any(located & inside) & ~known,
        }
        return MutualSenseState(clock, flow_state, grid_state, slots, places), Sensed(
            reading=flow.volume_change_m3,
            sigma=flow.volume_sigma_m3,
            valid=flow.volume_valid,
            touching=touching,
            pressing=located & inside & known,
            clear=~tracks.touching.any(),
            places=places,
            location_m=jnp.where(located[:, None], flat, jnp.nan),
            location_sigma_m=jnp.where(located[:, None], spread, jnp.nan),
            flags=flags,
            details=MutualMeasurement(flow, grid, slots),
            drift=flow.drift,
        )

    def _lost(
        self, started: Bool[Array, ""], valid: Bool[Array, "c r"], counts: Float[Array, " e"]
    ) -> Bool[Array, ""]:
        """Whether a cell says nothing; in the first frame none has a baseline yet."""
        return jnp.where(started, ~valid.all(), ~jnp.isfinite(counts).all())
