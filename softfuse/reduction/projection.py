"""From a full body, modes and a cubature to the reduced body.

Displacement and pressure modes are separate, so that a saddle point stays one: K₀ = [[1, B], [Bᵀ, −1]], as
displacement modes are orthonormal in the stiffness A of the displacements, pressure modes in the
compressibility C. It is invertible for any modes, for its Schur complement 1 + B Bᵀ is positive, as long as
the material is compressible at all.
"""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from softfuse.body.body import Body
from softfuse.reduction.basis import Basis
from softfuse.reduction.cubature import Cubature
from softfuse.reduction.reduced_body import ReducedBody
from softfuse.reduction.rest_stiffness import RestStiffness, tangents


def project(
    body: Body,
    basis: Basis,
    stiffness: RestStiffness,
    cubature: Cubature,
    watched: Int[np.ndarray, " w"],
    contact_stiffness: float,
) -> ReducedBody:
    """The reduced body of a basis, whose energy is measured on a cubature's elements.

    `watched` (w,): the nodes that loads and functionals look at; `contact_stiffness` [N/m]: see
    `ReducedBody.stiffness`.
    """
    columns = basis.columns
    sample, places = sampled_elements(body, cubature.parts, cubature.weights)
    sampled = columns[places]
    local = np.asarray(tangents(sample, jnp.zeros(sample.n)))
    modes = np.concatenate([sampled, np.zeros((1, columns.shape[1]))])[np.asarray(sample.element_unknowns)]
    counted = modes.reshape(-1, columns.shape[1]).T @ (local @ modes).reshape(-1, columns.shape[1])
    shapes = _of_nodes(body, basis.displacement)
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
        sampled=jnp.asarray(sampled),
        linear=jnp.asarray(columns.T @ (stiffness.whole @ columns) - counted),
        weight=jnp.asarray(columns.T @ np.asarray(body.weight)),
        rest_volume=body.volume,
        stiffness=jnp.asarray(contact_stiffness),
        n=columns.shape[1],
    )


def sampled_elements(
    body: Body, elements: Int[np.ndarray, " e"], weights: Float[np.ndarray, " e"]
) -> tuple[Body, Int[np.ndarray, " s"]]:
    """The body that some elements (e,) with weights (e,) [-] are by themselves, without gravity; and which
    unknowns (s,) of the whole body its own are.
    """
    order = np.argsort(elements)
    elements, scale = np.asarray(elements)[order], jnp.asarray(weights[order])
    moves = np.asarray(body.displacement_unknowns)[..., elements]
    pressures = np.asarray(body.pressure_unknowns)[:, elements]
    places = np.unique(np.append(moves, pressures))
    places = places[places < body.n]
    own = np.full(body.n + 1, len(places), np.int32)
    own[places] = np.arange(len(places))
    bounds = np.searchsorted(elements, np.cumsum((0, *body.counts)))
    sample = replace(
        body,
        tets=body.tets[elements],
        frames=body.frames[..., elements] * scale,
        volumes=body.volumes[:, elements] * scale,
        weight=jnp.zeros(len(places)),
        displacement_index=jnp.asarray(own[np.asarray(body.displacement_index)]),
        displacement_unknowns=jnp.asarray(own[moves]),
        pressure_unknowns=jnp.asarray(own[pressures]),
        counts=tuple(int(count) for count in np.diff(bounds)),
        n_displacements=int(np.sum(places < body.n_displacements)),
        n=len(places),
    )
    return sample, places


def _of_nodes(body: Body, displacement: Float[np.ndarray, "u m"]) -> Float[np.ndarray, "k 3 m"]:
    held = np.concatenate([displacement, np.zeros((1, displacement.shape[1]))])
    index = np.minimum(np.asarray(body.displacement_index), len(displacement))
    return held[index]
