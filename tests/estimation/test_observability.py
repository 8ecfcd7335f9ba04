"""What the sensors of a robot can tell of one contact."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.estimation.uncertainty import Response, observability, response
from softfuse.functional.chart import facing, moved

AT = facing(np.array([[-12e-3, 3e-3, 0.0], [9e-3, -4e-3, 0.0]]), (0, 0, -1))


@pytest.fixture(scope="module")
def answer(plain_device) -> Response:
    return response(plain_device, AT, 6.0)


def test_slopes_are_those_of_differences(plain_device, volumes_under, answer: Response) -> None:
    def read(place, force):
        return np.asarray(volumes_under(plain_device, jnp.asarray(place)[None], jnp.array([force])))

    for k, place in enumerate(AT):
        np.testing.assert_allclose(answer.reading[k], read(place, 6.0), rtol=1e-9)
        slope = (read(place, 6.001) - read(place, 5.999)) / 2e-3
        np.testing.assert_allclose(answer.by_force[k], slope, rtol=1e-5)
        for axis, along in enumerate(np.eye(2)):
            ends = [read(moved(place, side * 1e-7 * along), 6.0) for side in (-1, 1)]
            expected = (ends[1] - ends[0]) / 2e-7
            np.testing.assert_allclose(
                answer.by_place[k, :, axis], expected, atol=1e-3 * np.abs(expected).max()
            )


def test_two_readings_tell_no_force_and_place_but_with_a_place_they_do(answer: Response) -> None:
    covariance = np.tile(1e-18 * np.eye(2), (2, 1, 1))
    found = observability(answer, covariance, 1e-9)
    np.testing.assert_allclose(found.force_sigma_N, 1e-9 / np.linalg.norm(answer.by_force, axis=1), rtol=1e-6)
    np.testing.assert_allclose(found.place_sigma_m, 1e-9, rtol=1e-3)
    assert np.all(found.singular[:, 2] == 0) and np.all(found.singular[:, 0] > found.singular[:, 1])
    assert np.all(np.isinf(found.blind_force_sigma_N)) and np.all(np.isinf(found.blind_place_sigma_m))


def test_three_readings_place_a_contact_by_themselves() -> None:
    """Slopes that are each other's opposites along the axes: the covariance is known in closed form."""
    by_place = np.array([[[2.0, 0.0], [-2.0, 0.0], [0.0, 5.0], [0.0, -5.0]]])
    answer = Response(np.zeros((1, 4)), np.ones((1, 4)), by_place)
    found = observability(answer, 0.01 * np.eye(4)[None], 1.0)
    np.testing.assert_allclose(found.blind_force_sigma_N, 0.05)
    np.testing.assert_allclose(found.blind_place_sigma_m, [[0.1 / 8**0.5, 0.1 / 50**0.5]])
    joined = (800.0 + 1.0) ** -0.5, (5000.0 + 1.0) ** -0.5
    np.testing.assert_allclose(found.place_sigma_m, [joined])
    np.testing.assert_allclose(found.singular, [np.sort([20.0, 8**0.5 / 100, 50**0.5 / 100])[::-1]])
    noisier = observability(replace(answer), 0.04 * np.eye(4)[None], 1.0)
    np.testing.assert_allclose(noisier.singular, 0.5 * found.singular)
