"""From a full body and a chart to the reduced body, and that as named arrays for a file, and back.

Displacement and pressure modes are separate, so that a saddle point stays one: K₀ = [[1, B], [Bᵀ, −1]], as
displacement modes are orthonormal in the stiffness A of the displacements, pressure modes in the
compressibility C. It is invertible for any modes, for its Schur complement 1 + B Bᵀ is positive, as long as
the material is compressible at all. What a reduced body shares with the full one, its mesh and its materials,
is not among the arrays; modes and sample are, in single precision, the precision of live steps.
"""

from collections.abc import Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.body.body import Body
from softfuse.rom.basis import Basis, RestStiffness
from softfuse.rom.mode_points import ModePoints, mode_points
from softfuse.rom.reduced_body import ReducedBody
from softfuse.rom.teaching import Chart

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
    sample = []
    for number, (region, count) in enumerate(zip(full.regions(), points, strict=True)):
        # In numpy: XLA would compile programs for each new size.
        gradients, pressures, volumes = (
            _padded(arrays[f"{name}{number}"], axis, count)
            for name, axis in (("gradients", 1), ("pressures", 0), ("volumes", 0))
        )
        material = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), region.material)
        sample.append(ModePoints.of(material, gradients, pressures, volumes, full.element))
    basis = Basis(arrays["displacement"], arrays["pressure"])
    given = (arrays[name] for name in ("linear", "weight", "stiffness"))
    return _on_modes(full, basis, arrays["watched"], watched, tuple(sample), *given)


def _on_modes(
    full: Body,
    basis: Basis,
    nodes: Int[np.ndarray, " w"],
    room: int,
    sample: tuple[ModePoints, ...],
    linear: Float[np.ndarray, "n n"],
    weight: Float[np.ndarray, " n"],
    stiffness: np.ndarray | float,
) -> ReducedBody:
    """The full body on the modes of a basis, which watches some nodes (w,), with room for so many."""
    modes = basis.displacement
    shapes = np.zeros((room, 3, modes.shape[1]), modes.dtype)
    shapes[: len(nodes)] = of_nodes(full, nodes, modes)
    return ReducedBody(
        rest=full.rest,
        tets=full.tets,
        pressure_unit=full.pressure_unit,
        modes=jnp.asarray(modes),
        index=full.displacement_index,
        pressure_modes=jnp.asarray(basis.pressure),
        factors=full.factors,
        seen=place_among(nodes, full.n_nodes, room),
        seen_shapes=jnp.asarray(shapes),
        sample=sample,
        linear=jnp.asarray(linear),
        weight=jnp.asarray(weight),
        rest_volume=full.volume,
        carried=carried(full, modes, len(weight)),
        stiffness=jnp.asarray(stiffness),
        element=full.element,
        n=len(weight),
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


def project(body: Body, stiffness: RestStiffness, chart: Chart) -> ReducedBody:
    """The reduced body of a chart, from the full body and its tangent at rest."""
    columns, watched = chart.basis.columns, chart.watched
    n = columns.shape[1]
    chosen = mode_points(body, chart.basis, *chart.sampling.cubature[:2])
    sample = tuple(each.padded(max(1, len(each.volumes))) for each in chosen)
    linear = np.zeros((n, n))
    if chart.sampling.beyond_rest:
        counted = (eqx.filter_jit(ModePoints.tangent)(each, jnp.zeros(n)) for each in sample)
        linear = columns.T @ (stiffness.whole @ columns) - sum(map(np.asarray, counted))
    weight = columns.T @ np.asarray(body.weight)
    return _on_modes(body, chart.basis, watched, len(watched), sample, linear, weight, 1 / chart.compliance)
