"""Flow sensors and crossed lines of electrodes, and the columns of a recording in which they write.

The keys are the parameters of softfuse/sensors, where they are explained in full. Defaults are those of the
sensing stage, and a test keeps them equal.
"""

from typing import Annotated, Literal, Self

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BeforeValidator, model_validator

from softfuse.io.quantity import (
    Angle,
    Duration,
    FlowSensitivity,
    Integer,
    Length,
    Number,
    PositiveInteger,
    PositiveLength,
    PositiveNumber,
    PositiveTime,
    PositiveVoltage,
    Spread,
    Voltage,
    VoltageWalk,
    wrong_value,
)
from softfuse.io.settings import NotEmpty, Positions, Settings, listed

Channels = Annotated[tuple[str, ...], NotEmpty]
"""Names of columns of a recording."""

Fraction = Annotated[Number, Gt(0), Lt(1)]

Gains = Annotated[tuple[PositiveNumber, ...], NotEmpty, BeforeValidator(listed)]
"""What is measured over what there is [-]: one value for all, or one for each."""


class FlowSettings(Settings):
    """Flow sensors, one on each cavity: their volts at zero flow and per flow, noise and limits.

    channels: one column per cavity, in the order of [[cavity]]. zero, low, high, noise, bias_sigma,
    wander_sigma, lost_sigma in V, sensitivity in V s/m³, bias_walk in V/√s, times in s. gain [-]: what is
    measured over what flows, one value or one for each cavity.
    """

    type: Literal["D6F-P0001A1"]
    channels: Channels
    zero: Voltage = 0.5
    sensitivity: Annotated[FlowSensitivity, Gt(0)] = 20.0 / (1e-3 / 60.0)
    gain: Gains = (1.0,)
    low: Voltage = 2e-3
    high: Voltage = 2.5
    noise: PositiveVoltage = 2e-3
    bias_sigma: PositiveVoltage = 10e-3
    bias_walk: Annotated[VoltageWalk, Ge(0)] = 0.02e-3
    wander_sigma: Spread = 0.4e-3
    wander_time: PositiveTime = 3.0
    hold_off: Duration = 0.5
    gate_sigma: PositiveNumber = 4.0
    relearn: PositiveTime = 5.0
    longest_gap: PositiveTime = 0.1
    lost_sigma: PositiveVoltage = 0.5
    lost_tolerance: Duration = 0.0
    lag_frames: PositiveInteger = 20

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.low < self.zero < self.high:
            raise wrong_value(
                f"zero = {self.zero:g} V must lie between low = {self.low:g} V and high = {self.high:g} V"
            )
        if len(self.gain) not in (1, len(self.channels)):
            raise wrong_value(
                f"{len(self.gain)} values for {len(self.channels)} channels: give one, or one for each",
                key="gain",
            )
        return self


class BaselineSettings(Settings):
    """How the counts without touch are followed: time constants in s, a limit in standard deviations."""

    time: PositiveTime = 2.0
    creep_time: PositiveTime = 60.0
    recovery_time: PositiveTime = 0.2
    negative_sigma: PositiveNumber = 10.0


class TouchSettings(Settings):
    """When something is near, touches, and is gone: standard deviations, counts, fractions, frames."""

    near_on_sigma: PositiveNumber = 8.0
    near_off_sigma: PositiveNumber = 6.0
    contact_on_counts: PositiveNumber = 3000.0
    flow_sigma: PositiveNumber = 8.0
    release_fraction: Fraction = 0.6
    return_fraction: Annotated[Number, Gt(0), Le(1)] = 0.7
    on_frames: PositiveInteger = 3
    off_frames: PositiveInteger = 3

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.near_off_sigma > self.near_on_sigma:
            raise wrong_value(f"must not exceed near_on_sigma = {self.near_on_sigma:g}", key="near_off_sigma")
        if self.return_fraction < self.release_fraction:
            raise wrong_value(
                f"must not be below release_fraction = {self.release_fraction:g}", key="return_fraction"
            )
        return self


