"""The finger's sensors in the terms of the estimator: cable lengths, pressures of sealed cavities, and
touched electrodes that say which contacts may press.

Readings are the cables' shortenings, then the gauge pressures. Both are averaged over `average_s` by an
exponential mean, which leaves σ √(dt / 2τ) of their noise and lags τ behind: shapes are slow, noise is not.
To the noise of the pressures comes the error of the modelled ones: a part `model_error` of the largest change
among all cavities, for what the model misses of one way of bending is seen in every cavity. While something
is near, changes count from the last frame before: what the model misses of the shape before is known
(`estimation.model_offset`).
The finger rests while no electrode is touched and no cable is pulled.
"""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from softfuse.sensing.electrodes import (
    ElectrodeDetector,
    ElectrodeReading,
    ElectrodeState,
    electrode_init,
    electrode_update,
)
from softfuse.sensing.frame_time import FrameClock, clock_init, frame_step
from softfuse.sensing.pressure import (
    PressureReading,
    PressureSensor,
    PressureState,
    pressure_init,
    pressure_update,
)
from softfuse.sensing.senses import AbstractSenses, Sensed
from softfuse.sensing.status import Status


class FingerMeasurement(eqx.Module):
    """What pressures (k,), electrodes (n,) and cables (b,) [m], above their zeros, say about one frame."""

    pressure: PressureReading
    electrodes: ElectrodeReading
    cable_m: Float[Array, " b"]


class FingerSenseState(eqx.Module):
    """Memory between frames."""

    clock: FrameClock
    pressure: PressureState
    electrodes: ElectrodeState
    mean_Pa: Float[Array, " k"]
    mean_known: Bool[Array, " k"]
    cable_m: Float[Array, " b"]
    clear_Pa: Float[Array, " k"]
    places: Int[Array, " c"]
    pressing: Bool[Array, " c"]


