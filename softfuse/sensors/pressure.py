"""Pressure sensors on sealed cavities: volts to gauge pressure since rest, with tare, range and leak checks.

    Vout = Vs (gain P + offset),   p = P - zero.

NXP MPX5100 (data sheet rev. 14): gain 0.009 per kPa; offset -0.095 for part A (absolute, 15 to 115 kPa),
+0.04 for D and G (differential and gauge, 0 to 100 kPa); ratiometric to a supply Vs of 4.75 to 5.25 V; up to
2.5 % of full scale off, so every channel is tared (tare.py). p [Pa] is positive in a squeezed cavity.
Escaping gas is looked for by leak.py.

Which part: D and G cannot read below 0 kPa (the output is then under 0.04 Vs, of which a real output stage
gives little and the data sheet guarantees nothing), and a bent finger stretches half of its cavities: these
are then out of range, not at zero. A reads both signs, but only 13.7 kPa above the atmosphere.

Touch is recognised some frames late, so the tare and the leak test run `lag` frames behind and use a frame
only if the finger has rested until now; and only when it has rested for `hold_off_s`, since gas that was
compressed or expanded takes some tenths of a second to regain the temperature of the walls (up to 29 % of its
pressure).
"""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from softfuse.sensors.leak import LeakState, LeakTest, leak_init, leak_rate, leak_test, leak_update
from softfuse.sensors.tare import (
    Tare,
    TareState,
    tare_init,
    tare_known,
    tare_settings,
    tare_update,
    tare_variance,
)

ATMOSPHERE_PA = 101325.0


class PressureSensor(eqx.Module):
    """Parameters of k equal pressure sensors; every field but `lag` is a leaf."""

    gain_1_Pa: Float[Array, " k"]
    """(k,) output over supply per pressure [1/Pa]."""
    offset: Float[Array, " k"]
    """(k,) output over supply at P = 0 [-]."""
    rest_Pa: Float[Array, " k"]
    """(k,) pressure at rest: the atmosphere for an absolute part, 0 for the others [Pa]."""
    low_Pa: Float[Array, " k"]
    """(k,) lowest reading of a good part in its range [Pa]."""
    high_Pa: Float[Array, " k"]
    """(k,) highest [Pa]."""
    lowest_gauge_Pa: Float[Array, " k"]
    """(k,) lowest pressure since rest that the part can measure [Pa]."""
    supply_V: Float[Array, ""]
    """Nominal supply, used where none is measured [V]."""
    supply_low_V: Float[Array, ""]
    """Lowest supply with which the part is ratiometric [V]."""
    supply_high_V: Float[Array, ""]
    """Highest such supply [V]."""
    clip_low_V: Float[Array, ""]
    """Readings at or below are at the converter's end [V]."""
    clip_high_V: Float[Array, ""]
    """Readings at or above are at the converter's end [V]."""
    noise_V: Float[Array, ""]
    """Standard deviation of one reading, quantisation included [V]."""
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


def mpx5100a(
    channels: int,
    *,
    supply_V: float = 5.0,
    atmosphere_Pa: float = ATMOSPHERE_PA,
    noise_V: float = 2e-3,
    clip_low_V: float = 2e-3,
    clip_high_V: float = 4.998,
    gain_sigma: float = 0.01,
    hold_off_s: float = 1.0,
    lag: int = 10,
    tare: Tare | None = None,
    leak: LeakTest | None = None,
) -> PressureSensor:
    """NXP MPX5100A, absolute, 15 to 115 kPa, on a 12-bit converter of 5 V.

    Args: channels: number of sensors k; tare, leak: by default tare_settings(), leak_test(); the other
    options are the fields of PressureSensor. 2 mV is 44 Pa; one step of the converter is 27 Pa.
    """
    return PressureSensor(
        gain_1_Pa=jnp.full(channels, 9e-6, float),
        offset=jnp.full(channels, -0.095, float),
        rest_Pa=jnp.full(channels, atmosphere_Pa, float),
        low_Pa=jnp.full(channels, 15e3, float),
        high_Pa=jnp.full(channels, 115e3, float),
        lowest_gauge_Pa=jnp.full(channels, 15e3 - atmosphere_Pa, float),
        supply_V=jnp.asarray(supply_V, float),
        supply_low_V=jnp.asarray(4.75, float),
        supply_high_V=jnp.asarray(5.25, float),
        clip_low_V=jnp.asarray(clip_low_V, float),
        clip_high_V=jnp.asarray(clip_high_V, float),
        noise_V=jnp.asarray(noise_V, float),
        gain_sigma=jnp.asarray(gain_sigma, float),
        range_sigma=jnp.asarray(5.0, float),
        hold_off_s=jnp.asarray(hold_off_s, float),
        tare=tare_settings() if tare is None else tare,
        leak=leak_test() if leak is None else leak,
        lag=lag,
    )


