"""The sources of a test bed, open and gathered."""

from collections.abc import Callable

from softfuse.cli.testbed_files import Outputs
from softfuse.errors import ConfigError, HardwareError
from softfuse.hardware.live.pipeline import Pipeline
from softfuse.hardware.record.entries import FrameEntry
from softfuse.hardware.source.configured import connection_of, driver_of
from softfuse.hardware.source.connection import Connection
from softfuse.hardware.stream import Chunk, HostClock, Notice
from softfuse.hardware.testbed.gathering import ForceAxis, Gathering
from softfuse.robot.robot import require_sensors
from softfuse.robot.settings import RobotSettings

_COMING_S = 5.0
"""How long the channels have to come before anything moves [s]: opening its port resets many a board, which
needs two seconds to start, and the channels are known by a description that comes from time to time only."""
_FIRST_S = 0.5
"""For how long the force has to come after that [s]."""


class Sensors:
    """Opens the configuration's sources and gathers what they say."""

    def __init__(
        self, config: RobotSettings, axis: ForceAxis, clock: HostClock, *, tell: Callable[[Notice], None]
    ) -> None:
        """ConfigError where the configuration has no sensors or no sources."""
        if not config.sources:
            raise ConfigError(
                f"{config.path}: source: missing; write a [[source]] for the device and the force sensor"
            )
        require_sensors(config)
        wanted = list(config.channels)
        for name in (*(name for source in config.sources for name in source.known_channels), axis.channel):
            if name not in wanted:
                wanted.append(name)
        drivers = [driver_of(source) for source in config.sources]
        self._clock = clock
        self._outputs: Outputs | None = None
        self.gathering = Gathering(
            Pipeline(wanted, drivers), axis, clock, send=self._send, write=self._write, tell=tell
        )
        self._connections: list[Connection] = [
            connection_of(k, source, driver, self.gathering.receive, self.gathering.tell, clock)
            for k, (source, driver) in enumerate(zip(config.sources, drivers, strict=True))
        ]

    def open(self) -> None:
        """Open all ports; HardwareError where one cannot be."""
        for connection in self._connections:
            connection.open()

    def start(self, outputs: Outputs) -> None:
        """Begin to gather and write; the outputs are closed by `stop`."""
        self._outputs = outputs
        self.gathering.start()

    def wait(self) -> None:
        """Be back when all channels have come; HardwareError where they do not."""
        missing = self.gathering.missing(_COMING_S)
        if missing:
            raise HardwareError(
                f"the channels {', '.join(missing)} do not come: look with softfuse doctor, nothing has moved"
            )
        self.gathering.reading(_FIRST_S)

    def remark(self, text: str) -> None:
        """Write down what was done."""
        self.gathering.tell(Notice(self._clock.now_s(), None, "info", text))

    @property
    def written(self) -> list[str]:
        """The files."""
        return [] if self._outputs is None else [str(path) for path in self._outputs.files]

    @property
    def lost(self) -> int:
        """Entries that are in no file."""
        return 0 if self._outputs is None else self._outputs.lost

    def stop(self) -> None:
        """Close the ports, write what waits, close the files; HardwareError where the disk failed."""
        for connection in self._connections:
            connection.stop()
        try:
            try:
                self.gathering.stop()
            finally:
                if self._outputs is not None:
                    self._outputs.close()
        except OSError as error:
            raise HardwareError(f"what was measured cannot be written down: {error}") from error

    def _send(self, source: int, data: bytes) -> None:
        self._connections[source].send(data)

    def _write(self, entry: Chunk | FrameEntry | Notice) -> None:
        assert self._outputs is not None  # before the gathering starts
        self._outputs.write(entry)
