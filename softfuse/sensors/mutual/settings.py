"""A grid of 4 × 4 mutual capacitances: what its keys mean, and what its cells say in simulation."""

from collections.abc import Sequence
from typing import Literal, Self

import equinox as eqx
import numpy as np
from jaxtyping import Float
from pydantic import model_validator

from softfuse.io.quantity import (
    Number,
    PositiveInteger,
    PositiveLength,
    PositiveNumber,
    PositiveTime,
    wrong_value,
)
from softfuse.io.settings import Settings
from softfuse.sensors.capacitive import BaselineTimes, ElectrodeLinesSettings
from softfuse.sensors.mutual.field import MutualField, Thing
from softfuse.sensors.mutual.fit import Splitting
from softfuse.sensors.mutual.model import MutualModel, mean_pitch
from softfuse.sensors.mutual.sensor import MutualElectrodes
from softfuse.sensors.mutual.touch_tracks import MOST_TRACKS, TouchFollower
from softfuse.sensors.parameters import parameters
from softfuse.sensors.parts import TrueContact
from softfuse.sensors.place_information import place_told_by_grid

# Of virtual cells: counts at rest and by how much they differ, spread of gains, drift of all and of each
# after one second, and over which time no further.
_REST, _REST_BOUND, _GAIN_SIGMA = 16000.0, 1500.0, 0.03
_DRIFT, _OWN_DRIFT, _DRIFT_TIME_S = 5.0, 2.0, 300.0


class MutualShapeSettings(Settings):
    """What a grounded finger leaves on the grid, see `mutual.model`.

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

    wander in m: how far a touch strays in a frame from where it was expected; iterations: of a fit.
    """

    worth_sigma: PositiveNumber = 5.0
    apart_pitches: PositiveNumber = 0.7
    weakest: PositiveNumber = 0.45
    faintest: PositiveNumber = 0.08
    lift_sigma: PositiveNumber = 3.0
    slide_sigma: PositiveNumber = 4.0
    wander: PositiveLength = 0.6e-3
    iterations: PositiveInteger = 12


class MutualTouchSettings(Settings):
    """When something is near, touches lightly or firmly, and is gone: parts of contact, frames.

    gate in m; memory, speed_time, longest_touch in s.
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
    speed_time: PositiveTime = 0.05
    longest_touch: PositiveTime = 120.0
    on_frames: PositiveInteger = 3
    off_frames: PositiveInteger = 3

    @model_validator(mode="after")
    def _check(self) -> Self:
        for on, off in (("coupling_on", "coupling_off"), ("firm_on", "firm_off")):
            if getattr(self, off) > getattr(self, on):
                raise wrong_value(f"must not exceed {on} = {getattr(self, on):g}", key=off)
        return self


class MutualSettings(ElectrodeLinesSettings):
    """A grid of 4 × 4 mutual capacitances where rows cross columns.

    channels: one column per cell, row by row, in each row along x. touches: things followed at once, near
    ones too.
    """

    type: Literal["mutual-4x4"] = "mutual-4x4"
    touches: PositiveInteger = 4
    baseline: BaselineTimes = BaselineTimes()
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
        if self.touches > MOST_TRACKS:
            raise wrong_value(f"at most {MOST_TRACKS} are followed", key="touches")
        return self

    @property
    def electrode_width_m(self) -> float:
        """Width of a line [m]."""
        return self.shape.electrode_width or mean_pitch(self.column_x, self.row_y)

    def model(self) -> MutualModel:
        """The grid and what touches it."""
        shape = self.shape
        gain = np.ones((4, 4)) if shape.gain is None else np.reshape(shape.gain, (4, 4)).T
        return parameters(MutualModel, self, shape, half_width_m=0.5 * self.electrode_width_m, gain=gain)

    def place_information(self, radius_m):
        """Of firm contacts (firm_on), whatever their radius."""
        del radius_m
        grid = self.model()

        def told(columns, rows, places):
            moved = eqx.tree_at(lambda m: (m.column_x_m, m.row_y_m), grid, (columns, rows))
            # Lines as wide as their pitch stay so.
            width = moved.half_width_m if self.shape.electrode_width else 0.5 * moved.pitch_m
            moved = eqx.tree_at(lambda m: m.half_width_m, moved, width)
            return place_told_by_grid(moved, self.touch.firm_on, places)

        return told

    def sensor(self, parts):
        """Raises ConfigError for a contact that there is not, that presses on no flat face, or in too many
        slots.
        """
        part, chart = parts.contact_of(self.name, self.contact), self._chart(parts)
        if part.slots > self.touches:
            raise self._wrong(f"{part.slots} contacts at once, but only {self.touches} touches are followed")
        return parameters(
            MutualElectrodes,
            self,
            self.touch,
            slots=part.slots,
            # Signals of both signs are physical here.
            array=self._array(self.baseline, recovery_time_s=np.inf, negative_sigma=np.inf),
            model=self.model(),
            splitting=parameters(Splitting, self.splitting),
            follower=parameters(TouchFollower, self.touch, speed_s=self.touch.speed_time),
            chart=chart,
            low_m=part.low,
            high_m=part.high,
        )

    @property
    def _field(self) -> MutualField:
        shape = self.shape
        return MutualField(
            self.column_x, self.row_y, half_width=0.5 * self.electrode_width_m, depth=shape.depth
        )

    def signal(self, parts, contacts: Sequence[TrueContact], moved: Float[np.ndarray, "m 3"]):
        """Changes (e,) of the cells relative to those at rest.

        They take from a press its force alone, which squeezes their layers. Not modelled: that a punch
        presses hardest at its rim, its wall, and electrodes that are bent with the surface.
        """
        del moved
        chart = self._chart(parts)
        things = []
        for contact in contacts:
            x, y = chart.coordinates(contact.place)
            distance = max(contact.gap, 0.0)
            things.append(Thing((float(x), float(y)), distance, contact.force, contact.radius))
        return self._field.with_crosstalk(self._field.change(things)).T.ravel()

    def ideal(self, parts, time_s, values):
        """Counts of relative changes (m, e)."""
        del parts, time_s
        return _REST * (1.0 + np.asarray(values))

    def electronics(self, parts, rng):
        """Cells that differ in reading at rest and gain, and drift, by what all and each do."""
        del parts
        count = len(self.channels)
        rest = _REST + rng.uniform(-_REST_BOUND, _REST_BOUND, count)
        gain = 1.0 + rng.normal(0.0, _GAIN_SIGMA, count)
        # A stationary wander gains σ √(2 t/τ) in a time t that is short against its τ.
        return self._electronics(
            _REST,
            gain=gain * rest / _REST,
            zero=rest - _REST,
            slow_sigma=float(np.hypot(_DRIFT, _OWN_DRIFT)) * np.sqrt(0.5 * _DRIFT_TIME_S),
            slow_time=_DRIFT_TIME_S,
        )
