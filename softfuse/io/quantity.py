"""Numbers with units: a string such as "64 mm" becomes a float in SI.

A quantity is a decimal number and a unit of the expected dimension, in the notation of pint ("0.3 MPa", "1000
kg/m^3", "20 V min/L"). A plain number is refused, so that nobody has to guess what it counts.
"""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from functools import cache
from typing import Annotated, Any

from annotated_types import Ge, Gt
from pydantic import BeforeValidator, Strict
from pydantic_core import PydanticCustomError

_NUMBER = r"[+-]?(?:\d[\d_]*\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?"
_FACTOR = r"[A-Za-zµμΩ%]+(?:(?:\^|\*\*)-?\d(?:\.\d)?|[²³])?"
_UNIT = rf"{_FACTOR}(?:(?:\s+|\s*[*/·]\s*)\(?\s*{_FACTOR}\s*\)?)*"
_QUANTITY = re.compile(rf"\s*({_NUMBER})\s*({_UNIT})?\s*")

_OTHERS = {
    "a mass": "kg",
    "an area": "m^2",
    "an energy or torque": "J",
    "a current": "A",
    "a flow": "m^3/s",
    "a number": "",
}
"""Dimensions that no setting has, but that people may write, and a unit of each."""


@dataclass(frozen=True)
class Dimension:
    """What a quantity measures, its SI unit and an example of how it is written."""

    name: str
    unit: str
    example: str

    def parse(self, value: Any) -> float:
        """The value in the SI unit of a string such as the example; the error says what is wrong with it."""
        expected = f"expected {self.name} such as {json.dumps(self.example)}"
        if isinstance(value, str) and (match := _QUANTITY.fullmatch(value)):
            number, unit = Decimal(match[1]), match[2]
            if unit is None:
                raise wrong_value(f"{shown(value)} has no unit, {expected}")
            factor = _factor(unit, self.unit)
            if isinstance(factor, str):
                raise wrong_value(f"{shown(value)} {factor}, {expected}")
            return float(number * factor)
        if isinstance(value, int | float):
            raise wrong_value(f"{shown(value)} has no unit, {expected}")
        raise wrong_value(f"{shown(value)} is no quantity, {expected}")


LENGTH = Dimension("a length", "m", "64 mm")
VOLUME = Dimension("a volume", "m^3", "785 mm^3")
TIME = Dimension("a time", "s", "0.5 s")
FREQUENCY = Dimension("a frequency", "Hz", "100 Hz")
ACCELERATION = Dimension("an acceleration", "m/s^2", "-9.81 m/s^2")
VELOCITY = Dimension("a velocity", "m/s", "10 mm/s")
FORCE = Dimension("a force", "N", "15 N")
MOMENT = Dimension("a moment", "N m", "20 N mm")
FORCE_RATE = Dimension("a force per time", "N/s", "5 N/s")
PRESSURE = Dimension("a pressure", "Pa", "0.3 MPa")
PRESSURE_RATE = Dimension("a pressure per time", "Pa/s", "2 Pa/s")
DENSITY = Dimension("a density", "kg/m^3", "1080 kg/m^3")
ANGLE = Dimension("an angle", "rad", "1 deg")
VOLTAGE = Dimension("a voltage", "V", "0.5 V")
VOLTAGE_WALK = Dimension("a random walk of a voltage", "V/s^0.5", "0.02 mV/s^0.5")
LAYER_COMPLIANCE = Dimension("a length per pressure", "m/Pa", "0.5 mm/MPa")
COMPLIANCE = Dimension("a length per force", "m/N", "0.05 mm/N")
RESISTANCE = Dimension("a resistance", "ohm", "12 ohm")
CAPACITANCE = Dimension("a capacitance", "F", "180 pF")
TEMPERATURE = Dimension("a temperature", "K", "293.15 K")
FLOW_SENSITIVITY = Dimension("a voltage per flow", "V s/m^3", "20 V min/L")

_DIMENSIONS = (
    LENGTH,
    VOLUME,
    TIME,
    FREQUENCY,
    ACCELERATION,
    VELOCITY,
    FORCE,
    FORCE_RATE,
    PRESSURE,
    PRESSURE_RATE,
    DENSITY,
    VOLTAGE,
    VOLTAGE_WALK,
    LAYER_COMPLIANCE,
    COMPLIANCE,
    RESISTANCE,
    CAPACITANCE,
    TEMPERATURE,
    FLOW_SENSITIVITY,
)

