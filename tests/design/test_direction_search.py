"""Greatest directions of functions whose maxima are known."""

import jax
import jax.numpy as jnp
import numpy as np

from softfuse.robot.layout.direction_search import greatest, polished

AIM = jnp.array([[0.36, -0.48, 0.8], [0.0, 0.6, -0.8]])


def test_smooth_functions_are_brought_to_their_maxima() -> None:
    stretched = jnp.array([1.0, 4.0, 9.0])

    def value(n):
        return -jnp.sum(stretched * (n - AIM[:, None]) ** 2, axis=-1)

    found = greatest(value, jnp.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]))
    np.testing.assert_allclose(found, AIM, atol=1e-6)
    np.testing.assert_allclose(polished(lambda n: value(n[None])[0], found[0]), AIM[0], atol=1e-12)


def test_ridges_are_followed_in_their_planes() -> None:
    # Along the ridge n_x = 0 the maximum is at (0, 0.6, −0.8), across it the function falls off steeply.
    def value(n):
        return n @ AIM[1] - 100.0 * jnp.abs(n[..., 0])

    start = jnp.array([[0.05, 1.0, 0.0]])
    found = greatest(value, start / jnp.linalg.norm(start), jnp.eye(3))
    np.testing.assert_allclose(found[0], AIM[1], atol=1e-6)


def test_an_axis_across_a_plane_is_left_as_it_is() -> None:
    found = greatest(lambda n: n[..., 2], jnp.array([[0.0, 0.0, 1.0]]), jnp.eye(3))
    np.testing.assert_allclose(found, [[0.0, 0.0, 1.0]], atol=1e-12)


def test_nothing_is_differentiated_through_the_search() -> None:
    def best(scale):
        return greatest(lambda n: scale * n @ AIM[0], AIM[1:])[0, 0]

    assert jax.grad(best)(2.0) == 0.0
