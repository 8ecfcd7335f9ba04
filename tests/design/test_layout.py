"""Layouts: values that follow parameters, ties, a user's own parametrisation, and what is told."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.errors import MeshError, SoftfuseError
from softfuse.mesh.block import NO_BOXES, Block
from softfuse.robot.layout.cavity_shape import CavityShape
from softfuse.robot.layout.layout import AbstractLayout, Parameter, TiedLayout
from softfuse.robot.layout.profile import RoundedBox, Superellipsoid

OUTLINE = Block(np.zeros(3), np.array([0.08, 0.04, 0.02]), NO_BOXES, NO_BOXES, ((), (), ()))
BOX = CavityShape(RoundedBox())
DRAWN = {"x": 0.03, "y": 0.02, "z": 0.01, "half x": 0.01, "half y": 0.008, "half z": 0.003, "fillet": 0.001}
WIDTH = Parameter("width", 0.01, 0.005, 0.012, adds={(0, "half x"): 1.0, (1, "half x"): 1.0, (1, "x"): -2.0})


def test_parameters_add_to_what_is_drawn() -> None:
    top = Parameter("membrane", 0.007, 0.002, 0.01, scale=1e-4, adds={(0, "z"): -1.0})
    layout = TiedLayout.of(OUTLINE, [(BOX, DRAWN), (BOX, {**DRAWN, "x": 0.06, "turn z": 0.5})], [WIDTH, top])
    first, second = layout.values(jnp.asarray(layout.start))
    np.testing.assert_allclose(first, [0.03, 0.02, 0.01, 0.01, 0.008, 0.003, 0, 0, 0, 0.001])
    np.testing.assert_allclose(np.asarray(second)[[0, 8]], [0.06, 0.5])
    first, second = layout.values(jnp.array([0.011, 0.005]))
    np.testing.assert_allclose(first, [0.03, 0.02, 0.012, 0.011, 0.008, 0.003, 0, 0, 0, 0.001])
    np.testing.assert_allclose(np.asarray(second)[[0, 2, 3]], [0.058, 0.01, 0.011])
    assert layout.names == ("width", "membrane")
    np.testing.assert_allclose(layout.scale, [7e-4, 1e-4])
    np.testing.assert_allclose((layout.lower, layout.upper), ([0.005, 0.002], [0.012, 0.01]))


class Ring(AbstractLayout):
    """Three balls on a circle: its radius and their angle are free."""

    outline: Block = eqx.field(static=True, default=OUTLINE)
    shapes: tuple[CavityShape, ...] = (CavityShape(Superellipsoid()),) * 3
    parameters: tuple[Parameter, ...] = eqx.field(
        static=True,
        default=(Parameter("radius", 0.012, 0.01, 0.014), Parameter("angle", 0.0, -1.0, 1.0, "rad")),
    )

    def values(self, theta):
        angles = theta[1] + 2 * jnp.pi / 3 * jnp.arange(3)
        rest = jnp.array([0.01, 0.003, 0.003, 0.003, 0.0, 0.0, 0.0, 1.0])
        middle = jnp.array([0.04, 0.02])
        return tuple(
            jnp.concatenate([middle + theta[0] * jnp.stack([jnp.cos(a), jnp.sin(a)]), rest]) for a in angles
        )


def test_a_parametrisation_may_be_the_users_own() -> None:
    ring, along = Ring(), [np.eye(3)] * 3

    @jax.jit
    def tips(theta):
        return jnp.stack(ring.points(theta, along))

    points = tips(jnp.array([0.012, 0.1]))
    angle = 0.1 + 2 * np.pi / 3
    np.testing.assert_allclose(
        points[1, 0], [0.04 + 0.012 * np.cos(angle) + 0.003, 0.02 + 0.012 * np.sin(angle), 0.01], rtol=1e-12
    )
    slope = jax.jacrev(tips)(jnp.array([0.012, 0.1]))
    np.testing.assert_allclose(slope[1, 2, :, 0], [np.cos(angle), np.sin(angle), 0.0], atol=1e-12)


@pytest.mark.parametrize(
    ("cavity", "parameter", "said"),
    [
        ({**DRAWN, "depth": 1.0}, WIDTH, "cavity 0 has no 'depth'"),
        ({k: v for k, v in DRAWN.items() if k != "fillet"}, WIDTH, "cavity 0 lacks 'fillet'"),
        (DRAWN, WIDTH, "cavity 1, which does not exist"),
        (DRAWN, Parameter("size", 0.1, 0.0, 0.05), '"size" starts at 0.1 m, outside its bounds 0 to 0.05'),
        (DRAWN, Parameter("size", 0.1, 0.1, 0.1), '"size" cannot change'),
    ],
)
def test_what_does_not_fit_is_told(cavity, parameter, said) -> None:
    with pytest.raises(SoftfuseError, match=said):
        TiedLayout.of(OUTLINE, [(BOX, cavity)], [parameter])


def test_an_outline_without_volume_is_told() -> None:
    flat = Block(np.zeros(3), np.ones(3), NO_BOXES, np.array([[[0.0, 0, 0], [1.0, 0, 1.0]]]), ((), (), ()))
    with pytest.raises(MeshError, match="notch 0 has no volume"):
        TiedLayout.of(flat, [], [])
