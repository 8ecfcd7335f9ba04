"""Pressure sensors, electrodes and cables' lengths, and the columns of a recording in which they write.

The keys are the parameters of softfuse/sensors, where they are explained in full. Defaults are those of the
sensing stage, and a test keeps them equal.
"""

from typing import Annotated, Literal, Self

from annotated_types import Ge, Le, Lt
from pydantic import BeforeValidator, model_validator

from softfuse.config.sensors import BaselineSettings, Channels
from softfuse.io.quantity import (
    Duration,
    Integer,
    Length,
    Number,
    PositiveInteger,
    PositiveLength,
    PositiveNumber,
    PositivePressure,
    PositiveTime,
    PositiveVoltage,
    PressureRate,
    Voltage,
    wrong_value,
)
from softfuse.io.settings import NotEmpty, Settings, listed


class TareSettings(Settings):
    """How zeros are taken: standard deviations in Pa and Pa/s, times in s, a limit in standard deviations."""

    offset_sigma: PositivePressure = 2.5e3
    drift: Annotated[PressureRate, Ge(0)] = 2.0
    settle: PositiveTime = 1.0
    follow: PositiveTime = 5.0
    gate_sigma: PositiveNumber = 5.0
    relearn: PositiveTime = 5.0


class LeakSettings(Settings):
    """When gas escapes: time constants in s of the slowest leak that matters and of the fastest to expect.

    sigma: evidence in standard deviations; window, memory in s; repeat, unknown in Pa, drift in Pa/s.
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


class PressureSettings(Settings):
    """Pressure sensors, one on each sealed cavity; the part is ratiometric to its supply.

    channels: one column per cavity, in the order of [[cavity]]; supply_channel: the column of the measured
    supply, None for a steady one. supply, noise, low, high in V: readings at or beyond low and high are
    clipped. gain [-]: what is measured over what the model says, one value or one for each cavity;
    gain_sigma: relative error of each sensor; model_error: part of the largest change of a pressure by which
    every modelled one may be wrong. average: time constant in s over which pressures and cable lengths are
    averaged; hold_off in s.
    """

    type: Literal["MPX5100A", "MPX5100D", "MPX5100G"]
    channels: Channels
    supply: Annotated[Voltage, Ge(4.75), Le(5.25)] = 5.0
    supply_channel: str | None = None
    noise: PositiveVoltage = 2e-3
    low: Voltage = 2e-3
    high: Voltage = 4.998
    gain: Annotated[tuple[PositiveNumber, ...], NotEmpty, BeforeValidator(listed)] = (1.0,)
    gain_sigma: Annotated[Number, Ge(0)] = 0.01
    model_error: Annotated[Number, Ge(0)] = 0.05
    average: PositiveTime = 0.2
    hold_off: Duration = 1.0
    lag_frames: PositiveInteger = 10
    tare: TareSettings = TareSettings()
    leak: LeakSettings = LeakSettings()

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.low >= self.high:
            raise wrong_value(f"must be below high = {self.high:g} V", key="low")
        if len(self.gain) not in (1, len(self.channels)):
            raise wrong_value(
                f"{len(self.gain)} values for {len(self.channels)} channels: give one, or one for each",
                key="gain",
            )
        return self


class ElectrodeSettings(Settings):
    """Single-ended electrodes, each with a patch of skin of its own.

    channels: one column per electrode, in the order of [[electrode]]. Noise, limits, on and off in counts,
    near_sigma in standard deviations; longest_touch, lost, quiet in s. A reading outside lowest_counts ..
    highest_counts, or the same in stuck_frames frames, belongs to a broken electrode.
    """

    channels: Channels
    noise_counts: PositiveNumber = 8.0
    lowest_counts: Number = 0.0
    highest_counts: Number = 65535.0
    stuck_frames: Annotated[Integer, Ge(2)] = 25
    on_counts: PositiveNumber = 600.0
    off_counts: PositiveNumber = 400.0
    near_sigma: PositiveNumber = 8.0
    on_frames: PositiveInteger = 3
    off_frames: PositiveInteger = 3
    longest_touch: PositiveTime = 120.0
    lost: PositiveTime = 0.1
    quiet_fraction: Annotated[Number, Ge(0), Lt(1)] = 0.1
    quiet: PositiveTime = 1.0
    baseline: BaselineSettings = BaselineSettings()

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.off_counts > self.on_counts:
            raise wrong_value(f"must not exceed on_counts = {self.on_counts:g}", key="off_counts")
        if self.lowest_counts >= self.highest_counts:
            raise wrong_value(f"must be below highest_counts = {self.highest_counts:g}", key="lowest_counts")
        return self


class CableLengthSettings(Settings):
    """By how much each cable has been shortened, read in mm; a frame without a reading has an empty field.

    channels: one column per cable, in the order of [[cable]]; zero in m: what is read where the cable gets
    taut, one value or one for each cable; noise: standard deviation in m; slack in m: a cable that is shorter
    by less leaves the body at rest.
    """

    channels: Channels
    zero: Annotated[tuple[Length, ...], NotEmpty, BeforeValidator(listed)] = (0.0,)
    noise: PositiveLength = 0.05e-3
    slack: PositiveLength = 0.5e-3

    @model_validator(mode="after")
    def _check(self) -> Self:
        if len(self.zero) not in (1, len(self.channels)):
            raise wrong_value(
                f"{len(self.zero)} values for {len(self.channels)} channels: give one, or one for each",
                key="zero",
            )
        return self
