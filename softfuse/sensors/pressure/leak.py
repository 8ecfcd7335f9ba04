"""Leak test of a sealed cavity: the balance of its gas from one rest to the next.

Gas that escapes in proportion to the gauge pressure p lowers the pressure m that the cavity has in its rest
shape, whatever has moved its walls in between:

    d(p_abs V)/dt = -θ p V0   =>   Δ = m_after - m_before = -θ I,   I = integral of p dt,   θ = 1/τ.

τ [s] is the time constant with which the pressure of the undeformed cavity decays. So a cavity that was
squeezed comes back below its zero, one that was stretched above it, and only then is a leak known: a pressure
that decays while something presses may as well be a hand that gives way. At rest the level m is followed
freely and says nothing: warm gas that cools decays just like gas that leaks.

Statistics. Each deformation j between two rests gives one Δ_j of variance
    s_j² = noise²(1/n_before + 1/n_after) + repeat² + (d T_j)² + (θ0 p_lost T_lost,j)²:
the noise of two means, how well the rest shape comes back, the drift d over the time T_j between the means,
and the unknown pressure while the channel was not readable. All deformations, with weights w that fade with
`memory_s` of deformed time, give the least-squares rate with the prior θ ~ N(0, σ_θ²)
    θ = -Σ w Δ I / s² / (Σ w I²/s² + 1/σ_θ²),   variance σ² = 1 / (Σ w I²/s² + 1/σ_θ²).
Leaks slower than 1/θ0 do no harm, the zero follows them. Under θ <= θ0, z = (θ - θ0)/σ is at most a standard
normal variable; a leak is reported when z > `sigma` (3e-7 a deformation with 5) and taken back when z <
-`sigma`/2. A deformation that contradicts the rate so far, |Δ + θ I| > `sigma` sqrt(s² + σ² I²), drops the
history: a fresh leak is seen at the first release however long the cavity was sound, a mended one soon after.

The test is one-sided: residual strain of the silicone after a press (creep) leaves Δ of the sign of I, that
is θ < 0. Gas that warms up in a stretched cavity, or cools in a squeezed one, does look like a leak: the
drift d is there for it. A cavity that is open (τ of some tenths of a second) shows no pressure and so no
leak.
"""

from dataclasses import fields, replace
from typing import Annotated, Self

import equinox as eqx
import jax.numpy as jnp
from annotated_types import Ge
from jaxtyping import Array, Bool, Float, Int
from pydantic import model_validator

from softfuse.io.quantity import PositiveNumber, PositivePressure, PositiveTime, PressureRate, wrong_value
from softfuse.io.settings import Settings
from softfuse.sensors.parameters import parameters


class LeakTest(eqx.Module):
    """Parameters of the test, see above, one value for all channels: θ0, evidence, time over which the
    pressure at rest is averaged, repeat, d, p_lost, memory, σ_θ. All fields are leaves.
    """

    tolerated_1_s: Float[Array, ""]
    sigma: Float[Array, ""]
    window_s: Float[Array, ""]
    repeat_Pa: Float[Array, ""]
    drift_Pa_s: Float[Array, ""]
    unknown_Pa: Float[Array, ""]
    memory_s: Float[Array, ""]
    prior_1_s: Float[Array, ""]


class LeakSettings(Settings):
    """When gas escapes: time constants in s of the slowest leak that matters and of the fastest to expect.

    sigma: evidence in standard deviations; window, memory in s; repeat, unknown in Pa, drift in Pa/s. 5 Pa/s
    is sealed gas that a hand warms by 0.9 K a minute. With readings of 44 Pa noise at 100 Hz, one press shows
    a leak of τ = 30 s if it holds 2.1 kPa for 3 s (s = 32 Pa), or 1 kPa for ever: drift d and leak cannot be
    told apart when d > (θ − θ0) p / sigma.
    """

    slowest: PositiveTime = 120.0
    fastest: PositiveTime = 1.0
    sigma: PositiveNumber = 5.0
    window: PositiveTime = 0.5
    repeat: PositivePressure = 20.0
    drift: Annotated[PressureRate, Ge(0)] = 5.0
    unknown: PositivePressure = 5e3
    memory: PositiveTime = 60.0

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.fastest >= self.slowest:
            raise wrong_value(f"must be below slowest = {self.slowest:g} s", key="fastest")
        return self

    def test(self) -> LeakTest:
        """The leak test."""
        return parameters(LeakTest, self, tolerated_1_s=1.0 / self.slowest, prior_1_s=1.0 / self.fastest)


class LeakState(eqx.Module):
    """Memory of the test."""

    equilibrium_Pa: Float[Array, " k"]
    """(k,) reading without gauge pressure: that of the first rest [Pa]."""
    known: Bool[Array, " k"]
    """(k,) there was a rest."""
    level_Pa: Float[Array, " k"]
    """(k,) mean of the last rest [Pa]."""
    level_variance_Pa2: Float[Array, " k"]
    """(k,) its variance [Pa^2]."""
    mean_Pa: Float[Array, " k"]
    """(k,) mean of the present rest [Pa]."""
    mean_variance_Pa2: Float[Array, " k"]
    """(k,) its variance [Pa^2]."""
    mean_frames: Int[Array, " k"]
    """(k,) readings of the present rest."""
    mean_s: Float[Array, " k"]
    """(k,) their duration [s]."""
    integral_Pas: Float[Array, " k"]
    """(k,) I since the last rest [Pa s]."""
    apart_s: Float[Array, " k"]
    """(k,) T since the last rest [s]."""
    lost_s: Float[Array, " k"]
    """(k,) part of it without a readable pressure [s]."""
    information_s2: Float[Array, " k"]
    """(k,) Σ w I²/s² [s^2]."""
    score_s: Float[Array, " k"]
    """(k,) -Σ w Δ I/s² [s]."""
    leaking: Bool[Array, " k"]
    """(k,) the decision."""


