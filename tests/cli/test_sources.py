"""What the configuration says of sources is what the drivers do."""

from typing import get_args

import numpy as np
import pytest
from pydantic import TypeAdapter

from softfuse.errors import HardwareError, WireError
from softfuse.hardware.source.ati_net_ft import AtiNetFt
from softfuse.hardware.source.configured import connection_of, driver_of, open_port_of
from softfuse.hardware.source.serial_force_torque import RATES, BotaSerial, RobotousRft
from softfuse.hardware.source.softfuse_frames import SoftfuseFrames
from softfuse.hardware.source.text_lines import PRESETS, TextLines
from softfuse.hardware.stream import HostClock
from softfuse.robot.source import AnySource, AtiNetFtSource, BotaSource, Preset

SETTINGS = TypeAdapter(AnySource)
NAMES = ("a_N", "b_N", "c_N", "d_Nm", "e_Nm", "f_Nm")


def source(**settings) -> AnySource:
    return SETTINGS.validate_python(settings)


@pytest.mark.parametrize(
    ("settings", "kind"),
    [
        ({"driver": "softfuse", "url": "loop://"}, SoftfuseFrames),
        ({"driver": "lines", "url": "loop://", "channels": {"a": "row0"}}, TextLines),
        ({"driver": "bota", "url": "loop://"}, BotaSerial),
        ({"driver": "robotous-rft", "url": "loop://"}, RobotousRft),
        (
            {"driver": "ati-net-ft", "url": "udp://127.0.0.1", "counts_per_newton": 1.0}
            | {"counts_per_newton_metre": 1.0},
            AtiNetFt,
        ),
    ],
)
def test_each_source_has_its_driver_and_its_port(settings, kind):
    made = source(**settings)
    assert type(driver_of(made)) is kind
    port = open_port_of(made)
    port.close()


def test_the_presets_are_those_of_the_drivers():
    assert set(get_args(Preset)) == set(PRESETS)
    for preset in PRESETS:
        column = next(one for one in PRESETS[preset].columns if not one.startswith("time"))
        made = source(driver="lines", url="COM1", preset=preset, channels={column: "row0"})
        assert isinstance(driver_of(made), TextLines)


def test_the_rates_are_those_of_the_driver():
    for rate in RATES:
        made = source(driver="robotous-rft", url="COM1", rate=f"{rate} Hz")
        assert driver_of(made).greeting()[1][2] == RATES[rate]


@pytest.mark.parametrize("name", ["f\n", "a,b", ""])
def test_names_that_no_recording_can_have_are_told(name):
    with pytest.raises(WireError, match="name"):
        driver_of(source(driver="bota", url="COM1", channels=("a", "b", "c", "d", "e", name)))


def test_settings_reach_the_drivers():
    record = np.array([7, 14000, 0, 10, 20, 30, 40, 50, 60], ">u4").tobytes()
    ati = source(
        driver="ati-net-ft",
        url="udp://127.0.0.1",
        counts_per_newton=10.0,
        counts_per_newton_metre=20.0,
        internal_rate="7 kHz",
        channels=NAMES,
    )
    assert isinstance(ati, AtiNetFtSource)
    (reading,) = driver_of(ati).feed(record, 0.0)
    assert (reading.names, reading.device_time_us) == (NAMES, 2_000_000)
    np.testing.assert_allclose(reading.values, [1.0, 2.0, 3.0, 2.0, 2.5, 3.0])
    rft = source(driver="robotous-rft", url="COM1", rate="333 Hz", counts_per_newton=1.0, channels=NAMES)
    assert [part[1:3] for part in driver_of(rft).greeting()] == [b"\x0c\0", b"\x0f\x06", b"\x0b\0"]
    bota = source(driver="bota", url="COM1")
    assert isinstance(bota, BotaSource) and bota.baud == 460800
    lines = source(
        driver="lines",
        url="COM1",
        columns=["time_ms", "x", "y"],
        time="time_ms",
        separator=";",
        prefix="D ",
        channels={"y": "row0"},
    )
    (reading,) = driver_of(lines).feed(b"D 5;1;2\n", 0.0)
    assert (reading.device_time_us, reading.names, reading.values.tolist()) == (5000, ("row0",), [2.0])


def test_a_source_that_is_not_there_is_told():
    made = source(driver="softfuse", url="/dev/no-such-port")
    connection = connection_of(0, made, driver_of(made), print, print, HostClock())
    with pytest.raises(HardwareError, match="/dev/no-such-port: there is no such port"):
        connection.open()
