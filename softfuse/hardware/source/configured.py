"""The drivers and connections that a robot's sources stand for."""

from collections.abc import Callable, Sequence
from typing import Any

from softfuse.errors import RecordingError
from softfuse.hardware.record.entries import SourceInfo
from softfuse.hardware.source.ati_net_ft import PORT, AtiNetFt
from softfuse.hardware.source.connection import Connection
from softfuse.hardware.source.driver import AbstractDriver
from softfuse.hardware.source.port import AbstractPort, open_serial, open_udp
from softfuse.hardware.source.serial_force_torque import BotaSerial, RobotousRft
from softfuse.hardware.source.softfuse_frames import SoftfuseFrames
from softfuse.hardware.source.text_lines import PRESETS, TextFormat, TextLines
from softfuse.hardware.stream import Chunk, HostClock, Notice
from softfuse.hardware.wire.description import check_name
from softfuse.robot.source import (
    AnySource,
    AtiNetFtSource,
    BotaSource,
    LinesSource,
    RobotousRftSource,
    SoftfuseSource,
)


def driver_of(source: AnySource) -> AbstractDriver:
    """A new driver with a source's settings; WireError for names of channels that cannot be."""
    for name in source.known_channels:
        check_name(name, "channel")
    return _DRIVERS[type(source)](source)


def _text_lines(source: LinesSource) -> TextLines:
    form = TextFormat(source.columns, source.time, source.separator, source.prefix)
    return TextLines(form if source.preset is None else PRESETS[source.preset], source.channels)


_DRIVERS: dict[type, Callable[[Any], AbstractDriver]] = {
    SoftfuseSource: lambda source: SoftfuseFrames(),
    LinesSource: _text_lines,
    AtiNetFtSource: AtiNetFt,
    RobotousRftSource: RobotousRft,
    BotaSource: BotaSerial,
}


def open_port_of(source: AnySource) -> AbstractPort:
    """A source's port, open; OSError where there is none now, HardwareError where it can never be."""
    if source.baud is None:
        return open_udp(source.url, PORT)
    return open_serial(source.url, source.baud)


def connection_of(
    number: int,
    source: AnySource,
    driver: AbstractDriver,
    on_chunk: Callable[[Chunk], None],
    on_notice: Callable[[Notice], None],
    clock: HostClock,
) -> Connection:
    """The connection, not open yet, of the source of this number, which greets as its driver wants."""
    return Connection(
        number,
        source.url,
        lambda: open_port_of(source),
        on_chunk,
        on_notice,
        clock,
        greeting=driver.greeting(),
        farewell=driver.farewell(),
    )


def drivers_again(recorded: Sequence[SourceInfo], configured: Sequence[AnySource]) -> list[AbstractDriver]:
    """A driver for each recorded source; RecordingError where its settings are not known."""
    drivers: list[AbstractDriver] = []
    for k, source in enumerate(recorded):
        if source.driver == "softfuse":
            drivers.append(SoftfuseFrames())
        elif k < len(configured) and configured[k].driver == source.driver:
            drivers.append(driver_of(configured[k]))
        else:
            raise RecordingError(
                f"source {k} of the session has the driver {source.driver!r}, which [[source]] number {k} of "
                "the configuration does not have: give the configuration that it was recorded with"
            )
    return drivers
