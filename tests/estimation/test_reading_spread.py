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


@pytest.fixture
def spread() -> ReadingSpread:
    """Bilinear in x and y, of two readings, three parameters."""
    x, y = np.array([-1.0, 0.0, 2.0]), np.array([0.0, 1.0])
    return ReadingSpread(x, y, _bilinear(x[:, None], y[None]))


def _bilinear(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    base = np.arange(1.0, 7.0).reshape(2, 3)
    return base * (1 + 0.1 * x - 0.3 * y + 0.2 * x * y)[..., None, None]


def test_it_is_that_of_the_grid_and_linear_between(spread: ReadingSpread) -> None:
    places = facing(np.array([[0.5, 0.25, 0.0]]), (0, 0, -1))
    a = _bilinear(*places[0, 0, :2])
    np.testing.assert_allclose(spread.covariance(places, np.array([3.0])), 9 * a @ a.T)
    beyond, border = facing(np.array([[[9.0, -4.0, 0.0]], [[2.0, 0.0, 0.0]]]), (0, 0, -1))
    np.testing.assert_allclose(
        spread.covariance(beyond, np.array([3.0])), spread.covariance(border, np.array([3.0]))
    )


def test_contacts_share_parameters(spread: ReadingSpread) -> None:
    places = facing(np.array([[0.5, 0.25, 0.0]] * 2), (0, 0, -1))
    one = spread.covariance(places[:1], np.array([4.0]))
    np.testing.assert_allclose(spread.covariance(places, np.array([1.0, 3.0])), one)


def test_a_file_is_read_as_written(spread: ReadingSpread, tmp_path: Path) -> None:
    path = tmp_path / "fitted.npz"
    write_spread(path, spread, names=np.array(["stiffness"]))
    again = read_spread(path, 2)
    for name in ("x_m", "y_m", "by_parameters"):
        np.testing.assert_array_equal(getattr(again, name), getattr(spread, name))
    with pytest.raises(SoftfuseError, match=r"fitted.npz: no spread of 4 readings over a grid"):
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


def test_a_stiffness_that_is_not_known_makes_all_readings_err_alike() -> None:
    reading, nothing = np.array([-3.0, 40.0]), np.zeros(2)
    covariance = ModelError(alike=0.2).covariance(reading, nothing, np.zeros((1, 3, 3)), np.ones(1))
    np.testing.assert_allclose(covariance, 0.04 * np.outer(reading, reading))
