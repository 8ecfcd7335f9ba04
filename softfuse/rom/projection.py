"""From a full body and a chart to the reduced body.

Displacement and pressure modes are separate, so that a saddle point stays one: K₀ = [[1, B], [Bᵀ, −1]], as
displacement modes are orthonormal in the stiffness A of the displacements, pressure modes in the
compressibility C. It is invertible for any modes, for its Schur complement 1 + B Bᵀ is positive, as long as
the material is compressible at all.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from softfuse.body.body import Body
from softfuse.rom.body_arrays import carried, of_nodes, place_among
from softfuse.rom.chart import Chart
from softfuse.rom.mode_points import ModePoints
from softfuse.rom.reduced_body import ReducedBody
from softfuse.rom.rest_stiffness import RestStiffness
from softfuse.rom.strained_points import mode_points


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
    return ReducedBody(
        rest=body.rest,
        tets=body.tets,
        pressure_unit=body.pressure_unit,
        modes=jnp.asarray(chart.basis.displacement),
        index=body.displacement_index,
        pressure_modes=jnp.asarray(chart.basis.pressure),
        factors=body.factors,
        seen=place_among(watched, body.n_nodes, len(watched)),
        seen_shapes=jnp.asarray(of_nodes(body, watched, chart.basis.displacement)),
        sample=sample,
        linear=jnp.asarray(linear),
        weight=jnp.asarray(columns.T @ np.asarray(body.weight)),
        rest_volume=body.volume,
        carried=carried(body, chart.basis.displacement, n),
        stiffness=jnp.asarray(1 / chart.compliance),
        element=body.element,
        n=n,
    )
