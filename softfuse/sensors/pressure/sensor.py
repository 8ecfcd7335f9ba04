"""Pressure sensors on chambers: raw to gauge pressure since rest, with tare, range and leak checks.

    raw = R (gain P + offset),   p = P - zero.

The reference R is the supply [V] of a ratiometric part, 1 V of another with a voltage, the number of codes of
a digital one (`settings`). Parts are some per cent of full scale off, so every channel is tared (tare.py). p
[Pa] is positive in a squeezed chamber. Escaping gas is looked for by leak.py.

Which part: one that reads from 0 up (over the atmosphere, or between its ports) says nothing of a stretched
chamber, and a bent body stretches half of its chambers: these are then out of range, not at zero.

Touch is recognised some frames late, so the tare and the leak test run `lag` frames behind and use a frame
only if the body has rested until now; and only when it has rested for `hold_off_s`, since gas that was
compressed or expanded takes some tenths of a second to regain the temperature of the walls (up to 29 % of its
pressure).

What is measured is averaged over `average` by an exponential mean, which leaves σ √(dt / 2τ) of the noise and
lags τ behind: shapes are slow, noise is not. To the noise of the pressures comes the error of the modelled
ones: a part `model_error` of the largest change among all chambers, for what the model misses of one way of
bending is seen in every chamber. While something is near, changes count from the last frame before: what the
model misses of the shape before is known (`estimation.model_error`).

The pressure of sealed gas tells the change of its volume V, tube and port included, whose gas is compressed
as well:

    p_abs V^κ = P0 V0^κ,   p_abs = P0 + p,   dV = V - V0 = V0 ((1 + p/P0)^(-1/κ) - 1),

negative in a squeezed chamber, as with flow sensors. κ = 1 isothermal (slower than about a second: the gas of
a chamber a few millimetres wide takes up the temperature of its walls within some tenths), κ = 1.4 adiabatic
air. Source: Navarro et al., RA-L 5(4), 2020, eqs. (5) to (7).
"""

from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from softfuse.sensors.base import AbstractSensor, Hint, Measurement, VolumeChange
from softfuse.sensors.lag import lag_of, oldest, pushed, usable_mean
from softfuse.sensors.pressure.leak import LeakState, LeakTest, leak_init, leak_rate, leak_update
from softfuse.sensors.tare import Tare, TareState, tare_init, tare_known, tare_update, tare_variance


class PressureFrame(NamedTuple):
    """What k channels said in a frame, or in each of n: the step to it [s], pressures [Pa], whether these are
    readings, and whether the part can measure what is there.
    """

    dt_s: Float[Array, "*n"]
    pressure_Pa: Float[Array, "*n k"]
    usable: Bool[Array, "*n k"]
    in_range: Bool[Array, "*n k"]


class PressureState(eqx.Module):
    """Memory between frames: zero, gas balance and the last `lag` frames; means (k,) [Pa], and these when
    nothing was near.
    """

    tare: TareState
    leak: LeakState
    rested_s: Float[Array, ""]
    lag: PressureFrame
    """Each (n, ...)."""
    mean_Pa: Float[Array, " k"]
    mean_known: Bool[Array, " k"]
    clear_Pa: Float[Array, " k"]


class PressureReading(eqx.Module):
    """What the pressure sensors say about one frame."""

    gauge_Pa: Float[Array, " k"]
    """(k,) pressure since rest; the last one while there is no reading [Pa]."""
    sigma_Pa: Float[Array, " k"]
    """(k,) its standard deviation: noise, error and drift of the zero, gain [Pa]."""
    valid: Bool[Array, " k"]
    """(k,) read, in range and tared."""
    missing: Bool[Array, " k"]
    """(k,) no reading in this frame."""
    out_of_range: Bool[Array, " k"]
    """(k,) beyond the part's range, at the converter's end, or a supply with which nothing can be read."""
    leaking: Bool[Array, " k"]
    """(k,) gas has escaped (leak.py); the reading itself is still the pressure."""
    leak_rate_1_s: Float[Array, " k"]
    """(k,) rate 1/τ at which it escapes [1/s]."""
    leak_rate_sigma_1_s: Float[Array, " k"]
    """(k,) its standard deviation [1/s]."""


