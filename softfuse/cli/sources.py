"""The sources that a command is given, and how their sessions begin."""

import shlex
import sys
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime

from pydantic import ValidationError

from softfuse.errors import ConfigError
from softfuse.hardware.record.entries import Kind, SessionInfo, SourceInfo
from softfuse.robot.settings import RobotSettings
from softfuse.robot.source import AnySource, SoftfuseSource


def sources_of(settings: RobotSettings, ports: Sequence[str], baud: int) -> Sequence[AnySource]:
    """Those of a robot's settings, or boards at ports; ConfigError without any."""
    if not ports and not settings.sources:
        raise ConfigError(f"{settings.path}: source: missing; write a [[source]], or give --port")
    return sources_at(ports, baud) if ports else settings.sources


def sources_at(ports: Sequence[str], baud: int) -> list[SoftfuseSource]:
    """Devices of softfuse's protocol at ports; ConfigError for a port that is none, or is given twice."""
    sources: list[SoftfuseSource] = []
    for url in ports:
        if any(source.url == url for source in sources):
            raise ConfigError(f"--port {url}: is given twice: remove one")
        try:
            sources.append(SoftfuseSource(driver="softfuse", url=url, baud=baud))
        except ValidationError as error:
            raise ConfigError(f"--port {url!r}: {error.errors()[0]['msg']}") from error
    return sources


def session_info(
    config: RobotSettings,
    sources: Sequence[AnySource],
    channels: tuple[str, ...],
    estimates: Mapping[str, Kind],
) -> SessionInfo:
    """What a session that begins now says first: its sources, and what frames and estimates are made of."""
    return SessionInfo(
        device=config.robot.name,
        command=shlex.join(["softfuse", *sys.argv[1:]]),
        started=datetime.now(UTC).isoformat(),
        channels=channels,
        estimates=estimates,
        sources=tuple(SourceInfo(source.url, source.driver) for source in sources),
        config=config.path.read_bytes(),
    )
