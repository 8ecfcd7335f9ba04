"""The sources of a test bed, open, gathered and written down while its stage presses."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

from softfuse.errors import ConfigError, HardwareError
from softfuse.hardware.live.pipeline import Pipeline
from softfuse.hardware.record.entries import FrameEntry, SessionInfo
from softfuse.hardware.source.configured import connection_of, driver_of
from softfuse.hardware.source.connection import Connection
from softfuse.hardware.stage.gcode import GcodeStage
from softfuse.hardware.stream import Chunk, HostClock, Notice
from softfuse.hardware.testbed.bench import Bench, Pressed
from softfuse.hardware.testbed.files import Outputs
from softfuse.hardware.testbed.gathering import ForceAxis, Gathering
from softfuse.hardware.testbed.plan import Plan
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
        self._clock, self._tell = clock, tell
        self._outputs: Outputs | None = None
        self.gathering = Gathering(
            Pipeline(wanted, drivers), axis, clock, send=self._send, write=self._write, tell=tell
        )
        self._connections: list[Connection] = [
            connection_of(k, source, driver, self.gathering.receive, self.gathering.tell, clock)
            for k, (source, driver) in enumerate(zip(config.sources, drivers, strict=True))
        ]

    @contextmanager
    def recording(
        self,
        open_stage: Callable[[], GcodeStage],
        files: Sequence[Path],
        info_of: Callable[[tuple[str, ...]], SessionInfo],
    ) -> Iterator[GcodeStage]:
        """The stage, while all that comes from the sources is written to files; then everything is closed.

        info_of: what a session of such channels says first. Raises HardwareError where a port cannot be
        opened or the disk fails, RecordingError where a file cannot be written.
        """
        try:
            for connection in self._connections:
                connection.open()
            with closing(open_stage()) as stage:
                # Not before every port is open: a mistake in one leaves no file.
                info = info_of(self.gathering.channels)
                self._outputs = Outputs(files, info, self._clock, self._tell)
                self.gathering.start()
                yield stage
        finally:
            self._stop()
        if self._outputs is not None and self._outputs.lost:
            raise HardwareError(
                f"{self._outputs.lost} entries could not be recorded to {self.written}: look at the disk"
            )

    def press(self, stage: GcodeStage, plan: Plan, *, home: bool) -> Iterator[Pressed]:
        """Press the places of a plan with a stage that is recorded, after seeking its end switches where told
        so; each press when it is done.

        Raises HardwareError where the channels do not come, before anything moves, and as `Bench.press`.
        """
        missing = self.gathering.missing(_COMING_S)
        if missing:
            raise HardwareError(
                f"the channels {', '.join(missing)} do not come: look with softfuse doctor, nothing has moved"
            )
        self.gathering.reading(_FIRST_S)
        stage.connect()
        if home:
            stage.home()
        bench = Bench(stage, self.gathering, plan.settings, plan.origin)
        yield from bench.press(plan.places, plan.first, self._remark)

    @property
    def written(self) -> str:
        """The files."""
        return "" if self._outputs is None else ", ".join(map(str, self._outputs.files))

    def _remark(self, text: str) -> None:
        self.gathering.tell(Notice(self._clock.now_s(), None, "info", text))

    def _stop(self) -> None:
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
