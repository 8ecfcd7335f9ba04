"""Constants of a grid of mutual capacitances from touches of one finger at known places.

Lines and their width are drawn, but how deep the field sees the electrodes, how wide a finger is to it, how
much it takes, what cells show of each other, and how far they differ is read off images: of the finger lying
on the surface (shielding 1, coupling 0), and pressing (shielding 1, coupling unknown). With weights 1/σ² and
gains a that are not far from one,

    min over t, R, contact_counts, χ, a, k_i of
        Σ ((u_i − image_i) / σ_i)² + Σ ((a − 1) / σ_a)² + ((χ − χ₀) / σ_χ)²,

u of `sensors.mutual_model`, σ_i² = noise² + (model error · peak_i)². What is left is the model's error where
that is larger than the one given, which has to cover what was not tried: other fingers, hovering ones.
"""

from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Float

from softfuse.errors import SoftfuseError
from softfuse.sensors.mutual.model import MutualModel, Sources, source_signals

_GAIN_SIGMA = 0.1
_CROSSTALK_SIGMA = 0.05
_WIDEST = 4.0  # more than this factor depth and radius cannot be off what was drawn
_ACCURACY = 1e-8


@dataclass(frozen=True, eq=False)
class KnownTouches:
    """Images (n, c, r) [counts above the baseline], one touch each at places_m (n, 2) [m]."""

    images: Float[np.ndarray, "n c r"]
    places_m: Float[np.ndarray, "n 2"]


def fit_mutual_model(model: MutualModel, lying: KnownTouches, pressed: KnownTouches) -> MutualModel:
    """A model with the depth, finger radius, contact counts, crosstalk, gains and error of the touches.

    Args: model, as drawn; lying, pressed: the finger without force and with any force.
    Raises SoftfuseError unless at least two lie and two press, and when no fit explains them.
    """
    for what, touches in (("lying", lying), ("pressed", pressed)):
        if len(touches.images) < 2:
            raise SoftfuseError(
                f"{len(touches.images)} {what} touches: give at least two, at different places between cells"
            )
    images = np.concatenate([lying.images, pressed.images])
    places = jnp.asarray(np.concatenate([lying.places_m, pressed.places_m]))
    peak = np.max(np.abs(images), axis=(1, 2))
    noise, error = float(model.noise_counts), float(model.model_error)
    flat, sigma = jnp.asarray(images.reshape(len(images), -1)), np.hypot(noise, error * peak)[:, None]
    cells, free, rest = flat.shape[1], len(pressed.images), len(lying.images)

    def of(x):
        sizes = jnp.array([model.depth_m, model.finger_radius_m, model.contact_counts]) * jnp.exp(x[:3])
        gain = x[4 : 4 + cells].reshape(model.gain.shape)
        fitted = eqx.tree_at(_constants, model, (*sizes, x[3], gain))
        coupling = jnp.concatenate([jnp.zeros(rest), x[4 + cells :]])
        return fitted, source_signals(fitted, Sources(places, jnp.ones(rest + free), coupling)) - flat

    def residual(x):
        beforehand = (x[3] - model.crosstalk) / _CROSSTALK_SIGMA, *((x[4 : 4 + cells] - 1) / _GAIN_SIGMA)
        return jnp.concatenate([(of(x)[1] / sigma).ravel(), jnp.stack(beforehand)])

    counts = np.log(_mean_peak(lying) / float(model.contact_counts))
    start = jnp.concatenate([jnp.array([0.0, 0.0, counts, model.crosstalk]), jnp.ones(cells + free)])
    found = optx.least_squares(
        lambda x, _: residual(x), optx.LevenbergMarquardt(_ACCURACY, _ACCURACY), start, throw=False
    )
    if found.result != optx.RESULTS.successful:
        raise SoftfuseError("no constants of the grid explain the touches: check their places and the grid's")
    widest = float(jnp.exp(jnp.max(jnp.abs(found.value[:2]))))
    if widest > _WIDEST:
        raise SoftfuseError(
            f"depth or finger radius would be {widest:.1f} times off: check the touches' places"
        )
    fitted, misfit = of(found.value)
    # As many data as unknowns explain nothing.
    unknowns = 4 + cells + free
    relative = np.asarray(misfit) / peak[:, None]
    left = max(misfit.size - unknowns, 1)
    fit_error = np.sqrt(max(np.sum(relative**2) / left - np.mean((noise / peak) ** 2), 0.0))
    return eqx.tree_at(lambda m: m.model_error, fitted, jnp.maximum(model.model_error, fit_error))


def _constants(model: MutualModel):
    return model.depth_m, model.finger_radius_m, model.contact_counts, model.crosstalk, model.gain


def _mean_peak(touches: KnownTouches) -> float:
    """Largest drop of each image, averaged [counts]; raises SoftfuseError when some image has none."""
    drop = -np.min(touches.images, axis=(1, 2))
    if not np.all(drop > 0):
        raise SoftfuseError("a lying finger lowers no reading: is it grounded, and are the counts inverted?")
    return float(np.mean(drop))
