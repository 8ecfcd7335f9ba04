"""Columns of robots of several kinds, and what they say."""

from collections.abc import Callable
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.estimation.stream import Estimate
from softfuse.estimation.tracked import Tracked
from softfuse.report.columns import Column, Columns
from softfuse.robot.file import load
from softfuse.robot.robot import Robot, build_robot
from softfuse.sensors.status import Status


@pytest.fixture(scope="module")
def robot(linear_finger: Callable[..., Path]) -> Robot:
    return build_robot(load(linear_finger()))


@pytest.fixture(scope="module")
def columns(robot: Robot) -> Columns:
    return Columns(robot)


def tracked(robot: Robot, **changed) -> Tracked:
    """Two contacts, the first at an electrode with 3 N, the second with 1 N at another."""
    places = np.stack([robot.settings.places[name] for name in ("tip left", "base palm")])
    readings = robot.model.n_readings
    given = {
        "time_s": 0.5,
        "touching": np.array([True, True]),
        "location_m": places[:, 0],
        "location_sigma_m": np.array([[3e-3, 4e-3], [1e-3, 1e-3]]),
        "contact_force_N": np.array([3.0, 1.0]),
        "force_covariance_N2": np.diag([0.04, 0.09]),
        "places": places,
        "covariance": np.zeros((4, 4)),
        "attached": np.zeros(7),
        "reading": np.full(readings, 2e-3),
        "sigma": np.full(readings, 1e-3),
        "valid": np.ones(readings, bool),
        "misfit": np.full(readings, 1e-3),
        "evidence": None,
        "details": {},
        "statuses": (Status.ok,),
        "latency_s": 0.1,
    }
    return Tracked(**(given | changed))


def told(columns: Columns, robot: Robot, now: Tracked) -> dict[str, float | str]:
    """The values by the columns' names, in the state at rest."""
    values = columns.read(Estimate(now, None, robot.model.rest_state(jnp.asarray(now.places))))
    return dict(zip((column.name for column in columns.columns), values, strict=True))


def test_names_are_derived_from_those_of_the_parts(columns: Columns) -> None:
    names = [column.name for column in columns.columns]
    assert names[:9] == [
        *("contacts", "x_mm", "y_mm", "z_mm", "force_N"),
        *("x_sigma_mm", "y_sigma_mm", "z_sigma_mm", "force_sigma_N"),
    ]
    assert names[9:15] == [
        *("hand0_place", "hand0_x_mm", "hand0_y_mm", "hand0_z_mm", "hand0_force_N", "hand0_force_sigma_N"),
    ]
    for name in ("palm_mm", "palm_N", "tip_left_Pa", "pressure_tip_left_Pa", "pressure_tip_left_misfit_Pa"):
        assert name in names
    assert {"cable_palm_mm", "p3_z_mm", "bend0_deg", "curvature3_1_m", "tip_bend_deg"} <= set(names)
    assert names[-1] == "residual" and len(set(names)) == len(names)


def test_contacts_are_told_together_and_alone(columns: Columns, robot: Robot) -> None:
    said = told(columns, robot, tracked(robot))
    assert said["contacts"] == 2 and said["force_N"] == 4.0
    assert said["force_sigma_N"] == pytest.approx(np.sqrt(0.13))
    np.testing.assert_allclose([said[f"{axis}_mm"] for axis in "xyz"], [84.0, 7.5, 7.5])
    # An electrode on the left lies along x and z, one on the palm along x and y.
    left, palm = 0.75 * np.array([3, 0, 4]), 0.25 * np.array([1, 1, 0])
    np.testing.assert_allclose([said[f"{axis}_sigma_mm"] for axis in "xyz"], np.hypot(left, palm), atol=1e-9)
    assert (said["hand0_place"], said["hand1_place"]) == ("tip left", "base palm")
    assert said["hand0_force_N"] == 3.0 and said["hand1_force_sigma_N"] == pytest.approx(0.3)
    assert said["cable_palm_mm"] == pytest.approx(2.0) and said["cable_palm_misfit_mm"] == pytest.approx(1.0)
    assert said["residual"] == pytest.approx(1.0) and said["p0_x_mm"] == pytest.approx(117.0)
    assert said["palm_mm"] == pytest.approx(0.0, abs=1e-9) and said["tip_left_Pa"] == pytest.approx(
        0.0, abs=1e-6
    )


def test_what_does_not_touch_or_count_is_not_told(columns: Columns, robot: Robot) -> None:
    none = np.zeros(2, bool)
    now = tracked(
        robot,
        touching=none,
        location_m=np.full((2, 3), np.nan),
        contact_force_N=np.zeros(2),
        valid=np.zeros(robot.model.n_readings, bool),
        misfit=np.full(robot.model.n_readings, np.nan),
    )
    said = told(columns, robot, now)
    assert said["contacts"] == 0 and said["force_N"] == 0.0 and said["hand0_place"] == ""
    for name in ("x_mm", "hand0_x_mm", "pressure_tip_left_Pa", "pressure_tip_left_misfit_Pa", "residual"):
        assert np.isnan(said[name])


def test_a_shape_that_was_lost_is_not_told(columns: Columns, robot: Robot) -> None:
    now = tracked(robot, statuses=(Status.inverted,))
    said = told(columns, robot, now)
    assert np.isnan([said["p0_x_mm"], said["palm_mm"], said["tip_bend_deg"]]).all()
    places, forces = columns.contacts(Estimate(now, None, robot.model.rest_state(jnp.asarray(now.places))))
    assert np.isnan(places).all() and np.isnan(forces).all()


def test_forces_press_into_the_body(columns: Columns, robot: Robot) -> None:
    now = tracked(robot)
    places, forces = columns.contacts(Estimate(now, None, robot.model.rest_state(jnp.asarray(now.places))))
    np.testing.assert_allclose(places, 1e-3 * np.array([[108, 10, 10], [12, 0, 0]]), atol=1e-9)
    np.testing.assert_allclose(forces, [[0, -3, 0], [0, 0, 1]], atol=1e-9)


def test_columns_of_a_disc_and_vents(coarse: Path) -> None:
    robot = build_robot(load(coarse))
    columns = Columns(robot)
    names = [column.name for column in columns.columns]
    assert names[9:] == [
        *(f"{name}_mm3" for name in ("minus_minus", "minus_plus", "plus_minus", "plus_plus")),
        *(
            f"flow_{a}_{b}{of}_mm3"
            for a in ("minus", "plus")
            for b in ("minus", "plus")
            for of in ("", "_misfit")
        ),
        "residual",
    ]


@pytest.mark.parametrize(
    ("value", "written"), [(1.23456, "1.235"), (-0.0001, "0.000"), (np.nan, ""), (np.inf, ""), (2, "2.000")]
)
def test_numbers_are_written_to_what_is_worth_it(value: float, written: str) -> None:
    assert Column("a_mm", 3).written(value) == written
    assert Column("place", None).written("tip left") == "tip left"
