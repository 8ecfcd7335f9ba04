"""Shapes of cavities in files: what is read, and that what is written is read again."""

import json

import numpy as np
import pytest
from pydantic import TypeAdapter

from softfuse.robot.chamber_shapes import (
    AnyCavityShape,
    CavityShapeSettings,
    RoundedBoxSettings,
    written_centre,
    written_shape,
)
from softfuse.robot.layout.cavity_shape import CavityShape
from softfuse.robot.layout.profile import AbstractProfile, FreeForm, RoundedBox, Superellipsoid

BOX = {"profile": "rounded-box", "half": ["14 mm", "1.2 cm", "3 mm"], "fillet": "1 mm"}
PLACED = np.array([-0.017, 1 / 30, 0.009, 0.014, 0.0121212121212121, 0.003])
"""Centre and half-sizes (6,) in m."""


def read(keys: object) -> CavityShapeSettings:
    return TypeAdapter(AnyCavityShape).validate_python(keys)


def test_a_box_is_read_in_si() -> None:
    found = read(BOX | {"turn": ["0 deg", "0 rad", "90 deg"]})
    assert found.shape == CavityShape(RoundedBox())
    values = found.values((0.001, 0.002, 0.003))
    assert tuple(values) == found.shape.names
    assert tuple(values.values()) == pytest.approx(
        (0.001, 0.002, 0.003, 0.014, 0.012, 0.003, 0.0, 0.0, np.pi / 2, 0.001), rel=1e-15
    )


def test_harmonics_make_it_a_free_form() -> None:
    keys = {"profile": "superellipsoid", "half": BOX["half"], "roundness": 0.4}
    coefficients = [0.01 * k for k in range(12)]
    found = read(keys | {"harmonics": coefficients})
    assert read(keys).shape == CavityShape(Superellipsoid())
    assert found.shape == CavityShape(FreeForm(Superellipsoid(), 3))
    assert list(found.values((0.0, 0.0, 0.0)).values())[9:] == [0.4, *coefficients]


@pytest.mark.parametrize(
    ("profile", "parameters", "turn"),
    [
        (RoundedBox(), [0.001 / 3], [0.0, 0.0, 0.0]),
        # As large as a half-size is not larger than it, once rounded.
        (RoundedBox(), [0.003], [0.1, -1e-7, 2 / 3]),
        (Superellipsoid(), [1 / 7], [0.0, 0.0, -0.2]),
        (FreeForm(RoundedBox(), 2), [0.001, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
        (FreeForm(Superellipsoid(), 3), [1.0, *(np.arange(-6, 6) / 70)], [1e-3, 2e-3, 3e-3]),
    ],
)
def test_what_is_written_is_read_again(
    profile: AbstractProfile, parameters: list[float], turn: list[float]
) -> None:
    shape, values = CavityShape(profile), np.array([*PLACED, *turn, *parameters])
    keys = json.loads(json.dumps(written_shape(shape, values)))  # nothing but what a file can hold
    assert ("turn" in keys) == any(turn) and ("harmonics" in keys) == isinstance(profile, FreeForm)
    found = read(keys)
    assert found.shape == shape
    again = list(found.values(tuple(PLACED[:3])).values())
    np.testing.assert_allclose(again, values, rtol=1e-11, atol=0)
    assert written_centre(shape, values) == ["-17 mm", "33.3333333333 mm", "9 mm"]


def test_a_table_with_more_to_say_inherits_the_keys() -> None:
    class Named(RoundedBoxSettings):
        name: str

    found = Named.model_validate(BOX | {"name": "left"})
    assert found.name == "left" and found.values((0.0, 0.0, 0.0))["fillet"] == 0.001
