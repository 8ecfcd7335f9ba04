"""The search finds what is least within walls and limits, mesh after mesh, and goes on where it stopped."""

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.design.limits import Limit, room, room_slopes
from softfuse.design.objective import Sensitivity, Softness, Unevenness
from softfuse.design.problem import Geometry, Problem, Value, Walls
from softfuse.design.search import Search, SearchSettings, Trial
from softfuse.robot.layout.thickness import wall_thicknesses

LEAST_M = 0.004


@dataclass
class Known:
    """A problem whose measures are known functions of θ over scales x: |x − aim|² + 1, and the sum of x."""

    layout: Any
    limits: tuple[Limit, ...]
    aim: np.ndarray
    reach: float = np.inf
    walls: Walls = Walls(LEAST_M, {})
    meshes: int = 0
    values: int = 0

    @property
    def __class__(self):
        """It is checked as what it stands in for."""
        return Problem

    def on_mesh(self, theta):
        self.meshes += 1
        return KnownOnMesh(self, theta)


@dataclass
class KnownOnMesh:
    """Worn where x is too far from where the mesh was made."""

    problem: Known
    made_at: np.ndarray

    @property
    def mesh(self):
        return self

    def worn(self, theta) -> bool:
        scale = self.problem.layout.scale
        return bool(np.abs((theta - self.made_at) / scale).max() > self.problem.reach)

    def remade(self, theta):
        return self.problem.on_mesh(theta)

    def value(self, theta) -> Value:
        self.problem.values += 1
        scale = self.problem.layout.scale
        away = theta / scale - self.problem.aim
        measures = np.array([away @ away + 1.0, np.sum(theta / scale)])
        slopes = np.array([2.0 * away / scale, 1.0 / scale])
        return Value(measures[: 1 + len(self.problem.limits)], slopes[: 1 + len(self.problem.limits)])


@pytest.fixture(scope="module")
def geometry(twins) -> Geometry:
    """Walls of 4 mm, compiled once."""
    return Geometry(twins, Walls(LEAST_M, {}))


SETTINGS = SearchSettings(legs=20, iterations=30, move=2.0, improvement=1e-9)


@pytest.mark.slow
def test_the_aim_is_found_where_it_can_be_made(twins, geometry) -> None:
    aim = twins.start / twins.scale + 0.3
    problem: Any = Known(twins, (), aim)
    found = Search(problem, geometry, SETTINGS).run(twins.start)
    assert found.kept
    np.testing.assert_allclose(found.best.theta / twins.scale, aim, atol=1e-4)


def test_limits_are_kept_and_met(twins, geometry) -> None:
    aim = twins.start / twins.scale + 0.3
    least = float(np.sum(aim)) + 1.0
    problem = Known(twins, (Limit(Sensitivity(), at_least=least),), aim)
    found = Search(problem, geometry, SETTINGS).run(twins.start)
    assert found.kept and found.best.value is not None
    assert found.best.value.measures[1] == pytest.approx(least, rel=1e-4)
    # The nearest point of the plane.
    np.testing.assert_allclose(found.best.theta / twins.scale, aim + 1.0 / len(aim), atol=1e-3)


def test_walls_are_kept(twins, geometry) -> None:
    # Wider by far than the block allows.
    aim = twins.start / twins.scale
    aim = aim + 20.0 * (np.array(twins.names) == "width")
    found = Search(Known(twins, (), aim), geometry, SETTINGS).run(twins.start)
    assert found.kept
    thinnest = float(wall_thicknesses(twins, jnp.asarray(found.best.theta)).min())
    assert thinnest == pytest.approx(LEAST_M, abs=1e-5)


def test_where_a_mesh_is_worn_another_one_goes_on(twins, geometry) -> None:
    aim = twins.start / twins.scale + np.linspace(-1.2, 1.2, len(twins.names))
    problem = Known(twins, (), aim, reach=0.5)
    tried: list[Trial] = []
    found = Search(problem, geometry, SETTINGS, seen=tried.append).run(twins.start)
    assert problem.meshes > 2
    assert any(trial.value is None for trial in tried)
    np.testing.assert_allclose(found.best.theta / twins.scale, aim, atol=1e-3)


def test_a_search_that_is_begun_again_computes_nothing_twice(twins, geometry) -> None:
    aim = twins.start / twins.scale + np.linspace(-1.2, 1.2, len(twins.names))
    whole: list[Trial] = []
    first = Known(twins, (), aim, reach=0.5)
    found = Search(first, geometry, SETTINGS, seen=whole.append).run(twins.start)
    for kept in (len(whole), len(whole) // 2):
        again = Known(twins, (), aim, reach=0.5)
        seen: list[Trial] = []
        second = Search(again, geometry, SETTINGS, known=whole[:kept], seen=seen.append).run(twins.start)
        np.testing.assert_array_equal(second.best.theta, found.best.theta)
        assert len(seen) == len(whole)
        assert again.values == sum(trial.value is not None for trial in whole[kept:])


def test_the_room_within_limits_is_in_parts_of_them() -> None:
    limits = (
        Limit(Unevenness(), at_least=2.0, at_most=4.0),
        Limit(Sensitivity()),
        Limit(Softness(), at_most=8.0),
    )
    np.testing.assert_allclose(room(limits, np.array([1.0, 7.0, 10.0])), [-0.5, 0.75, -0.25])
    slopes = room_slopes(limits, np.array([[1.0, 0.0], [5.0, 5.0], [0.0, 2.0]]))
    np.testing.assert_allclose(slopes, [[0.5, 0.0], [-0.25, 0.0], [0.0, -0.25]])
