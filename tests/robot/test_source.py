"""The sources of a robot: what is read, and how mistakes are told."""

from collections.abc import Callable
from pathlib import Path

import pytest

from softfuse.errors import ConfigError
from softfuse.robot.file import load
from softfuse.robot.source import AtiNetFtSource, RobotousRftSource

Write = Callable[..., Path]

DRIVERS = '"softfuse", "lines", "ati-net-ft", "robotous-rft", "bota"'
PAD = '[[source]]\ndriver = "softfuse"\nurl = "/dev/ttyACM0"\n'
BOARD = '[[source]]\ndriver = "lines"\nurl = "COM3"\n'
TOUCH = BOARD + 'preset = "mpr121-adafruit"\n[source.channels]\ne0 = "row0"\ne1 = "row1"\n'
ATI = (
    '[[source]]\ndriver = "ati-net-ft"\nurl = "udp://192.168.1.1"\n'
    "counts_per_newton = 1e6\ncounts_per_newton_metre = 1e6\n"
)
RFT = '[[source]]\ndriver = "robotous-rft"\nurl = "/dev/ttyUSB0"\n'
BOTA = '[[source]]\ndriver = "bota"\nurl = "/dev/ttyUSB1"\n'


@pytest.fixture
def written(write: Write, pad_text: str) -> Callable[[str], Path]:
    """Writes configs/pad.toml with sources at its end."""
    last = pad_text.rstrip().splitlines()[-1]
    return lambda text: write((last, f"{last}\n{text}"))


def test_a_robot_may_have_no_source(write: Write) -> None:
    assert load(write()).sources == ()


@pytest.mark.parametrize("writer", ["write", "write_finger"])
def test_the_source_of_the_examples_is_one(request: pytest.FixtureRequest, writer: str) -> None:
    write = request.getfixturevalue(writer)
    marks = [(f"# {line}", line) for line in ("[[source]]", "driver = ", "url = ", "baud = ")]
    (source,) = load(write(*marks)).sources
    assert source.driver == "softfuse" and (source.url, source.baud) == ("/dev/ttyACM0", 115200)


def test_sources_are_read_in_their_order(written: Callable[[str], Path]) -> None:
    pad, touch, ati, rft = load(written(PAD + TOUCH + ATI + RFT + RENAMED)).sources
    assert (pad.driver, pad.url) == ("softfuse", "/dev/ttyACM0") and pad.known_channels == ()
    assert touch.driver == "lines" and touch.known_channels == ("row0", "row1")
    assert isinstance(ati, AtiNetFtSource)
    assert ati.counts_per_newton == 1e6 and ati.internal_rate is None
    assert ati.known_channels == ("fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm")
    assert isinstance(rft, RobotousRftSource)
    assert (rft.rate, rft.baud, rft.counts_per_newton) == (100.0, 115200, 50.0)


RENAMED = 'rate = "100 Hz"\nchannels = ["a_N", "b_N", "c_N", "d_Nm", "e_Nm", "f_Nm"]\n'


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            PAD.replace("softfuse", "softfoose"),
            'source[0].driver: "softfoose" is none of ' + DRIVERS,
        ),
        (
            PAD.replace('driver = "softfuse"\n', ""),
            "source[0].driver: missing, give one of " + DRIVERS,
        ),
        (PAD.replace('url = "/dev/ttyACM0"\n', ""), "source[0].url: missing"),
        (PAD + "bauds = 9600\n", 'source[0].bauds: unknown key, did you mean "baud"?'),
        (PAD + "baud = 0\n", "source[0].baud: 0 must be greater than 0"),
        (
            PAD.replace("/dev/ttyACM0", " "),
            'source[0].url: give a port, such as "/dev/ttyUSB0", "COM3" or "socket://127.0.0.1:9000"',
        ),
        (
            PAD.replace("/dev/ttyACM0", "udp://10.0.0.1"),
            'source[0].url: is no serial port: only the driver "ati-net-ft" speaks over UDP',
        ),
        (
            ATI.replace("udp://192.168.1.1", "COM4"),
            'source[0].url: such a sensor is reached over the network: write "udp://192.168.1.1"',
        ),
        (ATI.replace("counts_per_newton = 1e6\n", ""), "source[0].counts_per_newton: missing"),
        (
            ATI + "internal_rate = 7000\n",
            'source[0].internal_rate: 7000 has no unit, expected a frequency such as "100 Hz"',
        ),
        (
            RFT + 'rate = "60 Hz"\n',
            "source[0].rate: an RFT cannot send at 60 Hz: "
            "choose from 10, 20, 50, 100, 200, 333, 500, 1000 Hz",
        ),
        (
            BOTA + 'channels = ["fx_N", "fx_N", "a", "b", "c", "d"]\n',
            "source[0].channels: name six different channels: three forces [N] and three torques [N m]",
        ),
        (
            TOUCH.replace("adafruit", "sparkfun"),
            'source[0].preset: "mpr121-sparkfun" is none of "mpr121-bare-conductive", "mpr121-adafruit", '
            '"fdc1004-single", "fdc1004-multi", "trill-craft", "muca"',
        ),
        (
            TOUCH.replace("preset", 'separator = ";"\npreset'),
            "source[0].separator: the preset says it: remove this key, or preset = 'mpr121-adafruit'",
        ),
        (BOARD, "source[0].channels: missing"),
        (BOARD + "channels = {}\n", 'source[0].channels: name at least one: a table of column = "channel"'),
        (BOARD + 'columns = ["a"]\nchannels = { b = "row0" }\n', 'source[0].columns: lack "b"'),
        (
            PAD + PAD,
            'source[1].url: the port "/dev/ttyACM0" is taken by source[0]',
        ),
        (
            RFT + BOTA,
            'source[1].channels: the channel "fx_N" comes from source[0] already: give it another name',
        ),
    ],
)
def test_a_mistake_is_told_with_its_key(written: Callable[[str], Path], text: str, told: str) -> None:
    path = written(text)
    with pytest.raises(ConfigError) as caught:
        load(path)
    assert str(caught.value) == f"{path}: {told}"


def test_two_channels_of_one_board_are_not_one(written: Callable[[str], Path]) -> None:
    with pytest.raises(ConfigError, match='the channel "row0" comes from source'):
        load(written(TOUCH.replace('"row1"', '"row0"')))
