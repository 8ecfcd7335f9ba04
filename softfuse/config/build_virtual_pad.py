"""From settings to a virtual pad that is touched at four places of its workspace."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from softfuse.config.body import PadSource
from softfuse.config.contact import DiscSettings
from softfuse.config.device import DeviceConfig
from softfuse.errors import ConfigError
from softfuse.experiment.channel_electronics import ChannelElectronics
from softfuse.experiment.kept_poses import kept_pad_touches
from softfuse.experiment.pad_electronics import PadElectronics
from softfuse.experiment.pad_field import CrossedLines, FieldSettings
from softfuse.experiment.pad_programme import PadTiming, pad_programme
from softfuse.experiment.programme import Programme
from softfuse.experiment.virtual_pad import PadSettings, Touch
from softfuse.mesh.pad import PadGeometry

_PLACES = ((0.6, 0.5), (-0.5, 0.1), (0.1, -0.7), (-0.8, -0.8))
"""From the middle of the workspace to its ends (±1)."""

_LEVELS = (0.2, 0.4, 0.6)
"""Forces, as parts of the largest that the contact is made for."""

_GAPS_M = (0.0, 0.25e-3, 0.5e-3, 1e-3, 2e-3, 4e-3, 8e-3, 14e-3, 25e-3)
"""Heights of the punch at which the electrodes are computed; it waits at the last."""

_SURFACE, _BASE = 0.175, 0.2
"""Longest edge of the mesh at the top, and of the grid under it, as parts of the pad's length."""


@dataclass(frozen=True, eq=False)
class PadPlan:
    """What is to be computed, and how it is read."""

    settings: PadSettings
    lines: CrossedLines
    touches: tuple[Touch, ...]
    parts: PadElectronics
    flows: tuple[str, ...]
    electrodes: tuple[str, ...]

    def programme(self, folder: Path | None) -> Programme:
        """The programme of all touches; see `build_virtual`."""
        field = FieldSettings(radius=self.settings.radius)
        found = kept_pad_touches(folder, self.settings, self.lines, field, self.touches, _GAPS_M)
        return pad_programme(found, PadTiming(), self.parts, self.flows, self.electrodes)

    def electronics(self, seed: int) -> ChannelElectronics:
        """The programme's channels."""
        return self.parts.channels(len(self.flows), len(self.electrodes), seed)


def pad_plan(config: DeviceConfig, source: PadSource, shear_modulus: float, poisson: float) -> PadPlan:
    """The plan for a pad of a shear modulus [Pa] and Poisson's ratio [-]; raises ConfigError for another
    contact than a disc from above, or other sensors.
    """
    contact, sensors = config.contact, config.sensors
    assert sensors is not None
    if not isinstance(contact, DiscSettings) or not np.allclose(contact.direction, (0.0, 0.0, -1.0)):
        raise ConfigError(f"{config.path}: contact: a virtual pad is pressed by a disc along [0, 0, -1]")
    flow, array = sensors.flow, sensors.capacitive
    centres = [cavity.centre for cavity in config.cavities]
    drawing = PadGeometry(
        size=source.size,
        cavity_size=source.cavity_size,
        cavity_centres=tuple((x, y) for x, y, _ in centres),
        cavity_z_bottom=centres[0][2] - 0.5 * source.cavity_size[2],
    )
    low, high = (np.array(ends) for ends in zip(contact.workspace.x, contact.workspace.y, strict=True))
    forces = tuple(share * contact.max_force for share in _LEVELS)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    places = (middle + half * np.array(place) for place in _PLACES)
    length = max(source.size[:2])
    return PadPlan(
        PadSettings(
            drawing,
            shear_modulus,
            poisson,
            surface_size=_SURFACE * length,
            base_size=_BASE * length,
            radius=contact.radius,
        ),
        CrossedLines(array.row_y, array.column_x, array.row_depth, array.column_depth),
        tuple(Touch((float(x), float(y)), forces) for x, y in places),
        PadElectronics(
            zero_V=flow.zero,
            sensitivity_Vs_m3=flow.sensitivity,
            flow_noise_V=flow.noise,
            line_noise_counts=array.noise_counts,
        ),
        flow.channels,
        (*array.row_channels, *array.column_channels),
    )
