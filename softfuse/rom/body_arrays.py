"""A reduced body as named arrays, so that it can be kept in a file, and back.

What it shares with the full body, its mesh and its materials, comes from there. Modes and sample are kept in
single precision, the precision of live steps.
"""

from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.body.body import Body
from softfuse.rom.basis import Basis
from softfuse.rom.mode_points import ModePoints
from softfuse.rom.reduced_body import ReducedBody

Arrays = Mapping[str, np.ndarray]


def body_arrays(body: ReducedBody, basis: Basis) -> dict[str, np.ndarray]:
    """The arrays of a reduced body that was projected onto a basis."""
    seen = np.asarray(body.seen)
    watched = np.argsort(seen, kind="stable")[: len(body.seen_shapes)]
    arrays = {
        "displacement": basis.displacement.astype(np.float32),
        "pressure": basis.pressure.astype(np.float32),
        "watched": watched,
        "points": np.array([len(points.volumes) for points in body.sample]),
        "linear": np.asarray(body.linear),
        "weight": np.asarray(body.weight),
        "stiffness": np.asarray(body.stiffness),
    }
    for number, points in enumerate(body.sample):
        arrays[f"gradients{number}"] = np.asarray(points.each_gradient, np.float32)
        arrays[f"pressures{number}"] = np.asarray(points.pressures, np.float32)
        arrays[f"volumes{number}"] = np.asarray(points.volumes, np.float32)
    return arrays


def body_of(full: Body, arrays: Arrays, points: Sequence[int], watched: int) -> ReducedBody:
    """The reduced body of some arrays, in single precision, with so many `points` of each material and so
    many nodes `watched`, at least as many as it has.
    """
    modes, nodes = arrays["displacement"], arrays["watched"]
    shapes = np.zeros((watched, 3, modes.shape[1]), modes.dtype)
    shapes[: len(nodes)] = of_nodes(full, nodes, modes)
    sample = []
    for number, (region, count) in enumerate(zip(full.regions(), points, strict=True)):
        # In numpy: XLA would compile programs for each new size.
        gradients, pressures, volumes = (
            _padded(arrays[f"{name}{number}"], axis, count)
            for name, axis in (("gradients", 1), ("pressures", 0), ("volumes", 0))
        )
        material = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), region.material)
        sample.append(ModePoints.of(material, gradients, pressures, volumes, full.element))
    return ReducedBody(
        rest=full.rest,
        tets=full.tets,
        pressure_unit=full.pressure_unit,
        modes=jnp.asarray(modes),
        index=full.displacement_index,
        pressure_modes=jnp.asarray(arrays["pressure"]),
        factors=full.factors,
        seen=place_among(nodes, full.n_nodes, watched),
        seen_shapes=jnp.asarray(shapes),
        sample=tuple(sample),
        linear=jnp.asarray(arrays["linear"]),
        weight=jnp.asarray(arrays["weight"]),
        rest_volume=full.volume,
        carried=carried(full, modes, len(arrays["weight"])),
        stiffness=jnp.asarray(arrays["stiffness"]),
        element=full.element,
        n=len(arrays["weight"]),
    )


def _padded(array: np.ndarray, axis: int, count: int) -> np.ndarray:
    """With zeros behind, so that there are so many along an axis."""
    behind = [(0, count - size if k == axis else 0) for k, size in enumerate(array.shape)]
    return np.pad(array, behind)


def of_nodes(
    body: Body, nodes: Int[np.ndarray, " w"], displacement: Float[np.ndarray, "u m"]
) -> Float[np.ndarray, "w 3 m"]:
    """What modes of the displacement unknowns do to some nodes (w,)."""
    index = np.asarray(body.displacement_index)[nodes]
    free = index < len(displacement)
    return np.where(free[:, :, None], displacement[np.where(free, index, 0)], 0)


def carried(body: Body, displacement: Float[np.ndarray, "u m"], n: int) -> Float[Array, "n_plus_1 6"]:
    """Gravity's force and moment about the origin (n + 1, 6) by each of n unknowns, of which modes of the
    displacement unknowns come first; then at rest.
    """
    found = np.zeros((n + 1, 6))
    found[-1] = np.asarray(jax.jit(type(body).weight_resultant)(body, jnp.zeros(body.n)))
    gravity = np.asarray(body.gravity)
    if np.any(found[-1]):
        masses, nodes = np.asarray(body.masses()), np.arange(body.n_nodes)
        first = np.einsum("k,kim->mi", masses, of_nodes(body, nodes, displacement), dtype=float)
        found[: displacement.shape[1], 3:] = np.cross(first, gravity)
    return jnp.asarray(found)


def place_among(watched: Int[np.ndarray, " w"], nodes: int, room: int) -> Int[Array, " k"]:
    """The place of each of so many nodes (k,) among the watched (w,); `room` where it is none of them."""
    places = np.full(nodes, room, np.int32)
    places[watched] = np.arange(len(watched))
    return jnp.asarray(places)