Length = Annotated[float, BeforeValidator(LENGTH.parse)]
Volume = Annotated[float, BeforeValidator(VOLUME.parse)]
Time = Annotated[float, BeforeValidator(TIME.parse)]
Frequency = Annotated[float, BeforeValidator(FREQUENCY.parse)]
Acceleration = Annotated[float, BeforeValidator(ACCELERATION.parse)]
Velocity = Annotated[float, BeforeValidator(VELOCITY.parse)]
Force = Annotated[float, BeforeValidator(FORCE.parse)]
ForceRate = Annotated[float, BeforeValidator(FORCE_RATE.parse)]
Pressure = Annotated[float, BeforeValidator(PRESSURE.parse)]
PressureRate = Annotated[float, BeforeValidator(PRESSURE_RATE.parse)]
Density = Annotated[float, BeforeValidator(DENSITY.parse)]
Angle = Annotated[float, BeforeValidator(ANGLE.parse)]
Voltage = Annotated[float, BeforeValidator(VOLTAGE.parse)]
VoltageWalk = Annotated[float, BeforeValidator(VOLTAGE_WALK.parse)]
LayerCompliance = Annotated[float, BeforeValidator(LAYER_COMPLIANCE.parse)]
Compliance = Annotated[float, BeforeValidator(COMPLIANCE.parse)]
Resistance = Annotated[float, BeforeValidator(RESISTANCE.parse)]
Capacitance = Annotated[float, BeforeValidator(CAPACITANCE.parse)]
Temperature = Annotated[float, BeforeValidator(TEMPERATURE.parse)]
FlowSensitivity = Annotated[float, BeforeValidator(FLOW_SENSITIVITY.parse)]
Number = Annotated[float, Strict()]
Integer = Annotated[int, Strict()]

PositiveLength = Annotated[Length, Gt(0)]
PositiveTime = Annotated[Time, Gt(0)]
PositiveVelocity = Annotated[Velocity, Gt(0)]
PositiveForce = Annotated[Force, Gt(0)]
PositiveMoment = Annotated[float, BeforeValidator(MOMENT.parse), Gt(0)]
PositiveForceRate = Annotated[ForceRate, Gt(0)]
PositivePressure = Annotated[Pressure, Gt(0)]
PositiveVoltage = Annotated[Voltage, Gt(0)]
PositiveNumber = Annotated[Number, Gt(0)]
PositiveInteger = Annotated[Integer, Gt(0)]
PositiveAcceleration = Annotated[Acceleration, Gt(0)]
PositiveAngle = Annotated[Angle, Gt(0)]
PositiveResistance = Annotated[Resistance, Gt(0)]
PositiveCapacitance = Annotated[Capacitance, Gt(0)]
Duration = Annotated[Time, Ge(0)]
Spread = Annotated[Voltage, Ge(0)]


def length_unit(value: Any) -> float:
    """Metres per unit of length: 1e-3 for "mm"."""
    if not isinstance(value, str):
        raise wrong_value(f'{shown(value)} is no unit of length such as "mm"')
    if not re.fullmatch(_UNIT, value.strip()):
        raise wrong_value(f'{shown(value)} is no unit of length such as "mm"')
    factor = _factor(value.strip(), "m")
    if isinstance(factor, str):
        raise wrong_value(f'{shown(value)} {factor}, expected a unit of length such as "mm"')
    return float(factor)


LengthUnit = Annotated[float, BeforeValidator(length_unit)]


def wrong_value(message: str, *, key: str = "") -> PydanticCustomError:
    """The error that a validator raises; key is the place of the mistake within what it validates."""
    return PydanticCustomError("softfuse", "{message}", {"message": message, "key": key})


def millimetres(length: float) -> str:
    """A length in m, for a file: what is read again differs by at most 1e-11 of it."""
    return f"{1e3 * length:.12g} mm"


def shown(value: Any) -> str:
    """A value as it stands in the file, in short."""
    if isinstance(value, Mapping):
        return "a table"
    if isinstance(value, list | tuple):
        return "a list"
    if isinstance(value, str | bool):
        return json.dumps(value, ensure_ascii=False)
    return str(value)


_COMMON = {
    ("mm", "m"): "1e-3",
    ("mm^3", "m^3"): "1e-9",
    ("kPa", "Pa"): "1e3",
    ("MPa", "Pa"): "1e6",
    ("mV", "V"): "1e-3",
    ("deg", "rad"): "0.01745329251994329576923690768",
    ("mV/s^0.5", "V/s^0.5"): "1e-3",
    ("V min/L", "V s/m^3"): "6e4",
    ("kPa^-1", "Pa^-1"): "1e-3",
}
"""What pint says of the units of most configurations, which it takes longer to load than all else there."""


@cache
def _registry():
    import pint

    # Decimals keep 18 mm at 0.018 m to the last digit; pint's annotations know them only as floats.
    registry: Any = pint.UnitRegistry
    return registry(non_int_type=Decimal)


@cache
def _factor(unit: str, target: str) -> Decimal | str:
    """SI units per unit, or why there is no such number, as the end of a sentence about the quantity."""
    if unit == target:
        return Decimal(1)
    if (unit, target) in _COMMON:
        return Decimal(_COMMON[unit, target])
    import pint

    registry = _registry()
    try:
        parsed = registry.parse_units(unit)
        if parsed.dimensionality == registry.parse_units(target).dimensionality:
            return Decimal(registry.Quantity(Decimal(1), parsed).to(target).magnitude)
    except (pint.PintError, ValueError, TypeError, AssertionError, ArithmeticError):
        return f"has the unknown unit {json.dumps(unit, ensure_ascii=False)}"
    return f"is {_kind(parsed.dimensionality)}"


def _kind(dimensionality: object) -> str:
    registry = _registry()
    known = {d.name: d.unit for d in _DIMENSIONS} | _OTHERS
    for name, unit in known.items():
        if registry.parse_units(unit).dimensionality == dimensionality:
            return name
    return f"of dimension {dimensionality}"
