"""Where the robot's channels come from: ports, and what the bytes mean that come from them.

The sensors find their channels by name, whichever source they come from. What is said of the drivers here is
checked against softfuse/hardware/source by a test, since a configuration knows nothing of hardware.
"""

from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal, Self

from annotated_types import Gt
from pydantic import AfterValidator, Field, model_validator

from softfuse.io.quantity import Frequency, PositiveInteger, PositiveNumber, wrong_value
from softfuse.io.settings import Settings

Preset = Literal[
    "mpr121-bare-conductive", "mpr121-adafruit", "fdc1004-single", "fdc1004-multi", "trill-craft", "muca"
]


def _six_different(names: tuple[str, ...]) -> tuple[str, ...]:
    if len(names) != 6 or len(set(names)) != 6:
        raise wrong_value("name six different channels: three forces [N] and three torques [N m]")
    return names


def _address(url: str) -> str:
    if not url.strip():
        raise wrong_value('give a port, such as "/dev/ttyUSB0", "COM3" or "socket://127.0.0.1:9000"')
    return url


def _serial(url: str) -> str:
    if url.lower().startswith("udp://"):
        raise wrong_value('is no serial port: only the driver "ati-net-ft" speaks over UDP')
    return _address(url)


def _datagrams(url: str) -> str:
    if not url.lower().startswith("udp://"):
        raise wrong_value('such a sensor is reached over the network: write "udp://192.168.1.1"')
    return url


SerialUrl = Annotated[str, AfterValidator(_serial)]
UdpUrl = Annotated[str, AfterValidator(_datagrams)]
Wrench = Annotated[tuple[str, ...], AfterValidator(_six_different)]

_RFT_RATES = (10.0, 20.0, 50.0, 100.0, 200.0, 333.0, 500.0, 1000.0)
_WRENCH = ("fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm")


class SoftfuseSource(Settings):
    """A board of softfuse's own binary protocol, which says by itself what its channels are."""

    driver: Literal["softfuse"]
    url: SerialUrl
    baud: PositiveInteger = 115200

    @property
    def known_channels(self) -> tuple[str, ...]:
        """None: the board tells them."""
        return ()


class LinesSource(Settings):
    """A board that prints lines of numbers; channels: column of the lines -> name of the channel.

    preset: what a well-known example sketch prints; or columns, in order, where the board prints no header;
    time: the column of the board's time, which ends in _us, _ms or _s; separator between the fields, " " for
    any white space; prefix: only lines that begin with it are read.
    """

    driver: Literal["lines"]
    url: SerialUrl
    baud: PositiveInteger = 115200
    channels: dict[str, str]
    preset: Preset | None = None
    columns: tuple[str, ...] = ()
    time: str | None = None
    separator: Literal[",", ";", "\t", " ", ":", "|"] = ","
    prefix: str = ""

    @property
    def known_channels(self) -> tuple[str, ...]:
        """Those that the columns stand for."""
        return tuple(self.channels.values())

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.channels:
            raise wrong_value('name at least one: a table of column = "channel"', key="channels")
        if self.preset is not None:
            given = sorted(self.model_fields_set & {"columns", "time", "separator", "prefix"})
            if given:
                raise wrong_value(
                    f"the preset says it: remove this key, or preset = {self.preset!r}", key=given[0]
                )
        elif self.columns:
            for column in (*self.channels, *(() if self.time is None else (self.time,))):
                if column not in self.columns:
                    raise wrong_value(f'lack "{column}"', key="columns")
        return self


class AtiNetFtSource(Settings):
    """ATI's Net F/T or Ethernet Axia over UDP; counts as its web page tells for newtons and newton metres.

    internal_rate in Hz: of the sensor's own samples, None where it is not known for sure.
    """

    driver: Literal["ati-net-ft"]
    url: UdpUrl
    counts_per_newton: PositiveNumber
    counts_per_newton_metre: PositiveNumber
    internal_rate: Annotated[Frequency, Gt(0)] | None = None
    channels: Wrench = _WRENCH
    baud: ClassVar[None] = None

    @property
    def known_channels(self) -> tuple[str, ...]:
        """Forces and torques."""
        return self.channels


def _one_of_its_rates(rate: float) -> float:
    if rate not in _RFT_RATES:
        raise wrong_value(
            f"an RFT cannot send at {rate:g} Hz: choose from {', '.join(f'{one:g}' for one in _RFT_RATES)} Hz"
        )
    return rate


class RobotousRftSource(Settings):
    """A Robotous RFT sensor on a serial line; counts as the manual of its model tells.

    rate in Hz, None: what the sensor is set to.
    """

    driver: Literal["robotous-rft"]
    url: SerialUrl
    baud: PositiveInteger = 115200
    counts_per_newton: PositiveNumber = 50.0
    counts_per_newton_metre: PositiveNumber = 2000.0
    rate: Annotated[Frequency, AfterValidator(_one_of_its_rates)] | None = None
    channels: Wrench = _WRENCH

    @property
    def known_channels(self) -> tuple[str, ...]:
        """Forces and torques."""
        return self.channels


class BotaSource(Settings):
    """A Bota Systems sensor on a serial line."""

    driver: Literal["bota"]
    url: SerialUrl
    baud: PositiveInteger = 460800
    channels: Wrench = _WRENCH

    @property
    def known_channels(self) -> tuple[str, ...]:
        """Forces and torques."""
        return self.channels


AnySource = Annotated[
    SoftfuseSource | LinesSource | AtiNetFtSource | RobotousRftSource | BotaSource,
    Field(discriminator="driver"),
]


def check_sources(sources: Sequence[AnySource]) -> None:
    """Raise the error of a validator where two sources share a port or a channel."""
    ports: dict[str, int] = {}
    owners: dict[str, int] = {}
    for k, source in enumerate(sources):
        other = ports.setdefault(source.url, k)
        if other != k:
            raise wrong_value(f'the port "{source.url}" is taken by source[{other}]', key=f"source[{k}].url")
        for name in source.known_channels:
            owner = owners.get(name)
            if owner is not None:
                raise wrong_value(
                    f'the channel "{name}" comes from source[{owner}] already: give it another name',
                    key=f"source[{k}].channels",
                )
            owners[name] = k
