"""From a full body and a chart to the reduced body.

Displacement and pressure modes are separate, so that a saddle point stays one: K₀ = [[1, B], [Bᵀ, −1]], as
displacement modes are orthonormal in the stiffness A of the displacements, pressure modes in the
compressibility C. It is invertible for any modes, for its Schur complement 1 + B Bᵀ is positive, as long as
the material is compressible at all.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from softfuse.body.body import Body
from softfuse.reduction.chart import Chart
from softfuse.reduction.mode_points import ModePoints
from softfuse.reduction.reduced_body import ReducedBody
from softfuse.reduction.rest_stiffness import RestStiffness
from softfuse.reduction.strained_points import mode_points


def project(body: Body, stiffness: RestStiffness, chart: Chart) -> ReducedBody:
    """The reduced body of a chart, from the full body and its tangent at rest."""
    columns, watched = chart.basis.columns, chart.watched
    n = columns.shape[1]
    chosen = mode_points(body, chart.basis, chart.cubature.parts, chart.cubature.weights)
    sample = tuple(each.padded(ReducedBody.parts) for each in chosen)
    counted = sum(np.asarray(eqx.filter_jit(ModePoints.tangent)(each, jnp.zeros(n))) for each in sample)
    shapes = _of_nodes(body, chart.basis.displacement)
    seen = np.full(body.n_nodes, len(watched))
    seen[watched] = np.arange(len(watched))
    return ReducedBody(
        rest=body.rest,
        tets=body.tets,
        pressure_unit=body.pressure_unit,
        shapes=jnp.asarray(shapes),
        seen=jnp.asarray(seen, jnp.int32),
        seen_shapes=jnp.asarray(shapes[watched]),
        sample=sample,
        linear=jnp.asarray(columns.T @ (stiffness.whole @ columns) - counted),
        weight=jnp.asarray(columns.T @ np.asarray(body.weight)),
        rest_volume=body.volume,
        stiffness=jnp.asarray(1 / chart.compliance),
        n=n,
    )


def _of_nodes(body: Body, displacement: Float[np.ndarray, "u m"]) -> Float[np.ndarray, "k 3 m"]:
    held = np.concatenate([displacement, np.zeros((1, displacement.shape[1]))])
    index = np.minimum(np.asarray(body.displacement_index), len(displacement))
    return held[index]
