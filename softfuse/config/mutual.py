"""A grid of mutual capacitances, and the columns of a recording in which its cells write.

The keys are the parameters of softfuse/sensors (mutual_model, mutual_fit, touch_tracks), where they are
explained in full. Defaults are those of the sensing stage, and a test keeps them equal.
"""

from typing import Annotated, Literal, Self

from annotated_types import Ge
from pydantic import model_validator

from softfuse.config.sensors import Channels
from softfuse.io.quantity import (
    Integer,
    Number,
    PositiveInteger,
    PositiveLength,
    PositiveNumber,
    PositiveTime,
    wrong_value,
)
from softfuse.io.settings import Positions, Settings
from softfuse.sensors.touch_tracks import MOST_TRACKS


class MutualBaselineSettings(Settings):
    """How the counts without touch are followed: time constants in s, nothing near, and something near."""

    time: PositiveTime = 2.0
    creep_time: PositiveTime = 60.0


class MutualShapeSettings(Settings):
    """What a grounded finger leaves on the grid.

    contact_counts: drop of a cell's reading under it without force; electrode_width (None: the pitch), depth
    below the surface, finger_radius in m; gain: of the 16 cells in the order of the channels (None: alike);
    crosstalk: part of the signals of the other cells of its lines that a cell shows; shield_sigma: by which
    part fingers differ; model_error: relative misfit. calibration/mutual_grid.py fits them to touches.
    common_error: what all baselines may be off by alike, as a part of contact_counts.
    """

    contact_counts: PositiveNumber = 1900.0
    electrode_width: PositiveLength | None = None
    depth: PositiveLength = 1.5e-3
    finger_radius: PositiveLength = 8e-3
    gain: tuple[PositiveNumber, ...] | None = None
    crosstalk: Number = 0.0
    common_error: PositiveNumber = 0.015
    shield_sigma: PositiveNumber = 0.15
    model_error: PositiveNumber = 0.015

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.gain is not None and len(self.gain) != 16:
            raise wrong_value(f"{len(self.gain)} numbers for 16 cells", key="gain")
        return self


class MutualSplittingSettings(Settings):
    """When one more thing is seen: standard deviations, pitches, parts of the strongest and of contact.

    wander in m: how far a touch strays in a frame from where it was expected.
    """

    worth_sigma: PositiveNumber = 5.0
    apart_pitches: PositiveNumber = 0.7
    weakest: PositiveNumber = 0.45
    faintest: PositiveNumber = 0.08
    lift_sigma: PositiveNumber = 3.0
    slide_sigma: PositiveNumber = 4.0
    wander: PositiveLength = 0.6e-3


class MutualTouchSettings(Settings):
    """When something is near, touches lightly or firmly, and is gone: parts of contact, frames.

    gate in m; memory, longest_touch in s.
    """

    near_sigma: PositiveNumber = 8.0
    contact_on: PositiveNumber = 0.55
    coupling_on: PositiveNumber = 0.25
    coupling_off: PositiveNumber = 0.12
    faint: PositiveNumber = 0.03
    firm_on: PositiveNumber = 0.6
    firm_off: PositiveNumber = 0.4
    gate: PositiveLength = 12e-3
    memory: PositiveTime = 0.3
    longest_touch: PositiveTime = 120.0
    on_frames: PositiveInteger = 3
    off_frames: PositiveInteger = 3

    @model_validator(mode="after")
    def _check(self) -> Self:
        for on, off in (("coupling_on", "coupling_off"), ("firm_on", "firm_off")):
            if getattr(self, off) > getattr(self, on):
                raise wrong_value(f"must not exceed {on} = {getattr(self, on):g}", key=off)
        return self


class MutualSettings(Settings):
    """A grid of 4 × 4 mutual capacitances where rows cross columns.

    row_y, column_x: their centre lines in m; channels: one column per cell, row by row, in each row along x.
    noise in counts. A reading outside lowest_counts .. highest_counts, or the same in stuck_frames frames,
    belongs to a broken cell. touches: things followed at once, near ones too.
    """

    type: Literal["mutual-4x4"]
    row_y: Positions
    column_x: Positions
    channels: Channels
    noise_counts: PositiveNumber = 8.0
    lowest_counts: Number = 0.0
    highest_counts: Number = 65535.0
    stuck_frames: Annotated[Integer, Ge(2)] = 25
    touches: PositiveInteger = 4
    baseline: MutualBaselineSettings = MutualBaselineSettings()
    shape: MutualShapeSettings = MutualShapeSettings()
    splitting: MutualSplittingSettings = MutualSplittingSettings()
    touch: MutualTouchSettings = MutualTouchSettings()

    @model_validator(mode="after")
    def _check(self) -> Self:
        for key, lines in (("row_y", self.row_y), ("column_x", self.column_x)):
            if len(lines) != 4:
                raise wrong_value(f"there are {len(lines)} lines: a 4 × 4 grid has four", key=key)
        if len(self.channels) != 16:
            raise wrong_value(f"names {len(self.channels)} columns for 16 cells", key="channels")
        if self.lowest_counts >= self.highest_counts:
            raise wrong_value(f"must be below highest_counts = {self.highest_counts:g}", key="lowest_counts")
        if self.touches > MOST_TRACKS:
            raise wrong_value(f"at most {MOST_TRACKS} are followed", key="touches")
        return self