class PeakSettings(Settings):
    """How sure the peak fit is beforehand, as standard deviations.

    Radius of the contact and gap to it in m, common offset of the lines in counts, misfit of the model
    relative to the largest signal.
    """

    radius_sigma: PositiveLength = 0.5e-3
    gap_sigma: PositiveLength = 0.5e-3
    offset_sigma_counts: PositiveNumber = 100.0
    model_error: PositiveNumber = 0.005


class PoseSettings(Settings):
    """Where the array lies on the body, see `sensors.array_pose`.

    shift in m along x and y, turn in rad, stretch along x and y; sigma_factor: by how much locations spread
    wider than the fit of a peak promises; dent_part: by which part of a dent's depth they do besides.
    """

    shift: tuple[Length, Length] = (0.0, 0.0)
    turn: Angle = 0.0
    stretch: tuple[PositiveNumber, PositiveNumber] = (1.0, 1.0)
    sigma_factor: PositiveNumber = 1.0
    dent_part: Annotated[Number, Ge(0)] = 0.0


class CapacitiveSettings(Settings):
    """A single-ended array of crossed lines of diamonds.

    row_y, column_x: their centre lines, and depths below the surface, in m; noise in counts. row_channels,
    column_channels: their columns in a recording, in the order of row_y and column_x. A reading outside
    lowest_counts .. highest_counts, or the same in stuck_frames frames, belongs to a broken channel.
    row_gain, column_gain [-]: counts of a line for what a nominal one says with one, one value or one for
    each. row_baseline, column_baseline: counts of each line untouched, for a start while something touches.
    """

    type: Literal["crossed-diamonds"]
    row_y: Positions
    column_x: Positions
    row_depth: PositiveLength
    column_depth: PositiveLength
    row_channels: Channels
    column_channels: Channels
    noise_counts: PositiveNumber = 8.0
    lowest_counts: Number = 0.0
    highest_counts: Number = 65535.0
    stuck_frames: Annotated[Integer, Ge(2)] = 25
    row_gain: Gains = (1.0,)
    column_gain: Gains = (1.0,)
    row_baseline: tuple[Number, ...] | None = None
    column_baseline: tuple[Number, ...] | None = None
    location: Literal["peak-fit", "weighted-mean"] = "peak-fit"
    baseline: BaselineSettings = BaselineSettings()
    touch: TouchSettings = TouchSettings()
    peak: PeakSettings = PeakSettings()
    pose: PoseSettings = PoseSettings()

    @property
    def lines(self) -> tuple[str, ...]:
        """Channels of all lines, rows first."""
        return (*self.row_channels, *self.column_channels)

    @model_validator(mode="after")
    def _check(self) -> Self:
        for key, lines, channels in (
            ("row_y", self.row_y, self.row_channels),
            ("column_x", self.column_x, self.column_channels),
        ):
            if len(lines) < 2:
                raise wrong_value("an array has at least two lines in each direction", key=key)
            if len(lines) != len(channels):
                name = f"{key.split('_')[0]}_channels"
                raise wrong_value(
                    f"names {len(channels)} columns for the {len(lines)} positions of {key}", key=name
                )
        if self.lowest_counts >= self.highest_counts:
            raise wrong_value(f"must be below highest_counts = {self.highest_counts:g}", key="lowest_counts")
        self._check_lines()
        return self

    def _check_lines(self) -> None:
        """Raise the error of a validator unless there are as many gains and baselines as lines."""
        baselines = {"row": self.row_baseline, "column": self.column_baseline}
        for name, lines, gain in (
            ("row", self.row_y, self.row_gain),
            ("column", self.column_x, self.column_gain),
        ):
            if len(gain) not in (1, len(lines)):
                raise wrong_value(
                    f"{len(gain)} values for {len(lines)} lines: give one, or one for each",
                    key=f"{name}_gain",
                )
            baseline = baselines[name]
            if baseline is not None and len(baseline) != len(lines):
                raise wrong_value(
                    f"{len(baseline)} values for {len(lines)} lines: give one for each",
                    key=f"{name}_baseline",
                )
        for name, other in (("row", "column"), ("column", "row")):
            if baselines[name] is None and baselines[other] is not None:
                raise wrong_value(
                    f"missing, while {other}_baseline is given: give both or none", key=f"{name}_baseline"
                )
