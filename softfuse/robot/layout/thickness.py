"""How thick the walls of a layout are: the least distances between cavities and what is next to them.

Convex bodies A and B are separated by

    d = max over unit n of  −reach_B(−n) − reach_A(n),     reach(n) = max n · x,

their distance where they do not meet, minus the depth at which they overlap where they do. A face of the
outline has one n only. The derivative of a maximum is that at the n where it is found (Danskin's theorem), so
d is differentiable in the parameters, but for a kink where two parallel flat faces begin to turn against each
other. Cavities that are not convex count as their convex hulls, which makes walls thinner than they are,
never thicker. Source: S. Cameron, R. Culley, IEEE Int. Conf. Robotics and Automation, 1986, DOI
10.1109/ROBOT.1986.1087645.
"""

from collections.abc import Callable, Sequence
from itertools import combinations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.mesh.block import NORMALS, SIDES
from softfuse.robot.layout.cavity_shape import CavityShape, rotation
from softfuse.robot.layout.cube_sphere import cube_sphere
from softfuse.robot.layout.direction_search import greatest, polished
from softfuse.robot.layout.layout import AbstractLayout

Reach = Callable[[Float[Array, "m 3"]], Float[Array, " m"]]
"""How far (m,) [m] a body reaches along unit vectors (m, 3)."""

_CELLS = 6
"""Along an edge of the cube through whose grid the search for the nearest places is begun."""

_PARALLEL = 1e-9
"""Sine below which two axes are one."""


def wall_names(layout: AbstractLayout) -> tuple[str, ...]:
    """What each thickness (t,) of `wall_thicknesses` is between: "cavity 0, high z", "cavity 0, notch 1",
    "cavity 0, cavity 1".
    """
    cavities = range(len(layout.shapes))
    sides = [f"cavity {k}, {side}" for k in cavities for side in SIDES]
    notches = [f"cavity {k}, notch {j}" for k in cavities for j in range(len(layout.outline.notches))]
    return (*sides, *notches, *(f"cavity {j}, cavity {k}" for j, k in combinations(cavities, 2)))


def wall_thicknesses(layout: AbstractLayout, theta: Float[Array, " p"]) -> Float[Array, " t"]:
    """Thicknesses (t,) [m] of all walls with parameters (p,), negative where a cavity reaches through;
    differentiable once.
    """
    values = layout.values(theta)
    bodies = list(zip(layout.shapes, values, strict=True))
    sides = [layout.outline.offsets - shape.reach(v, jnp.asarray(NORMALS)) for shape, v in bodies]

    def to_notch(first: CavityShape, _: CavityShape):
        def gap(v, corners):
            own = rotation(v[6:9]).T
            box = _box(corners[0], corners[1])
            return separation(_reach_of(first, v), box, jnp.concatenate([own, jnp.eye(3)]))

        return gap

    def to_cavity(first: CavityShape, second: CavityShape):
        def gap(v, w):
            axes = jnp.concatenate([rotation(v[6:9]).T, rotation(w[6:9]).T])
            return separation(_reach_of(first, v), _reach_of(second, w), axes)

        return gap

    corners = [jnp.asarray(box) for box in layout.outline.notches]
    notches = [(k, k, values[k], box) for k in range(len(bodies)) for box in corners]
    pairs = [(j, k, values[j], values[k]) for j, k in combinations(range(len(bodies)), 2)]
    parts = [*sides, _together(layout.shapes, notches, to_notch), _together(layout.shapes, pairs, to_cavity)]
    return jnp.concatenate([jnp.zeros(0), *parts])


def clearances(
    layout: AbstractLayout, theta: Float[Array, " p"], points: Float[Array, "m 3"]
) -> Float[Array, " c"]:
    """How far (c,) [m] points (m, 3) m are from each cavity with parameters (p,), all points of the first
    one first; negative inside. Differentiable once in both.
    """

    def apart(shape: CavityShape, values: Array) -> Float[Array, " m"]:
        def gap(point):
            return separation(
                _reach_of(shape, values), lambda normals: normals @ point, rotation(values[6:9]).T
            )

        return jax.vmap(gap)(points)

    parts = zip(layout.shapes, layout.values(theta), strict=True)
    return jnp.concatenate([jnp.zeros(0), *(apart(*part) for part in parts)])


def _together(
    shapes: Sequence[CavityShape],
    pairs: Sequence[tuple[int, int, Float[Array, "..."], Float[Array, "..."]]],
    gap: Callable[[CavityShape, CavityShape], Callable[[Array, Array], Array]],
) -> Float[Array, " g"]:
    """gap(shapes[j], shapes[k])(a, b) (g,) of pairs (j, k, a, b), those of the same kinds in one program."""
    kinds: dict[object, list[int]] = {}
    for at, (j, k, _, _) in enumerate(pairs):
        kinds.setdefault((jax.tree.structure(shapes[j]), jax.tree.structure(shapes[k])), []).append(at)
    result = jnp.zeros(len(pairs))
    for members in kinds.values():
        j, k, _, _ = pairs[members[0]]
        first, second = (jnp.stack([pairs[at][side] for at in members]) for side in (2, 3))
        gaps = jax.vmap(gap(shapes[j], shapes[k]))(first, second)
        result = result.at[np.array(members)].set(gaps)
    return result


def slacks(layout: AbstractLayout, theta: Float[Array, " p"]) -> Float[Array, " s"]:
    """What must not be negative (s,) [m] for the cavities to exist with parameters (p,), such as the room for
    their fillets; differentiable.
    """
    parts = zip(layout.shapes, layout.values(theta), strict=True)
    return jnp.concatenate([jnp.zeros(0), *(shape.slack(values) for shape, values in parts)])


def separation(first: Reach, second: Reach, axes: Float[Array, "a 3"]) -> Float[Array, ""]:
    """Distance [m] between two bodies, minus the depth of their overlap; differentiable once.

    axes (a, 3): unit vectors along the edges that the bodies may have, across which their reaches have kinks.
    """

    def apart(normals):
        flat = normals.reshape(-1, 3)
        return (-second(-flat) - first(flat)).reshape(normals.shape[:-1])

    # Faces are nearest along their normals, edges along what is across both.
    first_axis, second_axis = np.triu_indices(len(axes), 1)
    across = jnp.cross(axes[first_axis], axes[second_axis])
    length = jnp.linalg.norm(across, axis=1, keepdims=True)
    across = jnp.where(length > _PARALLEL, across / jnp.maximum(length, _PARALLEL), axes[first_axis])
    begin = jnp.concatenate([jnp.asarray(cube_sphere(_CELLS)[0]), axes, -axes, across, -across])
    start = begin[jnp.argmax(apart(jax.lax.stop_gradient(begin)))]
    nearest = polished(apart, greatest(apart, start[None], axes)[0])
    return apart(nearest[None])[0]


def _reach_of(shape: CavityShape, values: Float[Array, " v"]) -> Reach:
    return lambda normals: shape.reach(values, normals)


def _box(low: Float[Array, "3"], high: Float[Array, "3"]) -> Reach:
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    return lambda normals: normals @ middle + jnp.abs(normals) @ half
