"""Outlines tell apart what makes other programs, and trees are found again from them."""

import json
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.estimation.kept_programs import Packing, outline, tree_of
from softfuse.estimation.limits import Limits
from softfuse.estimation.step import Observation
from softfuse.functional.chart import facing, moved
from softfuse.sensors.status import Status

ONE = jax.ShapeDtypeStruct((3,), jnp.float64)


def test_a_tree_is_found_again():
    tree = {
        "seen": Observation(ONE, ONE, None),
        "packed": (Packing({"a": ONE}), [1, 2.5, "x", True, None]),
        Status.ok: jax.ShapeDtypeStruct((), jnp.int32, weak_type=True),
    }
    again = tree_of(json.loads(json.dumps(outline(tree))))
    assert outline(again) == outline(tree)
    assert isinstance(again["seen"], Observation)
    assert again["packed"][0].like == {"a": ONE}
    assert again[Status.ok].weak_type


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (1, 1.0),
        (1, True),
        ((ONE, None), (None, ONE)),
        ((ONE,), [ONE]),
        (ONE, jax.ShapeDtypeStruct((4,), jnp.float64)),
        (ONE, jax.ShapeDtypeStruct((3,), jnp.float32)),
        (ONE, jax.ShapeDtypeStruct((3,), jnp.float64, weak_type=True)),
        (jnp.zeros(3), jnp.array([0.0, 0.0, 1e-300])),
        (jnp.zeros(3), np.zeros(3)),
        (np.zeros(3), np.zeros((3, 1))),
        (np.float64(1), np.float64(2)),
        (Observation(ONE, ONE, None), Limits(ONE, ONE, None)),
        (Limits(ONE, ONE, ONE, motion=ONE), Limits(ONE, ONE, ONE, place=ONE)),
        (facing, moved),
        (Status.ok, Status.lagging),
        ({"a": 1}, {"b": 1}),
    ],
)
def test_what_makes_another_program_has_another_outline(one, other):
    assert json.dumps(outline(one)) != json.dumps(outline(other))


class Elsewhere(eqx.Module):
    """A class that is not softfuse's."""

    x: int = 0


@pytest.mark.parametrize(
    "thing", [Elsewhere(), (1, [Elsewhere]), lambda: 0, np.sum, partial(moved), {1}, object(), 1j]
)
def test_what_might_change_unseen_has_none(thing):
    with pytest.raises(TypeError, match="softfuse itself|has no outline"):
        outline(thing)


@pytest.mark.parametrize(
    "wrong",
    [
        {"class": "subprocess:Popen", "holds": []},
        {"one of": "os:name", "is": "x"},
        {"class": "softfuse.estimation.kept_programs:outline", "holds": []},
        {"something": 1},
    ],
)
def test_nothing_else_is_made_of_an_outline(wrong):
    with pytest.raises(ValueError, match="is not a class|no outline"):
        tree_of(wrong)
