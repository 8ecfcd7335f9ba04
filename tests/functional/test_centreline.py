"""Turns and curvatures of chains whose shape is known."""

import jax
import jax.numpy as jnp
import numpy as np

from softfuse.functional.centreline import bending, tip_turn

STRAIGHT = np.stack([np.linspace(0, 0.12, 5), np.zeros(5), np.full(5, 0.01)], axis=1)


def _arc(total: float) -> np.ndarray:
    """The chain of equal links that turns by `total` / 4 at each of its four links, in the x-z plane."""
    heading = total / 4 * np.arange(1, 5)
    steps = 0.03 * np.stack([np.cos(heading), np.zeros(4), -np.sin(heading)], axis=1)
    return STRAIGHT[0] + np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])


def test_each_link_of_an_arc_turns_alike() -> None:
    found = bending(jnp.asarray(_arc(1.6)), jnp.asarray(STRAIGHT))
    np.testing.assert_allclose(found.turn, 0.4, rtol=1e-12)
    np.testing.assert_allclose(found.curvature, 0.4 / 0.03, rtol=1e-12)


def test_what_was_bent_at_rest_does_not_count() -> None:
    found = bending(jnp.asarray(_arc(1.2)), jnp.asarray(_arc(0.8)))
    np.testing.assert_allclose(found.turn[1:], 0.1, rtol=1e-10)


def test_moving_the_chain_sideways_changes_nothing() -> None:
    chain = jnp.asarray(_arc(1.0))
    found = bending(chain + jnp.array([0.1, -0.2, 0.3]), jnp.asarray(STRAIGHT))
    np.testing.assert_allclose(found.turn, 0.25, rtol=1e-10)


def test_a_straight_chain_has_finite_slopes() -> None:
    slope = jax.jacfwd(lambda x: bending(x, jnp.asarray(STRAIGHT)).turn)(jnp.asarray(STRAIGHT))
    assert bool(jnp.all(jnp.isfinite(slope)))


def test_the_tip_turns_by_all_links_of_a_plane_arc_together() -> None:
    np.testing.assert_allclose(tip_turn(jnp.asarray(_arc(2.4)), jnp.asarray(STRAIGHT)), 2.4, rtol=1e-12)
    np.testing.assert_allclose(tip_turn(jnp.asarray(_arc(1.2)), jnp.asarray(_arc(0.8))), 0.4, rtol=1e-10)
