"""From settings to a virtual pad that is touched at four places of its workspace."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from softfuse.config.contact import DiscSettings
from softfuse.config.mutual import MutualSettings
from softfuse.config.sensor_set import SensorSettings
from softfuse.config.sensors import CapacitiveSettings
from softfuse.errors import ConfigError
from softfuse.experiment.electrode_electronics import (
    AbstractElectrodeElectronics,
    CellElectronics,
    LineElectronics,
)
from softfuse.experiment.flow_electronics import FlowElectronics
from softfuse.experiment.kept_poses import kept_pad_touches
from softfuse.experiment.pad_electrodes import AbstractPadElectrodes, GridElectrodes, LineElectrodes
from softfuse.experiment.pad_electronics import PadElectronics
from softfuse.experiment.pad_programme import PadTiming, pad_programme
from softfuse.experiment.pad_touches import PadTouches, one_after_the_other
from softfuse.experiment.programme import Programme
from softfuse.experiment.virtual_pad import PadSettings, Touch
from softfuse.robot.body import BlockSource
from softfuse.robot.settings import RobotSettings
from softfuse.sensors.crossed.field import CrossedLines, FieldSettings
from softfuse.sensors.electronics import ChannelElectronics
from softfuse.sensors.mutual.field import MutualField
from softfuse.sensors.mutual.model import mean_pitch

_PLACES = ((0.6, 0.5), (-0.5, 0.1), (0.1, -0.7), (-0.8, -0.8))
"""From the middle of the workspace to its ends (±1)."""

_LEVELS = (0.2, 0.4, 0.6)
"""Forces, as parts of the largest that the contact is made for."""

_LINE_GAPS_M = (0.0, 0.25e-3, 0.5e-3, 1e-3, 2e-3, 4e-3, 8e-3, 14e-3, 25e-3)
_GRID_GAPS_M = (*_LINE_GAPS_M, 40e-3, 60e-3)
"""Heights of the punch at which the electrodes are computed; it waits at the last, where a grid's wide lines,
that see further, lose no more than noise.
"""

_SURFACE, _BASE = 0.175, 0.2
"""Longest edge of the mesh at the top, and of the grid under it, as parts of the pad's length."""


@dataclass(frozen=True, eq=False)
class PadPlan:
    """What is to be computed, and how it is read."""

    settings: PadSettings
    array: AbstractPadElectrodes
    gaps: tuple[float, ...]
    touches: tuple[Touch, ...]
    parts: PadElectronics
    flows: tuple[str, ...]
    electrodes: tuple[str, ...]

    def programme(self, folder: Path | None) -> Programme:
        """The programme of all touches; see `build_virtual`."""
        found = kept_pad_touches(folder, self.settings, self.array, self.touches, self.gaps)
        return self._of(one_after_the_other(found))

    def programmes(self, folder: Path | None, *, solved: Callable[[], None] | None = None) -> list[Programme]:
        """A programme of each touch; see `kept_pad_touches`."""
        found = kept_pad_touches(folder, self.settings, self.array, self.touches, self.gaps, solved=solved)
        return [self._of(each) for each in found]

    def _of(self, touches: PadTouches) -> Programme:
        return pad_programme(touches, PadTiming(), self.parts, self.flows, self.electrodes)

    def electronics(self, seed: int) -> ChannelElectronics:
        """The programme's channels."""
        return self.parts.channels(len(self.flows), len(self.electrodes), seed)


def pad_plan(config: RobotSettings, source: BlockSource, shear_modulus: float, poisson: float) -> PadPlan:
    """The plan for a pad of a shear modulus [Pa] and Poisson's ratio [-]; raises ConfigError for another
    contact than a disc from above, or other sensors.
    """
    contact, sensors = config.contact, config.sensors
    assert sensors is not None
    if not isinstance(contact, DiscSettings) or not np.allclose(contact.direction, (0.0, 0.0, -1.0)):
        raise ConfigError(f"{config.path}: contact: a virtual pad is pressed by a disc along [0, 0, -1]")
    flow = sensors.flow
    electrodes = _electrodes(sensors, contact.radius)
    forces = tuple(share * contact.max_force for share in _LEVELS)
    places = within(contact, _PLACES)
    length = max(source.size[:2])
    return PadPlan(
        PadSettings(
            source.drawing([cavity.centre for cavity in config.cavities]),
            shear_modulus,
            poisson,
            surface_size=_SURFACE * length,
            base_size=_BASE * length,
            radius=contact.radius,
        ),
        electrodes.array,
        electrodes.gaps,
        tuple(Touch((float(x), float(y)), forces) for x, y in places),
        PadElectronics(
            FlowElectronics(zero_V=flow.zero, sensitivity_Vs_m3=flow.sensitivity, noise_V=flow.noise),
            electrodes.converters,
        ),
        flow.channels,
        electrodes.channels,
    )


def within(contact: DiscSettings, shares: Sequence[tuple[float, float]]) -> Float[np.ndarray, "n 2"]:
    """Places (n, 2) m so far from the middle of the workspace to its ends (±1)."""
    low, high = (np.array(ends) for ends in zip(contact.workspace.x, contact.workspace.y, strict=True))
    return 0.5 * (low + high) + 0.5 * (high - low) * np.array(shares)


@dataclass(frozen=True, eq=False)
class _Electrodes:
    """Electrodes, the gaps [m] at which they are computed, what reads them, and their channels."""

    array: AbstractPadElectrodes
    gaps: tuple[float, ...]
    converters: AbstractElectrodeElectronics
    channels: tuple[str, ...]


def _electrodes(sensors: SensorSettings, radius: float) -> _Electrodes:
    """Those of the config, under a punch of a radius [m]."""
    match sensors.crossed or sensors.mutual:
        case CapacitiveSettings() as crossed:
            lines = CrossedLines(crossed.row_y, crossed.column_x, crossed.row_depth, crossed.column_depth)
            return _Electrodes(
                LineElectrodes(lines, FieldSettings(radius=radius)),
                _LINE_GAPS_M,
                LineElectronics(noise_counts=crossed.noise_counts),
                (*crossed.row_channels, *crossed.column_channels),
            )
        case MutualSettings() as grid:
            width = grid.shape.electrode_width or mean_pitch(grid.column_x, grid.row_y)
            field = MutualField(grid.column_x, grid.row_y, half_width=0.5 * width, depth=grid.shape.depth)
            return _Electrodes(
                GridElectrodes(field, radius),
                _GRID_GAPS_M,
                CellElectronics(noise_counts=grid.noise_counts),
                grid.channels,
            )
