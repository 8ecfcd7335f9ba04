"""What `softfuse run` and `softfuse replay` are put together from."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from softfuse.cli.joined_readout import joined_columns, joined_values
from softfuse.cli.readout import AbstractReadout, Column, Value, readout_of
from softfuse.cli.recorded import sensor_columns
from softfuse.config.build_device import build_device
from softfuse.config.build_tracker import build_tracker
from softfuse.estimation.tracked import Tracked
from softfuse.estimation.tracker import Tracker
from softfuse.fusion.fusion import Fused, Fusion
from softfuse.hardware.live.follower import ChannelGroup, Fields, Follower
from softfuse.hardware.record.entries import Kind
from softfuse.mechanics.model import Model
from softfuse.mechanics.solution import State
from softfuse.robot.file import RobotSettings
from softfuse.robot.mesh import RobotMesh, build_mesh
from softfuse.robot.reduced import with_charts


@dataclass(frozen=True, eq=False)
class Estimating:
    """A device and what estimates it: everything behind the frames. `joined`: the columns of joined frames,
    none for a device whose frames are not joined, see `Fusion.joins`.
    """

    config: RobotSettings
    mesh: RobotMesh
    device: Model
    tracker: Tracker
    readout: AbstractReadout
    joined: tuple[Column, ...]
    follower: Follower

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels of a frame."""
        return tuple(sensor_columns(self.config))

    @property
    def columns(self) -> dict[str, Kind]:
        """The columns of an estimate in a session, and their kinds."""
        columns = [*self.readout.columns, *self.joined]
        return {c.name: "string" if c.digits is None else "number" for c in columns}


def estimating(config: RobotSettings, charts: Path | None = None) -> Estimating:
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
    fusion = Fusion.of(tracker) if Fusion.joins(tracker) else None
    joined = () if fusion is None else tuple(joined_columns(len(tracker.adding), "joined_"))

    def read(now: Tracked, fused: Fused | None, state: State) -> Fields:
        together = [math.nan] * len(joined) if fused is None else joined_values(fused)
        values = [*readout.read(now, state), *together]
        columns = (*readout.columns, *joined)
        return {column.name: _plain(value) for column, value in zip(columns, values, strict=True)}

    follower = Follower(tracker, groups, fusion, read)
    return Estimating(config, mesh, device, tracker, readout, joined, follower)


def _plain(value: Value | Any) -> float | str | None:
    if isinstance(value, str):
        return value or None
    return float(value)