def leak_init(channels: int) -> LeakState:
    """State before the first frame: no rest was seen, nothing leaks."""
    nothing, no = jnp.zeros(channels), jnp.zeros(channels, bool)
    zeros = {each.name: nothing for each in fields(LeakState)}
    return LeakState(**zeros | {"known": no, "mean_frames": jnp.zeros(channels, int), "leaking": no})


def leak_rate(test: LeakTest, state: LeakState) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
    """Rate θ = 1/τ at which the gas escapes and its standard deviation: (k,), (k,) [1/s]."""
    information = state.information_s2 + 1.0 / test.prior_1_s**2
    return state.score_s / information, 1.0 / jnp.sqrt(information)


def _average_at_rest(
    test: LeakTest,
    state: LeakState,
    dt_s: Float[Array, ""],
    pressure_Pa: Float[Array, " k"],
    noise_Pa: Float[Array, " k"],
    observed: Bool[Array, " k"],
    at_rest: Bool[Array, ""],
) -> LeakState:
    """Mean of the present rest: equal weights up to the window, then exponential ones."""
    frames = jnp.where(at_rest, state.mean_frames, 0) + observed
    weight = jnp.maximum(1.0 / jnp.maximum(frames, 1), 1.0 - jnp.exp(-dt_s / test.window_s))
    weight = jnp.where(observed, weight, 0.0)
    variance = (1.0 - weight) ** 2 * state.mean_variance_Pa2 + weight**2 * noise_Pa**2
    return replace(
        state,
        mean_Pa=state.mean_Pa + weight * (pressure_Pa - state.mean_Pa),
        mean_variance_Pa2=variance,
        mean_frames=frames,
        mean_s=jnp.where(at_rest, state.mean_s + jnp.where(observed, dt_s, 0.0), 0.0),
    )


def leak_update(
    test: LeakTest,
    state: LeakState,
    dt_s: Float[Array, ""],
    pressure_Pa: Float[Array, " k"],
    noise_Pa: Float[Array, " k"],
    usable: Bool[Array, " k"],
    in_range: Bool[Array, " k"],
    at_rest: Bool[Array, ""],
) -> LeakState:
    """One frame.

    Args: dt_s time since the last frame [s]; pressure_Pa (k,) readings over any constant zero [Pa], finite;
    noise_Pa (k,) standard deviation of one [Pa]; usable (k,): it is a reading; in_range (k,): and the part
    can measure what is there (a gauge part below 0 still shows that a cavity at rest is below its zero, but
    not how far it was stretched); at_rest: the robot has its rest shape and its gas the temperature of the
    walls.
    """
    state = _average_at_rest(test, state, dt_s, pressure_Pa, noise_Pa, at_rest & usable, at_rest)
    settled = state.mean_s >= test.window_s
    between = state.known & ~settled
    readable = usable & in_range
    pressure = pressure_Pa - state.equilibrium_Pa
    # The mean over the window after a press belongs to its middle: to first order, half the integral over it.
    area = pressure * dt_s * jnp.where(at_rest, 0.5, 1.0)
    integral = state.integral_Pas + jnp.where(between & readable, area, 0.0)
    apart = state.apart_s + jnp.where(between, dt_s, 0.0)
    lost = state.lost_s + jnp.where(between & ~readable, dt_s, 0.0)

    ended = settled & state.known & (apart > 0.0)
    difference = state.mean_Pa - state.level_Pa
    variance = (
        state.mean_variance_Pa2
        + state.level_variance_Pa2
        + test.repeat_Pa**2
        + (test.drift_Pa_s * apart) ** 2
        + (test.tolerated_1_s * test.unknown_Pa * lost) ** 2
    )
    rate, rate_sigma = leak_rate(test, state)
    surprise = difference + rate * integral
    contrary = surprise**2 > test.sigma**2 * (variance + (rate_sigma * integral) ** 2)
    weight = jnp.where(ended, 1.0 / variance, 0.0)
    keep = jnp.where(contrary, 0.0, jnp.exp(-apart / test.memory_s))
    keep = jnp.where(ended, keep, 1.0)
    state = replace(
        state,
        information_s2=keep * state.information_s2 + weight * integral**2,
        score_s=keep * state.score_s - weight * difference * integral,
    )
    rate, rate_sigma = leak_rate(test, state)
    evidence = (rate - test.tolerated_1_s) / rate_sigma
    begins = ended & (evidence > test.sigma)
    ends = ended & (evidence < -0.5 * test.sigma)
    first = settled & ~state.known
    equilibrium = jnp.where(first, state.mean_Pa, state.equilibrium_Pa)
    # The mean before a press is as old as half its duration, or as the window with exponential weights.
    before = (state.mean_Pa - equilibrium) * jnp.minimum(0.5 * state.mean_s, test.window_s)
    return replace(
        state,
        equilibrium_Pa=equilibrium,
        known=state.known | settled,
        level_Pa=jnp.where(settled, state.mean_Pa, state.level_Pa),
        level_variance_Pa2=jnp.where(settled, state.mean_variance_Pa2, state.level_variance_Pa2),
        integral_Pas=jnp.where(settled, before, integral),
        apart_s=jnp.where(settled, 0.0, apart),
        lost_s=jnp.where(settled, 0.0, lost),
        leaking=jnp.where(state.leaking, ~ends, begins),
    )
