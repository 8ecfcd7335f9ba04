"""What `softfuse run` and `softfuse replay` are put together from."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from softfuse.cli.readout import AbstractReadout, Value, readout_of
from softfuse.cli.recorded import sensor_columns
from softfuse.config import DeviceConfig
from softfuse.config.build_device import build_device
from softfuse.config.build_mesh import DeviceMesh, build_mesh
from softfuse.config.build_reduction import with_charts
from softfuse.config.build_tracker import build_tracker
from softfuse.equilibrium.solution import State
from softfuse.estimation.device import Device
from softfuse.estimation.tracked import Tracked
from softfuse.estimation.tracker import Tracker
from softfuse.hardware.live.follower import ChannelGroup, Fields, Follower
from softfuse.hardware.record.entries import Kind


@dataclass(frozen=True, eq=False)
class Estimating:
    """A device and what estimates it: everything behind the frames."""

    config: DeviceConfig
    mesh: DeviceMesh
    device: Device
    tracker: Tracker
    readout: AbstractReadout
    follower: Follower

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels of a frame."""
        return tuple(sensor_columns(self.config))

    @property
    def columns(self) -> dict[str, Kind]:
        """The columns of an estimate in a session, and their kinds."""
        return {c.name: "string" if c.digits is None else "number" for c in self.readout.columns}


def estimating(config: DeviceConfig, charts: Path | None = None) -> Estimating:
    """Mesh, build and compile, with the charts of a folder if there is one.

    Raises ConfigError when the config has no sensors or no contact, SoftfuseError as
    `with_charts`.
    """
    sensor_columns(config)
    mesh = build_mesh(config)
    device = build_device(config, mesh)
    readout = readout_of(config, device, mesh)
    tracker = build_tracker(config, with_charts(config, device, charts))
    assert config.sensors is not None  # sensor_columns has told
    groups = [ChannelGroup(names, unit) for names, unit in config.sensors.groups]

    def read(now: Tracked, state: State) -> Fields:
        values = zip(readout.columns, readout.read(now, state), strict=True)
        return {column.name: _plain(value) for column, value in values}

    return Estimating(config, mesh, device, tracker, readout, Follower(tracker, groups, read))


def _plain(value: Value | Any) -> float | str | None:
    if isinstance(value, str):
        return value or None
    return float(value)
