"""Bounds of what is estimated: those of contacts, then of the drives of cables and chambers."""

from pathlib import Path

import numpy as np
import pytest
from made_robots import BEAM, FINGER

from softfuse.estimation.bounds import limits_of
from softfuse.estimation.limits import Limits
from softfuse.robot.file import parse
from softfuse.robot.robot import Robot, build_robot


def built(text: str) -> tuple[Robot, Limits]:
    robot = build_robot(parse(text, Path("made.toml")))
    return robot, limits_of(robot)


def test_sealed_gas_stays_and_each_patch_has_the_largest_force() -> None:
    robot, limits = built(FINGER)
    np.testing.assert_allclose(limits.upper[:4], 5.0)
    np.testing.assert_allclose(limits.lower[:4], 0.0)
    drives = robot.addresses.drives
    for bound, tension in ((limits.lower, 0.0), (limits.upper, 20.0)):
        assert bound[4:][drives["palm"]] == tension
        np.testing.assert_allclose([bound[4:][drives[name]] for name in ("left", "right")], 101325.0)
    # 1e-6 per square of a newton, and of the thousandth of the atmosphere that the gas counts as one.
    np.testing.assert_allclose(limits.regularisation[:4], 1e-6)
    np.testing.assert_allclose(limits.regularisation[4:][drives["left"]], 1e-6 / 101.325**2)
    assert limits.strokes is None and limits.lower.shape == (7,)


def test_driven_gas_has_its_range_and_a_commanded_length_makes_strokes() -> None:
    robot, limits = built(BEAM)
    drives = robot.addresses.drives
    np.testing.assert_allclose(limits.upper[0], 1.0)
    assert (limits.lower[1:][drives["bladder"]], limits.upper[1:][drives["bladder"]]) == (0.0, 20e3)
    assert (limits.lower[1:][drives["palm"]], limits.upper[1:][drives["palm"]]) == (0.0, 10.0)
    assert limits.regularisation[1:][drives["bladder"]] == pytest.approx(1e-6 / 1e3**2)
    assert limits.strokes is not None
    np.testing.assert_array_equal(limits.strokes[1], np.inf)


def test_a_free_force_has_either_sign_along_its_tangents() -> None:
    pushed = BEAM.replace('model = "patch"', 'model = "force"')
    _, limits = built(pushed)
    np.testing.assert_allclose(limits.lower[:3], [0.0, -1.0, -1.0])
    np.testing.assert_allclose(limits.upper[:3], 1.0)
