"""From settings to the charts of a reduced device."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import jax.numpy as jnp

from softfuse.body.body import Body
from softfuse.config.contact import DiscSettings
from softfuse.config.device import DeviceConfig
from softfuse.config.digest import digest
from softfuse.errors import ConfigError
from softfuse.estimation.atlas import Atlas, AtlasFolder
from softfuse.estimation.device import Device
from softfuse.reduction.cells import Cells
from softfuse.reduction.chart import Chart
from softfuse.reduction.load_paths import presses
from softfuse.reduction.rest_stiffness import RestStiffness
from softfuse.reduction.snapshots import LoadsAt
from softfuse.reduction.teaching import ChartSettings, teach

_REVISION = 1
"""To be raised when other charts come of the same settings."""
_SIDE = 21
"""Contacts at so many places along each edge of a cell tell which nodes it may push."""


def build_cells(config: DeviceConfig) -> Cells:
    """The cells of the contact's workspace. Raises ConfigError when the config has no disc for a contact."""
    if not isinstance(config.contact, DiscSettings):
        raise ConfigError(
            f'{config.path}: contact: only devices that a "punch" or "uniform" disc presses can be reduced'
        )
    workspace = config.contact.workspace
    low, high = zip(workspace.x, workspace.y, strict=True)
    return Cells.over(low, high, config.reduction.cell)


def reduction_mark(config: DeviceConfig) -> str:
    """What tells two reduced devices apart: a digest of all settings that have a say."""
    parts = {"body", "cavities", "cables", "gas", "contact", "electrodes", "reduction"}
    return f"{_REVISION}-{digest(config, parts)}"


def with_charts(config: DeviceConfig, device: Device, folder: Path | None) -> Device | Atlas:
    """The charts of a folder that were made of the config's device; the device itself without a folder.

    Raises ConfigError when it has no disc for a contact, SoftfuseError when a chart is missing, damaged or
    another device's.
    """
    if folder is None:
        return device
    return Atlas(device, build_cells(config), AtlasFolder(folder, reduction_mark(config)))


@dataclass(frozen=True, eq=False)
class Teacher:
    """Makes the charts of a full device, which has that stiffness at rest."""

    config: DeviceConfig
    device: Device
    stiffness: RestStiffness
    cells: Cells

    @cached_property
    def _loads_at(self) -> LoadsAt:
        # One function for all charts: programs are compiled anew for every other one.
        return lambda body, places: replace(self.device, body=body).loads(places)

    def chart(self, number: int) -> Chart:
        """The chart of a cell; raises SolveError as `teach` does."""
        given, cell = self.config.reduction, self.cells[number]
        assert self.config.contact is not None
        assert isinstance(self.device.body, Body)
        paths = presses(
            cell, self.config.contact.max_force, side=given.side, levels=given.levels, near=given.near
        )
        return teach(
            self.device.linear,
            self.device.body,
            self.stiffness,
            self._loads_at,
            paths,
            around=[jnp.asarray(place)[None] for place in cell.grid(_SIDE)],
            settings=ChartSettings(given.displacements, given.pressures, given.sampling, given.points),
        )
