"""Shapes of cavities: from settings to a layout's (`softfuse.robot.layout.cavity_shape`), and back.

    profile = "rounded-box"                 # or "superellipsoid", with roundness = 0.5
    half = ["14 mm", "14 mm", "3 mm"]       # half-sizes along its own axes
    turn = ["0 deg", "0 deg", "10 deg"]     # rotation vector; left out: none
    fillet = "1 mm"
    harmonics = [0.01, 0, 0, 0, 0]          # of degrees 2, 3, ...; left out: none

A table that has more to say of a cavity, such as its name and centre, inherits from the settings of a
profile.
"""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from math import isqrt
from typing import Annotated, Any, Literal, Self

import jax.numpy as jnp
import numpy as np
from annotated_types import Ge, Gt, Le
from jaxtyping import Array, Float
from pydantic import AfterValidator, Field, model_validator

from softfuse.io.quantity import ANGLE, LENGTH, Angle, Dimension, Number, PositiveLength, wrong_value
from softfuse.io.settings import Settings, Vector
from softfuse.robot.layout.cavity_shape import PLACE, CavityShape
from softfuse.robot.layout.profile import AbstractProfile, FreeForm, RoundedBox, Superellipsoid

_DIGITS = 12
"""Of the numbers that are written: they are read again to 1e-11 of themselves."""


def _whole_degree(coefficients: tuple[float, ...]) -> tuple[float, ...]:
    """Degree n has 2 n + 1 harmonics, so that degrees 2 to n have (n + 1)² − 4."""
    count = len(coefficients)
    if count and _up_to(_degree(count)) != count:
        few = _degree(count)
        near = " or ".join(f"{_up_to(n)} (to degree {n})" for n in (few, few + 1) if n > 1)
        raise wrong_value(f"{count} values are of no whole degree: give {near}")
    return coefficients


def _degree(count: int) -> int:
    """The highest one of which so many coefficients have all."""
    return isqrt(count + 4) - 1


def _up_to(degree: int) -> int:
    return (degree + 1) ** 2 - 4


class CavityShapeSettings(Settings):
    """Half-sizes (3,) m along the cavity's own axes, rotation vector (3,) rad, and coefficients (c,) [-] of
    harmonics of degrees 2, 3, ... by which the logarithm of the profile's radius is more.
    """

    half: tuple[PositiveLength, PositiveLength, PositiveLength]
    turn: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)
    harmonics: Annotated[tuple[Annotated[Number, Ge(-1), Le(1)], ...], AfterValidator(_whole_degree)] = ()

    @property
    @abstractmethod
    def base(self) -> AbstractProfile:
        """The profile without harmonics."""

    @property
    @abstractmethod
    def parameters(self) -> tuple[float, ...]:
        """Of `base` (b,), in SI."""

    @property
    def shape(self) -> CavityShape:
        """The kind of surface."""
        count = len(self.harmonics)
        return CavityShape(FreeForm(self.base, _degree(count)) if count else self.base)

    def values(self, centre: Vector) -> dict[str, float]:
        """All values of the shape by name, in SI, with a centre (3,) m; in the order of its names."""
        every = (*centre, *self.half, *self.turn, *self.parameters, *self.harmonics)
        return dict(zip(self.shape.names, every, strict=True))


class RoundedBoxSettings(CavityShapeSettings):
    """A box with fillets of a radius in m on its edges and corners."""

    profile: Literal["rounded-box"]
    fillet: PositiveLength

    @property
    def base(self):
        """A rounded box."""
        return RoundedBox()

    @property
    def parameters(self):
        """The fillet's radius."""
        return (self.fillet,)

    @model_validator(mode="after")
    def _check_fillet(self) -> Self:
        if self.fillet > min(self.half):
            raise wrong_value(
                f"{1e3 * self.fillet:g} mm has no room in half-sizes of {1e3 * min(self.half):g} mm: make it "
                "smaller",
                key="fillet",
            )
        return self


class SuperellipsoidSettings(CavityShapeSettings):
    """Between a box and an ellipsoid: roundness near 0 and of 1 [-]."""

    profile: Literal["superellipsoid"]
    roundness: Annotated[Number, Gt(0), Le(1)]

    @property
    def base(self):
        """A superellipsoid."""
        return Superellipsoid()

    @property
    def parameters(self):
        """The roundness."""
        return (self.roundness,)


AnyCavityShape = Annotated[RoundedBoxSettings | SuperellipsoidSettings, Field(discriminator="profile")]


def written_shape(shape: CavityShape, values: Float[Array | np.ndarray, " v"]) -> dict[str, Any]:
    """The keys of such settings, for a file, that say the values (v,) in SI of a shape, but for its centre.

    What is read from them differs by at most 1e-11 of each value.
    """
    by_name = dict(zip(shape.names, map(float, values), strict=True))
    place = [by_name[name] for name in PLACE]
    keys: dict[str, Any] = {"profile": "", "half": [_written(size, LENGTH, "mm") for size in place[3:6]]}
    if any(place[6:]):
        keys["turn"] = [_written(angle, ANGLE, "deg") for angle in place[6:]]
    (parameter, value), *harmonics = ((name, by_name[name]) for name in shape.names[len(PLACE) :])
    keys |= _PROFILES[parameter](value)
    if harmonics:
        keys["harmonics"] = [_rounded(coefficient) for _, coefficient in harmonics]
    return keys


def written_centre(shape: CavityShape, values: Float[Array | np.ndarray, " v"]) -> list[str]:
    """The centre in the values (v,) of a shape, for a file."""
    return [_written(float(x), LENGTH, "mm") for x in shape.centre(jnp.asarray(values))]


def _written(value: float, dimension: Dimension, unit: str) -> str:
    """A value in SI as a quantity in another unit."""
    return f"{value / dimension.parse(f'1 {unit}'):.{_DIGITS}g} {unit}"


def _rounded(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")


_PROFILES: Mapping[str, Callable[[float], dict[str, Any]]] = {
    "fillet": lambda value: {"profile": "rounded-box", "fillet": _written(value, LENGTH, "mm")},
    "roundness": lambda value: {"profile": "superellipsoid", "roundness": _rounded(value)},
}
"""The keys of a profile by its parameter."""