class FingerSenses(AbstractSenses):
    """Pressure sensors, electrodes and cable lengths; groups of readings: pressures [V], their supply [V],
    electrodes [counts], cables [m].

    `gain` (k,) [-]: measured over modelled pressures; `model_error` [-]: see above; `middle_m` (n, 3): of the
    electrodes on the body at rest; `cable_zero_m` (b,): what is read where cables get taut; `cable_sigma_m`
    (b,): noise of the lengths; `slack_m` (b,): a cable that is shorter by less leaves the finger at rest;
    `contacts`: followed at once; `supplies`: 1 when the supply is measured, 0 when it is the nominal one;
    `lengths`: b when the cables' lengths are measured, else 0.
    """

    pressure: PressureSensor
    electrodes: ElectrodeDetector
    gain: Float[Array, " k"]
    model_error: Float[Array, ""]
    middle_m: Float[Array, "n 3"]
    cable_zero_m: Float[Array, " b"]
    cable_sigma_m: Float[Array, " b"]
    slack_m: Float[Array, " b"]
    average_s: Float[Array, ""]
    contacts: int = eqx.field(static=True)
    supplies: int = eqx.field(static=True)
    lengths: int = eqx.field(static=True)

    def of_noise_alone(self) -> "FingerSenses":
        """The same, of a model that is taken to be right."""
        return replace(self, model_error=jnp.zeros(()))

    @property
    def channels(self):
        """Cavities, supplies, electrodes, cables."""
        return self.pressure.offset.shape[0], self.supplies, self.middle_m.shape[0], self.lengths

    def init(self):
        """State before the first frame; the finger is taken to be untouched."""
        k = self.pressure.offset.shape[0]
        return FingerSenseState(
            clock=clock_init(),
            pressure=pressure_init(self.pressure),
            electrodes=electrode_init(self.electrodes, self.contacts),
            mean_Pa=jnp.zeros(k),
            mean_known=jnp.zeros(k, bool),
            cable_m=jnp.full(self.cable_sigma_m.shape, jnp.nan),
            clear_Pa=jnp.zeros(k),
            places=jnp.zeros(self.contacts, int),
            pressing=jnp.zeros(self.contacts, bool),
        )

    def update(self, state, time_s, readings):
        """One frame of pressures (k,) and supply (0 or 1,) [V], electrodes (n,) [counts], cables (b,) [m]."""
        volts, supply, counts, cable = readings
        measured = jnp.append(supply, jnp.nan)[0]
        length_lost = jnp.any(~jnp.isfinite(cable))
        unknown = jnp.full(self.cable_sigma_m.shape, jnp.nan)
        cable = cable - self.cable_zero_m if self.lengths else unknown
        clock, time = frame_step(state.clock, time_s)
        dt = time.dt_s
        touch_state, touch = electrode_update(self.electrodes, state.electrodes, dt, counts)
        # A length that is not read says nothing: a cable that slips off must not stop the tare for ever.
        pulled = jnp.any(jnp.where(jnp.isfinite(cable), jnp.abs(cable) > self.slack_m, False))
        clear = ~jnp.any(touch.near)
        resting = clear & ~pulled
        pressure_state, pressure = pressure_update(
            self.pressure, state.pressure, dt, volts, measured, resting
        )
        mean, known, noise = self._averaged(state, dt, pressure)
        # The pressure of a cavity that leaks is true, but no longer that of the gas it was sealed with.
        valid = pressure.valid & known & ~pressure.leaking
        change = mean - jnp.where(clear, 0.0, state.clear_Pa)
        missed = self.model_error * jnp.max(jnp.where(valid, jnp.abs(change), 0.0))
        sigma = jnp.hypot(noise, missed)
        lag = jnp.exp(-dt / self.average_s)
        lagging = cable + lag * (state.cable_m - cable)
        length = jnp.where(jnp.isfinite(state.cable_m), lagging, cable)
        places, pressing = _places(state, touch)
        later = FingerSenseState(
            clock,
            pressure_state,
            touch_state,
            mean,
            known,
            length,
            jnp.where(clear, mean, state.clear_Pa),
            places,
            pressing,
        )
        flags = {
            Status.bad_time: ~time.forward,
            Status.clock_anew: time.anew,
            Status.pressure_missing: jnp.any(pressure.missing),
            Status.pressure_range: jnp.any(pressure.out_of_range),
            Status.leak: jnp.any(pressure.leaking),
            Status.cable_missing: length_lost,
            Status.electrode_lost: jnp.any(touch.lost | touch.missing),
        }
        length_known = jnp.isfinite(length)
        return later, Sensed(
            reading=jnp.concatenate([jnp.where(length_known, length, 0.0), mean / self.gain]),
            sigma=jnp.concatenate([self.cable_sigma_m, sigma / self.gain]),
            valid=jnp.concatenate([length_known, valid]),
            touching=pressing,
            pressing=pressing,
            clear=clear,
            places=places,
            location_m=jnp.where(pressing[:, None], self.middle_m[places], jnp.nan),
            location_sigma_m=jnp.full((self.contacts, 2), jnp.nan),
            flags=flags,
            details=FingerMeasurement(pressure, touch, cable),
        )

    def _averaged(
        self, state: FingerSenseState, dt: Float[Array, ""], seen: PressureReading
    ) -> tuple[Array, Array, Array]:
        """Mean pressure (k,) [Pa], whether it is known (k,), and its standard deviation (k,) [Pa]."""
        share = 1 - jnp.exp(-dt / self.average_s)
        moved = state.mean_Pa + share * (seen.gauge_Pa - state.mean_Pa)
        fresh = jnp.where(state.mean_known, moved, seen.gauge_Pa)
        mean = jnp.where(seen.valid, fresh, state.mean_Pa)
        noise = self.pressure.noise_V / self.pressure.supply_V / self.pressure.gain_1_Pa
        left = noise**2 * share / (2 - share)
        rest = jnp.maximum(seen.sigma_Pa**2 - noise**2, 0.0)
        return mean, state.mean_known | seen.valid, jnp.sqrt(rest + left)


def _places(state: FingerSenseState, touch: ElectrodeReading) -> tuple[Array, Array]:
    """Electrodes (c,) in the contacts' slots, and which of them press (c,).

    A slot that passes from one electrode to another is without force for one frame: a force belongs to its
    place.
    """
    passed = state.pressing & touch.slots.used & (touch.slots.electrode != state.places)
    places = jnp.where(passed | ~touch.slots.used, state.places, touch.slots.electrode)
    return places, touch.slots.used & ~passed
