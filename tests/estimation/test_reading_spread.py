"""How uncertain readings are: interpolated over places, and what of it gets into forces."""

from pathlib import Path

import numpy as np
import pytest

from softfuse.errors import SoftfuseError
from softfuse.estimation.model_error import (
    ModelError,
    ReadingSpread,
    missed,
    read_spread,
    whitening,
    write_spread,
)
from softfuse.functional.chart import facing
from softfuse.functional.workspace import framed


@pytest.fixture
def spread() -> ReadingSpread:
    """Linear in x and y, of two readings, three parameters, at 60 points in no order."""
    points = np.random.default_rng(3).uniform([-1.0, 0.0, 0.0], [2.0, 1.0, 0.0], (60, 3))
    return ReadingSpread(points, _linear(points))


def _linear(points: np.ndarray) -> np.ndarray:
    base = np.arange(1.0, 7.0).reshape(2, 3)
    return base * (1 + 0.1 * points[..., 0] - 0.3 * points[..., 1])[..., None, None]


def test_what_is_linear_between_points_is_told_exactly(spread: ReadingSpread) -> None:
    for at in ([0.5, 0.25, 0.0], [-0.9, 0.95, 0.0]):
        places = facing(np.array([at]), (0, 0, -1))
        a = _linear(places[0, 0])
        np.testing.assert_allclose(spread.covariance(places, np.array([3.0])), 9 * a @ a.T, rtol=1e-4)
    unknown = np.full((1, 3, 3), np.nan)
    assert not spread.covariance(unknown, np.array([3.0])).any()


def test_it_is_told_on_a_ball_within_what_curves() -> None:
    """200 points on a ball of 30 mm, some 8 mm apart; what is told is the x coordinate."""
    points = np.random.default_rng(1).normal(size=(200, 3))
    points *= 30e-3 / np.linalg.norm(points, axis=1, keepdims=True)
    spread = ReadingSpread(points, points[:, :1, None])
    normals = np.random.default_rng(2).normal(size=(50, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    told = [spread.covariance(place[None], np.ones(1)) for place in framed(30e-3 * normals, normals)]
    np.testing.assert_allclose(np.sqrt(told).ravel(), np.abs(30e-3 * normals[:, 0]), atol=2e-3)


def test_points_in_a_row_tell_what_is_along_it() -> None:
    points = np.linspace(0.0, 1.0, 6)[:, None] * np.array([1.0, 0.0, 0.0])
    spread = ReadingSpread(points, _linear(points))
    places = facing(np.array([[0.5, 0.3, 0.0]]), (0, 0, -1))
    a = _linear(np.array([0.5, 0.0, 0.0]))
    np.testing.assert_allclose(spread.covariance(places, np.ones(1)), a @ a.T, rtol=1e-3)


def test_contacts_share_parameters(spread: ReadingSpread) -> None:
    places = facing(np.array([[0.5, 0.25, 0.0]] * 2), (0, 0, -1))
    one = spread.covariance(places[:1], np.array([4.0]))
    np.testing.assert_allclose(spread.covariance(places, np.array([1.0, 3.0])), one)


def test_a_file_is_read_as_written(spread: ReadingSpread, tmp_path: Path) -> None:
    path = tmp_path / "fitted.npz"
    write_spread(path, spread, names=np.array(["stiffness"]))
    again = read_spread(path, 2)
    for name in ("points_m", "by_parameters"):
        np.testing.assert_array_equal(getattr(again, name), getattr(spread, name))
    with pytest.raises(SoftfuseError, match=r"fitted.npz: no spread of 4 readings over points"):
        read_spread(path, 4)
    for wrong in (b"", b"PK\x03\x04 cut", b"text"):
        path.write_bytes(wrong)
        with pytest.raises(SoftfuseError, match=r"fitted.npz: holds no spread of readings"):
            read_spread(path, 2)


def test_whitening_makes_errors_standard_normal(spread: ReadingSpread) -> None:
    error = ModelError(0.05, spread=spread)
    reading, sigma = np.array([-3.0, 40.0]), np.array([0.2, 0.3])
    place = facing(np.array([[0.5, 0.25, 0.0]]), (0, 0, -1))
    covariance = error.covariance(reading, sigma, place, np.array([2.0]))
    apart = covariance - spread.covariance(place, np.array([2.0]))
    np.testing.assert_allclose(apart, np.diag(sigma**2 + missed(reading, 0.05) ** 2))
    white = whitening(covariance, np.ones(2, bool))
    np.testing.assert_allclose(white @ covariance @ white.T, np.eye(2), atol=1e-12)
    part = whitening(covariance, np.array([True, False]))
    np.testing.assert_allclose(part, [[covariance[0, 0] ** -0.5, 0.0], [0.0, 0.0]])


def test_a_small_reading_is_missed_as_one_of_the_floor() -> None:
    found = missed(np.array([-3.0, 40.0, 0.0]), 0.1, floor=0.5)
    np.testing.assert_allclose(found, 0.1 * np.hypot([3.0, 40.0, 0.0], 20.0))


def test_a_stiffness_that_is_not_known_makes_all_readings_err_alike() -> None:
    reading, nothing = np.array([-3.0, 40.0]), np.zeros(2)
    covariance = ModelError(alike=0.2).covariance(reading, nothing, np.zeros((1, 3, 3)), np.ones(1))
    np.testing.assert_allclose(covariance, 0.04 * np.outer(reading, reading))
