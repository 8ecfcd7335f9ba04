"""Faults of a virtual device, as they are written on the command line."""

from dataclasses import replace

import pytest

from softfuse.errors import SoftfuseError
from softfuse.hardware.virtual.board import DeadSensor, SensorFaults
from softfuse.hardware.virtual.faults import Faults, LineFaults, Outages, parse_faults

NAMES = ("row3", "flow1_V")


def test_faults_are_parsed() -> None:
    asked = ["drop-bytes=1e-4", "flip-bits=0.001", "lose-samples=0.01", "power-cut=2/30", "clock-drift=-120"]
    asked += ["silent=row3@20", "stuck=flow1_V@0"]
    usual = Faults()
    assert parse_faults(asked, NAMES) == replace(
        usual,
        line=LineFaults(1e-4, 1e-3),
        sensors=SensorFaults(
            0.01, (DeadSensor("row3", 20.0, silent=True), DeadSensor("flow1_V", 0.0, silent=False))
        ),
        outages=Outages(2.0, 30.0, powers=True),
        drift_ppm=-120.0,
    )
    assert parse_faults([], NAMES) == usual
    with pytest.raises(SoftfuseError):
        parse_faults(["lose-samples=nan"], NAMES)