class GaugePressure(AbstractSensor):
    """k equal pressure sensors, one on each of some chambers."""

    sealed: tuple[bool, ...] = eqx.field(static=True)
    """Whether the gas of each chamber does not escape, so that its pressure tells the volume."""
    supplied: bool = eqx.field(static=True)
    """The last channel is the reference."""
    gain_1_Pa: Float[Array, " k"]
    """(k,) output over reference per pressure [1/Pa]."""
    offset: Float[Array, " k"]
    """(k,) output over reference at P = 0 [-]."""
    rest_Pa: Float[Array, " k"]
    """(k,) pressure at rest: the atmosphere for an absolute part, 0 for the others [Pa]."""
    low_Pa: Float[Array, " k"]
    """(k,) lowest reading of a good part in its range [Pa]."""
    high_Pa: Float[Array, " k"]
    """(k,) highest [Pa]."""
    lowest_gauge_Pa: Float[Array, " k"]
    """(k,) lowest pressure since rest that the part can measure [Pa]."""
    reference: Float[Array, ""]
    """Nominal reference, used where none is measured."""
    reference_low: Float[Array, ""]
    """Lowest reference with which the part is ratiometric."""
    reference_high: Float[Array, ""]
    """Highest such reference."""
    clip_low: Float[Array, ""]
    """Readings at or below are at the converter's end."""
    clip_high: Float[Array, ""]
    """Readings at or above are at the converter's end."""
    noise: Float[Array, ""]
    """Standard deviation of one reading, quantisation included; like the ends, in the unit of the channel."""
    gain_sigma: Float[Array, ""]
    """Relative standard deviation of the gain [-]."""
    range_sigma: Float[Array, ""]
    """How far below lowest_gauge_Pa noise alone may reach [standard deviations]."""
    hold_off_s: Float[Array, ""]
    """Time at rest before readings are used as those of rest [s]."""
    tare: Tare
    """How zeros are taken."""
    leak: LeakTest
    """The leak test."""
    gain: Float[Array, " k"]
    """(k,) measured over modelled pressures [-]."""
    model_error: Float[Array, ""]
    """See above [-]."""
    average_s: Float[Array, ""]
    """Time constant of the mean [s]."""
    volume_m3: Float[Array, " k"]
    """(k,) of chamber and dead volume at rest [m^3]."""
    atmosphere_Pa: Float[Array, " k"]
    """(k,) absolute pressure of the gas at rest [Pa]."""
    exponent: Float[Array, " k"]
    """(k,) of that gas [-]."""
    lag_frames: int = eqx.field(static=True)
    """Number of frames by which tare and leak test run behind."""

    def init(self):
        """At rest."""
        # A state of other dtypes than its successor's would compile the update twice.
        rest = jnp.asarray(self.rest_Pa, float)
        nothing, no = jnp.zeros(rest.shape), jnp.zeros(rest.shape, bool)
        return PressureState(
            tare=tare_init(self.tare, rest),
            leak=leak_init(len(rest)),
            rested_s=jnp.asarray(self.hold_off_s, float),
            lag=lag_of(PressureFrame(jnp.zeros(()), rest, no, no), self.lag_frames),
            mean_Pa=nothing,
            mean_known=no,
            clear_Pa=nothing,
        )

    def hint(self, state):
        """By how much the mean over the lag is above the zero, of sealed gas."""
        here = np.flatnonzero(self.sealed)
        if not here.size:
            return None
        yes = jnp.ones(here.size, bool)
        return Hint(self._excess(state)[here], yes, yes)

    def driven(self, state, raw):
        """Whether a chamber that is not sealed has another pressure than at rest."""
        excess = self._excess(state)[np.flatnonzero(~np.array(self.sealed))]
        return jnp.any(jnp.abs(excess) > self.tare.gate_sigma)

    def update(self, state, frame, raw, context):
        """Raw readings, and the reference as the last of them where it is measured; `details`:
        PressureReading.
        """
        k = len(self.sealed)
        reference = raw[k] if self.supplied else jnp.asarray(jnp.nan)
        later, seen = self.filtered(state, frame.dt_s, raw[:k], reference, context.resting)
        mean, known, noise = self._averaged(state, frame.dt_s, seen)
        # The pressure of a chamber that leaks is true, but no longer that of the gas it was sealed with.
        leaking = seen.leaking & jnp.asarray(self.sealed)
        valid = seen.valid & known & ~leaking
        change = mean - jnp.where(context.clear, 0.0, state.clear_Pa)
        missed = self.model_error * jnp.max(jnp.where(valid, jnp.abs(change), 0.0))
        sigma = jnp.hypot(noise, missed)
        flags = {
            f"{self.name} missing": jnp.any(seen.missing),
            f"{self.name} out of range": jnp.any(seen.out_of_range),
            f"{self.name} leaks": jnp.any(leaking),
        }
        clear = jnp.where(context.clear, mean, state.clear_Pa)
        told = self._volume(mean / self.gain, valid) if any(self.sealed) else None
        return replace(later, mean_Pa=mean, mean_known=known, clear_Pa=clear), Measurement(
            mean / self.gain, sigma / self.gain, valid, flags, None, told, seen
        )

    def filtered(
        self,
        state: PressureState,
        dt_s: Float[Array, ""],
        raw: Float[Array, " k"],
        reference: Float[Array, ""],
        resting: Bool[Array, ""],
    ) -> tuple[PressureState, PressureReading]:
        """One frame, not yet averaged.

        Args: dt_s time since the last frame [s], 0 for the first; raw (k,) readings [V], NaN where missing;
        reference measured supply [V], NaN for the nominal one; resting: nothing touches or actuates the body.
        """
        state = self._follow_rest(state, dt_s, resting)
        supply = jnp.where(jnp.isfinite(reference), reference, self.reference)
        supplied = (supply >= self.reference_low) & (supply <= self.reference_high)
        supply = jnp.where(supplied, supply, self.reference)
        missing = ~jnp.isfinite(raw)
        usable = ~missing & supplied & (raw > self.clip_low) & (raw < self.clip_high)
        # A NaN that is only masked afterwards would still make every derivative NaN.
        pressure = self.pressure_of(jnp.where(missing, 0.0, raw), supply)
        pressure = jnp.where(missing | ~supplied, state.lag.pressure_Pa[-1], pressure)

        gauge = pressure - state.tare.zero_Pa
        absolute_sigma = jnp.sqrt(self._noise_Pa**2 + tare_variance(self.tare, state.tare))
        within = (pressure >= self.low_Pa) & (pressure <= self.high_Pa)
        within = within & (gauge >= self.lowest_gauge_Pa - self.range_sigma * absolute_sigma)
        in_range = usable & within
        rate, rate_sigma = leak_rate(self.leak, state.leak)
        lag = pushed(state.lag, PressureFrame(dt_s, pressure, usable, in_range))
        return replace(state, lag=lag), PressureReading(
            gauge_Pa=gauge,
            sigma_Pa=jnp.sqrt(absolute_sigma**2 + (self.gain_sigma * gauge) ** 2),
            valid=in_range & tare_known(self.tare, state.tare),
            missing=missing,
            out_of_range=~missing & ~in_range,
            leaking=state.leak.leaking,
            leak_rate_1_s=rate,
            leak_rate_sigma_1_s=rate_sigma,
        )

    def pressure_of(self, raw: Float[Array, " k"], reference: Float[Array, ""]) -> Float[Array, " k"]:
        """Pressure P = (V/Vs - offset) / gain: raw (k,) [V], reference Vs [V]; returns (k,) [Pa]."""
        return (raw / reference - self.offset) / self.gain_1_Pa

    @property
    def _noise_Pa(self) -> Float[Array, " k"]:
        """Standard deviation of one reading at the nominal supply: (k,) [Pa]."""
        return self.noise / (self.reference * self.gain_1_Pa)

    def _follow_rest(
        self, state: PressureState, dt_s: Float[Array, ""], resting: Bool[Array, ""]
    ) -> PressureState:
        """Tare and leak test over the oldest frame of the lag."""
        rested = jnp.where(resting, state.rested_s + dt_s, 0.0)
        behind = jnp.sum(state.lag.dt_s[1:]) + dt_s
        at_rest = resting & (rested - behind >= self.hold_off_s)
        old, noise = oldest(state.lag), self._noise_Pa
        told = old.dt_s, old.pressure_Pa, noise
        return replace(
            state,
            tare=tare_update(self.tare, state.tare, *told, at_rest & old.usable),
            leak=leak_update(self.leak, state.leak, *told, old.usable, old.in_range, at_rest),
            rested_s=rested,
        )

    def _excess(self, state: PressureState) -> Float[Array, " k"]:
        """Mean pressure (k,) over the lag above the zero, in standard deviations; 0 before that is known."""
        mean, count = usable_mean(state.lag.pressure_Pa, state.lag.usable)
        variance = tare_variance(self.tare, state.tare) + self._noise_Pa**2 / jnp.maximum(count, 1)
        known = tare_known(self.tare, state.tare) & (count > 0)
        return jnp.where(known, (mean - state.tare.zero_Pa) / jnp.sqrt(variance), 0.0)

    def _averaged(
        self, state: PressureState, dt: Float[Array, ""], seen: PressureReading
    ) -> tuple[Array, Array, Array]:
        """Mean pressure (k,) [Pa], whether it is known (k,), and its standard deviation (k,) [Pa]."""
        share = 1 - jnp.exp(-dt / self.average_s)
        moved = state.mean_Pa + share * (seen.gauge_Pa - state.mean_Pa)
        fresh = jnp.where(state.mean_known, moved, seen.gauge_Pa)
        mean = jnp.where(seen.valid, fresh, state.mean_Pa)
        noise = self.noise / self.reference / self.gain_1_Pa
        left = noise**2 * share / (2 - share)
        rest = jnp.maximum(seen.sigma_Pa**2 - noise**2, 0.0)
        return mean, state.mean_known | seen.valid, jnp.sqrt(rest + left)

    def _volume(self, gauge_Pa: Float[Array, " k"], valid: Bool[Array, " k"]) -> VolumeChange:
        """Changes of the volumes of sealed gas."""
        here = np.flatnonzero(self.sealed)
        least = -0.99 * self.atmosphere_Pa[here]
        change = volume_change_of(
            jnp.maximum(gauge_Pa[here], least),
            self.volume_m3[here],
            self.atmosphere_Pa[here],
            self.exponent[here],
        )
        return VolumeChange(change, valid[here])


def volume_change_of(
    gauge_Pa: Float[Array, " *k"],
    volume_m3: Float[Array, " *#k"],
    atmosphere_Pa: float | Float[Array, " *#k"],
    exponent: float | Float[Array, " *#k"] = 1.0,
) -> Float[Array, " *k"]:
    """Volume change [m^3] of sealed gas whose pressure has changed.

    Args: gauge_Pa p since rest [Pa]; volume_m3 V0 at rest [m^3]; atmosphere_Pa absolute pressure P0 at rest
    [Pa]; exponent κ [-].
    Returns: dV of gauge_Pa's shape, > -V0; infinite at vacuum, NaN below it.
    """
    # expm1 and log1p: the plain power loses 1e-16 P0 V0 to rounding, which is 1e-10 of a pressure of 0.1 Pa.
    return volume_m3 * jnp.expm1(-jnp.log1p(gauge_Pa / atmosphere_Pa) / exponent)
