"""How well electrodes tell the place of a contact, before any is made: what a layout of lines is good for.

A contact with unknowns u, of which the first two are its place p, leaves signals s(u) with standard
deviations σ. With priors Π of the unknowns the information on all of them is

    J = (∂s/∂u / σ)ᵀ (∂s/∂u / σ) + Π,

and on the place alone the inverse of the corner (2, 2) of J⁻¹. All is differentiable in where the lines are.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from softfuse.sensors.crossed.diamond_array import mean_pitch
from softfuse.sensors.crossed.peak_model import (
    PeakModel,
    evidence_of,
    line_shape,
    minimum_at,
    peak_found,
    peak_layers,
)
from softfuse.sensors.mutual.model import MutualModel, one_signal


def place_told_by_lines(
    model: PeakModel, charge_counts_m2: Float[Array, ""], places_m: Float[Array, "s 2"]
) -> Float[Array, "s 2 2"]:
    """Information (s, 2, 2) [1/m²] on the places (s, 2) [m] of contacts, one each, by crossed lines.

    charge_counts_m2: amplitude of a contact times the area that its response is counted in, p² of the rows;
    lines that are nearer together share it.
    """
    shape = line_shape(model)
    amplitude = jnp.full(2, charge_counts_m2 / mean_pitch(model.row_y_m) ** 2)
    others = jnp.stack([jnp.zeros(()), jnp.zeros(()), model.radius_m, jnp.zeros(())])

    def told(place):
        unknowns = jnp.concatenate([place, amplitude, others])
        near = shape.linear(jnp.concatenate([place, others[2:]]))
        signal = peak_layers(model) @ amplitude * near.response
        evidence = evidence_of(model, signal, jnp.ones(signal.shape, bool), unknowns)
        found = minimum_at(evidence, unknowns / evidence.scale, near, jnp.zeros(()))
        return jnp.linalg.inv(peak_found(evidence, found).covariance_m2)

    return jax.lax.map(told, places_m)


def charge_of(model: PeakModel, largest_counts: float) -> Float[Array, ""]:
    """What `place_told_by_lines` asks for [counts m²], of a contact on the middle of the array whose largest
    signal is `largest_counts`.
    """
    middle = jnp.stack([jnp.mean(model.column_x_m), jnp.mean(model.row_y_m)])
    response = line_shape(model)(jnp.concatenate([middle, jnp.stack([model.radius_m, jnp.zeros(())])]))
    return largest_counts / jnp.max(response) * mean_pitch(model.row_y_m) ** 2


def place_told_by_grid(
    model: MutualModel, coupling: float, places_m: Float[Array, "s 2"]
) -> Float[Array, "s 2 2"]:
    """Information (s, 2, 2) [1/m²] on the places (s, 2) [m] of contacts, one each, by a grid of mutual
    capacitances, under each of which cells couple so much [contact], which is found with the place.
    """

    def told(place):
        def signal(unknowns):
            return one_signal(model, unknowns[:2], jnp.ones(()), unknowns[2])

        at = jnp.append(place, coupling)
        by_own = jax.jacfwd(signal)(at)
        peak = jnp.maximum(jnp.max(jnp.abs(signal(at))), model.contact_counts * jnp.hypot(1.0, coupling))
        sigma = jnp.sqrt(model.noise_counts**2 + (model.model_error * peak) ** 2)
        # Besides the place and the coupling, what all baselines are off by.
        common = jnp.full((by_own.shape[0], 1), model.common_error * model.contact_counts)
        jacobian = jnp.concatenate([by_own, common], axis=1) / sigma
        information = jacobian.T @ jacobian + jnp.diag(jnp.array([0.0, 0.0, 0.0, 1.0]))
        return jnp.linalg.inv(jnp.linalg.inv(information)[:2, :2])

    return jax.lax.map(told, places_m)
