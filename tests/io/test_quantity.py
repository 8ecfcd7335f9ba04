"""Strings with units to SI."""

import math
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic_core import PydanticCustomError

from softfuse.io.quantity import (
    _COMMON,
    _DIMENSIONS,
    ACCELERATION,
    DENSITY,
    FLOW_SENSITIVITY,
    FORCE,
    FREQUENCY,
    LENGTH,
    PRESSURE,
    TIME,
    VOLTAGE,
    VOLTAGE_WALK,
    VOLUME,
    Dimension,
    _registry,
    length_unit,
)


@pytest.mark.parametrize(
    ("unit", "target", "factor"),
    [(*units, Decimal(factor)) for units, factor in _COMMON.items()]
    + [(dimension.unit, dimension.unit, Decimal(1)) for dimension in _DIMENSIONS],
)
def test_what_is_known_without_pint_is_what_pint_says(unit, target, factor):
    registry = _registry()
    assert registry.Quantity(Decimal(1), registry.parse_units(unit)).to(target).magnitude == factor


@pytest.mark.parametrize(
    ("dimension", "text", "value"),
    [
        (LENGTH, "64 mm", 0.064),
        (LENGTH, "18mm", 0.018),
        (LENGTH, " -1.5e2 µm ", -1.5e-4),
        (LENGTH, "1 inch", 0.0254),
        (PRESSURE, "0.3 MPa", 3e5),
        (PRESSURE, "7 N/mm^2", 7e6),
        (PRESSURE, "7 N/mm²", 7e6),
        (PRESSURE, "1 atm", 101325.0),
        (FORCE, "15 N", 15.0),
        (VOLUME, "785 mm^3", 785e-9),
        (VOLUME, "2 mL", 2e-6),
        (DENSITY, "1.08 g/cm^3", 1080.0),
        (VOLTAGE, "2 mV", 2e-3),
        (VOLTAGE_WALK, "0.02 mV/s^0.5", 2e-5),
        (FLOW_SENSITIVITY, "20 V min/L", 1.2e6),
        (FLOW_SENSITIVITY, "20 V/(L/min)", 1.2e6),
        (TIME, "3 ms", 3e-3),
        (FREQUENCY, "100 Hz", 100.0),
        (ACCELERATION, "-9.81 m/s^2", -9.81),
    ],
)
def test_units_become_si(dimension: Dimension, text: str, value: float) -> None:
    assert dimension.parse(text) == pytest.approx(value, rel=1e-15)


def test_decimals_stay_exact() -> None:
    assert [LENGTH.parse(f"{k} mm") for k in range(-80, 80)] == [k / 1000 for k in range(-80, 80)]


@pytest.mark.parametrize(
    "dimension",
    [LENGTH, VOLUME, TIME, FREQUENCY, ACCELERATION, FORCE, PRESSURE, DENSITY, VOLTAGE, VOLTAGE_WALK],
)
def test_examples_in_messages_are_valid(dimension: Dimension) -> None:
    assert math.isfinite(dimension.parse(dimension.example))
    assert dimension.parse(f"1 {dimension.unit}") == 1.0


@pytest.mark.parametrize(
    ("value", "told"),
    [
        ("64 kg", '"64 kg" is a mass, expected a length such as "64 mm"'),
        ("64 mm^2", '"64 mm^2" is an area, expected a length such as "64 mm"'),
        ("64 Pa", '"64 Pa" is a pressure, expected a length such as "64 mm"'),
        ("64 %", '"64 %" is a number, expected a length such as "64 mm"'),
        (
            "64 lux",
            '"64 lux" is of dimension [luminosity] / [length] ** 2, expected a length such as "64 mm"',
        ),
        ("64", '"64" has no unit, expected a length such as "64 mm"'),
        (64, '64 has no unit, expected a length such as "64 mm"'),
        (True, 'true has no unit, expected a length such as "64 mm"'),
        ("64 mmm", '"64 mmm" has the unknown unit "mmm", expected a length such as "64 mm"'),
        ("mm", '"mm" is no quantity, expected a length such as "64 mm"'),
        ("nan mm", '"nan mm" is no quantity, expected a length such as "64 mm"'),
        ("6 4 mm", '"6 4 mm" is no quantity, expected a length such as "64 mm"'),
        (["64 mm"], 'a list is no quantity, expected a length such as "64 mm"'),
        ({}, 'a table is no quantity, expected a length such as "64 mm"'),
    ],
)
def test_a_mistake_is_told(value: object, told: str) -> None:
    with pytest.raises(PydanticCustomError) as caught:
        LENGTH.parse(value)
    assert caught.value.message() == told


_characters = st.text(alphabet="0123456789.eE+-_ */^²()mkgsNPaVLHz%µÅ", max_size=16)


@given(st.one_of(st.text(max_size=16), _characters, st.builds("{} {}".format, st.floats(), _characters)))
def test_any_text_is_a_number_or_a_message(text: str) -> None:
    try:
        value = LENGTH.parse(text)
    except PydanticCustomError as error:
        assert error.message()
    else:
        assert isinstance(value, float)


@pytest.mark.parametrize(("unit", "scale"), [("mm", 1e-3), (" m ", 1.0), ("inch", 0.0254), ("µm", 1e-6)])
def test_units_of_files(unit: str, scale: float) -> None:
    assert length_unit(unit) == pytest.approx(scale, rel=1e-15)


@pytest.mark.parametrize("unit", ["kg", "mmm", "2 mm", "", 1.0])
def test_wrong_units_of_files(unit: object) -> None:
    with pytest.raises(PydanticCustomError, match="unit"):
        length_unit(unit)
