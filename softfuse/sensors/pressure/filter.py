"""Pressure sensors on sealed cavities: raw to gauge pressure since rest, with tare, range and leak checks.

    raw = R (gain P + offset),   p = P - zero.

The reference R is the supply [V] of a ratiometric part, 1 V of another with a voltage, the number of codes of
a digital one (`sensor`). Parts are some per cent of full scale off, so every channel is tared (tare.py). p
[Pa] is positive in a squeezed cavity. Escaping gas is looked for by leak.py.

Which part: one that reads from 0 up (over the atmosphere, or between its ports) says nothing of a stretched
cavity, and a bent body stretches half of its cavities: these are then out of range, not at zero.

Touch is recognised some frames late, so the tare and the leak test run `lag` frames behind and use a frame
only if the body has rested until now; and only when it has rested for `hold_off_s`, since gas that was
compressed or expanded takes some tenths of a second to regain the temperature of the walls (up to 29 % of its
pressure).
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from softfuse.sensors.pressure.leak import LeakState, LeakTest, leak_init, leak_rate, leak_update
from softfuse.sensors.tare import (
    Tare,
    TareState,
    tare_init,
    tare_known,
    tare_update,
    tare_variance,
)


class PressureSensor(eqx.Module):
    """Parameters of k equal pressure sensors; every field but `lag` is a leaf."""

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
    lag: int = eqx.field(static=True)
    """Number of frames by which tare and leak test run behind."""


class PressureState(eqx.Module):
    """Memory of the sensors: zero, gas balance and the last `lag` frames."""

    tare: TareState
    leak: LeakState
    rested_s: Float[Array, ""]
    lag_dt_s: Float[Array, " n"]
    lag_Pa: Float[Array, "n k"]
    lag_usable: Bool[Array, "n k"]
    lag_in_range: Bool[Array, "n k"]


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


def pressure_init(sensor: PressureSensor) -> PressureState:
    """State before the first frame, at rest."""
    # A state of other dtypes than its successor's would compile the update twice.
    rest = jnp.asarray(sensor.rest_Pa, float)
    k, n = rest.shape[0], sensor.lag
    return PressureState(
        tare=tare_init(sensor.tare, rest),
        leak=leak_init(k),
        rested_s=jnp.asarray(sensor.hold_off_s, float),
        lag_dt_s=jnp.zeros(n),
        lag_Pa=jnp.broadcast_to(rest, (n, k)),
        lag_usable=jnp.zeros((n, k), bool),
        lag_in_range=jnp.zeros((n, k), bool),
    )


def pressure_of(
    sensor: PressureSensor, raw: Float[Array, " k"], reference: Float[Array, ""]
) -> Float[Array, " k"]:
    """Pressure P = (V/Vs - offset) / gain: raw (k,) [V], reference Vs [V]; returns (k,) [Pa]."""
    return (raw / reference - sensor.offset) / sensor.gain_1_Pa


def raw_of(
    sensor: PressureSensor, pressure_Pa: Float[Array, " k"], reference: Float[Array, ""]
) -> Float[Array, " k"]:
    """Output Vs (gain P + offset) of a perfect part: pressure_Pa P (k,) [Pa], reference Vs [V]; (k,) [V]."""
    return reference * (sensor.gain_1_Pa * pressure_Pa + sensor.offset)


def _noise(sensor: PressureSensor) -> Float[Array, " k"]:
    """Standard deviation of one reading at the nominal supply: (k,) [Pa]."""
    return sensor.noise / (sensor.reference * sensor.gain_1_Pa)


def _follow_rest(
    sensor: PressureSensor, state: PressureState, dt_s: Float[Array, ""], resting: Bool[Array, ""]
) -> PressureState:
    """Tare and leak test over the oldest frame of the lag."""
    rested = jnp.where(resting, state.rested_s + dt_s, 0.0)
    behind = jnp.sum(state.lag_dt_s[1:]) + dt_s
    at_rest = resting & (rested - behind >= sensor.hold_off_s)
    dt, pressure = state.lag_dt_s[0], state.lag_Pa[0]
    usable, in_range = state.lag_usable[0], state.lag_in_range[0]
    noise = _noise(sensor)
    return eqx.tree_at(
        lambda s: (s.tare, s.leak, s.rested_s),
        state,
        (
            tare_update(sensor.tare, state.tare, dt, pressure, noise, at_rest & usable),
            leak_update(sensor.leak, state.leak, dt, pressure, noise, usable, in_range, at_rest),
            rested,
        ),
    )


def pressure_update(
    sensor: PressureSensor,
    state: PressureState,
    dt_s: Float[Array, ""],
    raw: Float[Array, " k"],
    reference: Float[Array, ""],
    resting: Bool[Array, ""],
) -> tuple[PressureState, PressureReading]:
    """One frame.

    Args: dt_s time since the last frame [s], 0 for the first; raw (k,) readings [V], NaN where missing;
    reference measured supply [V], NaN for the nominal one; resting: nothing touches or actuates the device.
    Returns: the new state and the PressureReading.
    """
    state = _follow_rest(sensor, state, dt_s, resting)
    supply = jnp.where(jnp.isfinite(reference), reference, sensor.reference)
    supplied = (supply >= sensor.reference_low) & (supply <= sensor.reference_high)
    supply = jnp.where(supplied, supply, sensor.reference)
    missing = ~jnp.isfinite(raw)
    usable = ~missing & supplied & (raw > sensor.clip_low) & (raw < sensor.clip_high)
    # A NaN that is only masked afterwards would still make every derivative NaN.
    pressure = pressure_of(sensor, jnp.where(missing, 0.0, raw), supply)
    pressure = jnp.where(missing | ~supplied, state.lag_Pa[-1], pressure)

    gauge = pressure - state.tare.zero_Pa
    absolute_sigma = jnp.sqrt(_noise(sensor) ** 2 + tare_variance(sensor.tare, state.tare))
    within = (pressure >= sensor.low_Pa) & (pressure <= sensor.high_Pa)
    within = within & (gauge >= sensor.lowest_gauge_Pa - sensor.range_sigma * absolute_sigma)
    in_range = usable & within

    def append(lag, new):
        return jnp.concatenate([lag[1:], jnp.asarray(new)[None]])

    state = eqx.tree_at(
        lambda s: (s.lag_dt_s, s.lag_Pa, s.lag_usable, s.lag_in_range),
        state,
        (
            append(state.lag_dt_s, dt_s),
            append(state.lag_Pa, pressure),
            append(state.lag_usable, usable),
            append(state.lag_in_range, in_range),
        ),
    )
    rate, rate_sigma = leak_rate(sensor.leak, state.leak)
    return state, PressureReading(
        gauge_Pa=gauge,
        sigma_Pa=jnp.sqrt(absolute_sigma**2 + (sensor.gain_sigma * gauge) ** 2),
        valid=in_range & tare_known(sensor.tare, state.tare),
        missing=missing,
        out_of_range=~missing & ~in_range,
        leaking=state.leak.leaking,
        leak_rate_1_s=rate,
        leak_rate_sigma_1_s=rate_sigma,
    )
