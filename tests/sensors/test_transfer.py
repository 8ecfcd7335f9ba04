"""Outputs of pressure and flow sensors by part, and constants that are given instead."""

from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from made_sensors import chambered, raw_of
from pydantic import ValidationError
from sensor_tables import settings_of

from softfuse.sensors.pressure.data_sheets import PRESSURE_PARTS
from softfuse.sensors.pressure.settings import PressureSettings

SPAN = {"range": ["-1 kPa", "3 kPa"]}


def pressure(**keys: Any) -> PressureSettings:
    return PressureSettings.model_validate({"name": "p", "channels": ["a"], "chambers": ["b"]} | keys)


@pytest.mark.parametrize(
    ("part", "kPa", "output"),
    [
        ("MPX4115A", 115.0, 4.7),
        ("MPX4250A", 250.0, 4.8),
        ("MPX5010", 10.0, 4.7),
        ("MPX5050", 50.0, 4.7),
        ("MPX5100A", 15.0, 0.2),
        ("MPX5100D", 100.0, 4.7),
        ("MPX5500", 500.0, 4.7),
        ("MPX5700", 700.0, 4.7003),
        ("MPXV5004G", 3.92, 4.92),
        ("MPXV7002", -2.0, 0.5),
        ("MPXV7007", 7.0, 4.495),
        ("ABP-analog", 3.0, 4.5),
        ("SSC-digital", -1.0, 1638.4),
        ("ABP-digital", 3.0, 14745.6),
        ("BMP280", 101.325, 101325.0),
        ("LPS22HB", 101.325, 4096 * 1013.25),
    ],
)
def test_outputs_are_those_of_the_data_sheets(part: str, kPa: float, output: float) -> None:
    settings = pressure(part=part, **(SPAN if "-" in part else {}))
    sensor = settings.sensor(chambered(settings.chambers, drive=0))
    reference = sensor.reference
    assert float(raw_of(sensor, np.array([1e3 * kPa]), reference)[0]) == pytest.approx(output, rel=1e-9)
    assert float(sensor.pressure_of(jnp.array([output]), reference)[0]) == pytest.approx(1e3 * kPa)
    low, high = settings.range
    ends = np.asarray(raw_of(sensor, np.array([low, high]), reference))
    # The whole range can be read.
    assert np.all(ends > settings.low) and np.all(ends < settings.high)


def test_every_part_can_be_named() -> None:
    for part in PRESSURE_PARTS:
        settings = pressure(part=part, **(SPAN if part.startswith(("ABP", "SSC")) else {}))
        assert (settings.reference_range is None) == (settings.output == "counts")


def test_constants_stand_for_those_of_the_part() -> None:
    assert pressure(part="MPX5100A", noise="1 mV").noise == 1e-3
    own = pressure(
        output="counts", slope="2 Pa^-1", offset=10.0, range=["0 Pa", "5 kPa"], reference=1.0, low=0.0,
        high=20000.0, noise=3.0, bits=16, full_scale=65536.0, absolute=False,
    )  # fmt: skip
    sensor = own.sensor(chambered(own.chambers, drive=0))
    assert float(raw_of(sensor, np.array([500.0]), sensor.reference)[0]) == 1010.0


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ({"part": "MPX5100"}, '"MPX5100" is none of MPX4115A, '),
        ({"part": "MPX5100A", "noise": 2.0}, "2.0 has no unit, expected a voltage"),
        ({"part": "SSC-digital", **SPAN, "noise": "2 mV"}, '"2 mV" is no plain number, as the output'),
        ({"part": "SSC-digital"}, "Field required"),
        ({"part": "MPX5100A", "reference": "3.3 V"}, "3.3 is not between 4.75 and 5.25"),
        ({"part": "BMP280", "reference_channel": "supply"}, "only a ratiometric part"),
        ({"part": "MPX5100A", "share": [0.1, 0.9]}, "give either slope and offset, or share"),
    ],
)
def test_what_no_part_has_is_refused(keys: dict[str, Any], told: str) -> None:
    with pytest.raises(ValidationError, match=told):
        pressure(**keys)


def test_a_digital_flow_sensor(parts) -> None:
    flow = settings_of("flow", part="SFM3000")
    # 10 litres per minute out of the first chamber.
    rate = 10e-3 / 60.0
    time = np.array([0.0, 0.1])
    raw = flow.ideal(parts, time, -rate * np.stack([time, 0 * time], axis=1))
    np.testing.assert_allclose(raw, [[33400.0, 32000.0]] * 2)
    assert (flow.electronics(parts, np.random.default_rng(0)).step == 1.0).all()
