"""Volumes that follow each other are one reading of a reduced body, in a joint reading too."""

import jax.numpy as jnp
import pytest

from softfuse.functional.cavity import Cavity
from softfuse.mechanics.reading import AbstractReading, AnswerReading, JointReading, ShapeReading
from softfuse.rom.reduced_model import volume_readings

FIRST, SECOND, THIRD = (Cavity(jnp.array([[k, k + 1, k + 2]])) for k in range(3))
VOLUMES = tuple(ShapeReading(cavity) for cavity in (FIRST, SECOND, THIRD))
PRESSURE = AnswerReading((0,))


@pytest.mark.parametrize(
    "readings",
    [
        (VOLUMES[0], VOLUMES[1], PRESSURE, VOLUMES[2]),
        (JointReading(VOLUMES[:2]), PRESSURE, VOLUMES[2]),
        (JointReading((JointReading(VOLUMES[:2]), PRESSURE)), JointReading(VOLUMES[2:])),
    ],
)
def test_volumes_are_told_apart_and_joined(readings: tuple[AbstractReading, ...]) -> None:
    found = [([*map(id, cavities)], id(reading)) for cavities, reading in volume_readings(readings)]
    assert found == [
        ([id(FIRST), id(SECOND)], id(VOLUMES[0])),
        ([], id(PRESSURE)),
        ([id(THIRD)], id(VOLUMES[2])),
    ]