def mpx5100d(
    channels: int,
    *,
    supply_V: float = 5.0,
    noise_V: float = 2e-3,
    clip_low_V: float = 2e-3,
    clip_high_V: float = 4.998,
    gain_sigma: float = 0.01,
    hold_off_s: float = 1.0,
    lag: int = 10,
    tare: Tare | None = None,
    leak: LeakTest | None = None,
) -> PressureSensor:
    """NXP MPX5100D, between its two ports, 0 to 100 kPa, on a 12-bit converter of 5 V.

    Args: as in mpx5100a. A good part may read 2.5 kPa (2.5 % of full scale) below 0 at rest: a lower reading
    is out of range, and so is any pressure below the one at rest.
    """
    like = mpx5100a(
        channels,
        supply_V=supply_V,
        noise_V=noise_V,
        clip_low_V=clip_low_V,
        clip_high_V=clip_high_V,
        gain_sigma=gain_sigma,
        hold_off_s=hold_off_s,
        lag=lag,
        tare=tare,
        leak=leak,
    )
    return replace(
        like,
        offset=jnp.full(channels, 0.04, float),
        rest_Pa=jnp.zeros(channels),
        low_Pa=jnp.full(channels, -2.5e3, float),
        high_Pa=jnp.full(channels, 100e3, float),
        lowest_gauge_Pa=jnp.zeros(channels),
    )


mpx5100g = mpx5100d
"""NXP MPX5100G, over the atmosphere, 0 to 100 kPa: the part D with one port left open."""


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
    sensor: PressureSensor, volts: Float[Array, " k"], supply_V: Float[Array, ""]
) -> Float[Array, " k"]:
    """Pressure P = (V/Vs - offset) / gain: volts (k,) [V], supply_V Vs [V]; returns (k,) [Pa]."""
    return (volts / supply_V - sensor.offset) / sensor.gain_1_Pa


def volts_of(
    sensor: PressureSensor, pressure_Pa: Float[Array, " k"], supply_V: Float[Array, ""]
) -> Float[Array, " k"]:
    """Output Vs (gain P + offset) of a perfect part: pressure_Pa P (k,) [Pa], supply_V Vs [V]; (k,) [V]."""
    return supply_V * (sensor.gain_1_Pa * pressure_Pa + sensor.offset)


def _noise(sensor: PressureSensor) -> Float[Array, " k"]:
    """Standard deviation of one reading at the nominal supply: (k,) [Pa]."""
    return sensor.noise_V / (sensor.supply_V * sensor.gain_1_Pa)


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
    volts: Float[Array, " k"],
    supply_V: Float[Array, ""],
    resting: Bool[Array, ""],
) -> tuple[PressureState, PressureReading]:
    """One frame.

    Args: dt_s time since the last frame [s], 0 for the first; volts (k,) readings [V], NaN where missing;
    supply_V measured supply [V], NaN for the nominal one; resting: nothing touches or actuates the device.
    Returns: the new state and the PressureReading.
    """
    state = _follow_rest(sensor, state, dt_s, resting)
    supply = jnp.where(jnp.isfinite(supply_V), supply_V, sensor.supply_V)
    supplied = (supply >= sensor.supply_low_V) & (supply <= sensor.supply_high_V)
    supply = jnp.where(supplied, supply, sensor.supply_V)
    missing = ~jnp.isfinite(volts)
    usable = ~missing & supplied & (volts > sensor.clip_low_V) & (volts < sensor.clip_high_V)
    # A NaN that is only masked afterwards would still make every derivative NaN.
    pressure = pressure_of(sensor, jnp.where(missing, 0.0, volts), supply)
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
