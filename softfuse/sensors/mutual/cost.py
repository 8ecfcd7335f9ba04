"""How well sources explain an image of mutual capacitances, and the nearest minimum of that cost.

Each of n sources has three unknowns z: x, y in pitches and one strength, its coupling k while it is in
contact (with the shielding `held` s*), its shielding s while it hovers. Over the valid cells,

    min over b of  Σ ((u + b − signal) / σ)² + ((b − b₀) / σ_b)²
        + Σ_hovering (max(s − 1, 0) / σ_s)² + Σ_expected |p − p_expected|² / σ_p²,

σ² = noise² + (model error · peak)², the peak being that of the image or of the effects in contact, which may
cancel in it. b is what all cells have in common, because baselines were taken, or followed, while something
was far away. A place is expected where it was last, or would be if it moved on, or, once the thing presses,
where it was set down. Strengths are >= 0. The minimum is found by projected Levenberg-Marquardt steps; a
source has the derivatives of its own signal only, so that JᵀJ is made of blocks of three columns.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.scipy.linalg import solve
from jaxtyping import Array, Bool, Float

from softfuse.sensors.mutual.model import MutualModel, Sources, one_signal, source_signals

BEYOND = 0.5
"""Sources are sought so far beyond the outermost lines [pitches]: a thing there still shows."""

_DAMPING = 1e-1
_LIMIT = 6.0  # of contact: more is a fault, and would send the fit astray
_RIDGE = 1e-6
_STEADIER = 0.3  # of the wander, where an image hardly tells places: two things cross


class Known(eqx.Module):
    """n slots for sources, and what is known of those that are there."""

    there: Bool[Array, " n"]
    """(n,) the slot is taken."""
    contact: Bool[Array, " n"]
    """(n,) the thing was in contact: it couples."""
    firm: Bool[Array, " n"]
    """(n,) it pressed firmly."""
    pressed: Bool[Array, " n"]
    """(n,) it pressed, and had been seen before it did."""
    most: Float[Array, " n"]
    """(n,) coupling beyond which it cannot press by what else is known [contact]."""
    held: Float[Array, " n"]
    """(n,) its shielding s* in contact."""
    place_m: Float[Array, "n 2"]
    """(n, 2) where it is expected if it moves on [m]."""
    set_down_m: Float[Array, "n 2"]
    """(n, 2) where it was before it pressed [m]."""
    set_down_sigma_m: Float[Array, "n 2"]
    """(n, 2) standard deviations of that [m]."""
    close: Bool[Array, " n"]
    """(n,) another thing in contact is as close to it as can hardly be told apart."""
    strength: Float[Array, " n"]
    """(n,) its last s while it hovers, k in contact."""
    common_counts: Float[Array, ""]
    """What all baselines are off by alike [counts]."""
    common_sigma: Float[Array, ""]
    """Standard deviation of that [counts]."""


class Guess(eqx.Module):
    """What n slots, or one, are taken to hold, while their unknowns are sought."""

    there: Bool[Array, "*n"]
    """(n,) a source is in the slot."""
    contact: Bool[Array, "*n"]
    """(n,) in contact."""
    held: Float[Array, "*n"]
    """(n,) its shielding in contact."""
    expected: Bool[Array, "*n"]
    """(n,) it should be where it was expected."""
    stays: Bool[Array, "*n"]
    """(n,) it should be where it was set down instead."""


class ImageCost(eqx.Module):
    """An image, its weights, and what is known of its sources."""

    model: MutualModel
    known: Known
    wander_m: Float[Array, ""]
    signal: Float[Array, " e"]
    """(c r,) counts above the baseline, less what is known to be common to all; 0 where invalid."""
    weight: Float[Array, " e"]
    """(c r,) inverse standard deviations [1/counts], 0 where invalid."""
    common: Float[Array, " e"]
    """(c r,) direction of what is common to all cells, times √(1 − 1/√(1 + σ_b² Σ 1/σ²)) [-]."""

    def whitened(self, counts: Float[Array, " e"]) -> Float[Array, " e"]:
        """Counts (c r,) over their standard deviations, less for what is common to all."""
        scaled = self.weight * counts
        return scaled - self.common * (self.common @ scaled)

    def common_counts(self, left: Float[Array, " e"]) -> Float[Array, ""]:
        """What all baselines are off by [counts] where sources leave so much (c r,) [counts] of the image."""
        square = self.known.common_sigma**2
        told = square * jnp.sum(self.weight**2 * left) / (1.0 + square * jnp.sum(self.weight**2))
        return self.known.common_counts + told

    def sources(self, z: Float[Array, "n 3"], guess: Guess) -> Sources:
        """Sources of the unknowns; s = k = 0 in free slots."""
        shield, coupling = self._effects(z[:, 2], guess)
        return Sources(z[:, :2] * self.model.pitch_m, shield, coupling)

    def left(self, z: Float[Array, "n 3"], guess: Guess) -> Float[Array, " e"]:
        """What the sources leave of the image (c r,) [counts]."""
        return self.signal - jnp.sum(source_signals(self.model, self.sources(z, guess)), axis=0)

    def cost(self, z: Float[Array, "n 3"], guess: Guess) -> Float[Array, ""]:
        """Of the unknowns."""
        stiffness, target = self._prior(z, guess)
        misfit = self.whitened(self.left(z, guess))
        return misfit @ misfit + jnp.sum(stiffness * (z - target) ** 2)

    def normal_equations(
        self, z: Float[Array, "n 3"], guess: Guess
    ) -> tuple[Float[Array, "m m"], Float[Array, " m"]]:
        """JᵀJ and Jᵀr (3 n) of what may move: neither free slots nor what presses against a bound."""
        jacobian, signals = self._signals(z, guess)
        misfit = jnp.sum(signals, axis=0) - self.whitened(self.signal)
        stiffness, target = self._prior(z, guess)
        gradient = jnp.einsum("e,neu->nu", misfit, jacobian) + stiffness * (z - target)
        low, high = self.bounds()
        held = ((z <= low) & (gradient > 0)) | ((z >= high) & (gradient < 0)) | ~guess.there[:, None]
        moves = jax.lax.stop_gradient((~held).astype(z.dtype))
        return _information(jacobian, stiffness, moves), (moves * gradient).ravel()

    def information(self, z: Float[Array, "n 3"], guess: Guess) -> Float[Array, "m m"]:
        """What is told of the unknowns (3 n), as if there were no bounds."""
        there = jnp.broadcast_to(guess.there[:, None], z.shape).astype(z.dtype)
        return _information(self._signals(z, guess)[0], self._prior(z, guess)[0], there)

    def _signals(self, z, guess: Guess) -> tuple[Float[Array, "n e 3"], Float[Array, "n e"]]:
        """Derivatives of each source's own whitened signal, and the signals."""

        def signal(unknowns, there, contact, held):
            one = Guess(there, contact, held, there, ~there)
            shield, coupling = self._effects(unknowns[2], one)
            place = unknowns[:2] * self.model.pitch_m
            value = self.whitened(one_signal(self.model, place, shield, coupling))
            return value, value

        derivative = jax.vmap(jax.jacfwd(signal, has_aux=True))
        return derivative(z, guess.there, guess.contact, guess.held)

    def bounds(self) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        """Lowest and highest unknowns of a source."""
        x, y, pitch = self.model.column_x_m, self.model.row_y_m, self.model.pitch_m
        low = jnp.stack([x[0], y[0]]) / pitch - BEYOND
        high = jnp.stack([x[-1], y[-1]]) / pitch + BEYOND
        return jnp.append(low, 0.0), jnp.append(high, _LIMIT)

    def minimise(
        self, start: Float[Array, "n 3"], guess: Guess, steps: int
    ) -> tuple[Float[Array, "n 3"], Float[Array, ""]]:
        """The unknowns after so many steps from `start`, and their cost."""
        low, high = self.bounds()

        def step(carry, _):
            z, cost, damping = carry
            matrix, gradient = self.normal_equations(z, guess)
            damped = matrix + damping * jnp.diag(jnp.diagonal(matrix))
            trial = jnp.clip(z - solve(damped, gradient, assume_a="pos").reshape(z.shape), low, high)
            after = self.cost(trial, guess)
            better = after <= cost
            return (
                jnp.where(better, trial, z),
                jnp.where(better, after, cost),
                jnp.where(better, 0.2 * damping, 8.0 * damping),
            ), None

        start = jnp.clip(start, low, high)
        first = (start, self.cost(start, guess), jnp.full_like(self.weight[0], _DAMPING))
        (z, cost, _), _ = jax.lax.scan(step, first, None, length=steps)
        return z, cost

    def _effects(self, strength, guess: Guess):
        """Shielding and coupling, elementwise."""
        strength = jnp.where(guess.there, strength, 0.0)
        shield = jnp.where(guess.contact, jnp.where(guess.there, guess.held, 0.0), strength)
        return shield, jnp.where(guess.contact, strength, 0.0)

    def _prior(self, z, guess: Guess):
        """Stiffness (n, 3) with which each unknown is drawn to its target (n, 3)."""
        model = self.model
        known = self.known
        stays = guess.stays[:, None]
        wander = jnp.where(known.close, _STEADIER, 1.0)[:, None] * self.wander_m
        pitches = jnp.where(stays, known.set_down_sigma_m, wander) / model.pitch_m
        stray = jnp.where(guess.expected[:, None], 1 / pitches**2, 0.0)
        beyond = guess.there & ~guess.contact & (z[:, 2] > 1.0)
        excess = jnp.where(beyond, 1 / model.shield_sigma**2, 0.0)
        place = jnp.where(stays, known.set_down_m, known.place_m) / model.pitch_m
        return jnp.append(stray, excess[:, None], axis=1), jnp.append(
            place, jnp.ones_like(excess)[:, None], axis=1
        )


def _information(jacobian, stiffness, moves) -> Float[Array, "m m"]:
    """JᵀJ with priors of the unknowns that move; what does not, or does not show, stays."""
    flat = (jacobian * moves[:, None, :]).transpose(1, 0, 2).reshape(jacobian.shape[1], -1)
    diagonal = moves * stiffness + _RIDGE + 1.0 - moves
    return flat.T @ flat + jnp.diag(diagonal.ravel())


def image_cost(
    model: MutualModel,
    known: Known,
    wander_m: Float[Array, ""],
    signal: Float[Array, "c r"],
    valid: Bool[Array, "c r"],
) -> ImageCost:
    """Weights by noise and misfit of the model for an image (c, r) [counts], of which `valid` takes part."""
    flat = jnp.where(valid, signal - known.common_counts, 0.0).ravel()
    # Where shielding and coupling cancel, little is left of the signal, but not of their models' errors.
    hidden = jnp.where(known.there & known.contact, jnp.hypot(known.held, known.strength), 0.0)
    peak = jnp.maximum(jnp.max(jnp.abs(flat)), model.contact_counts * jnp.max(hidden))
    sigma = jnp.sqrt(model.noise_counts**2 + (model.model_error * peak) ** 2)
    weight = jnp.where(valid.ravel(), 1.0 / sigma, 0.0)
    length = jnp.sqrt(jnp.sum(weight**2))
    spread = known.common_sigma * length
    # R = diag σ² + σ_b² 1 1ᵀ has the square root of an inverse diag 1/σ − common commonᵀ diag 1/σ.
    root = jnp.sqrt(1.0 + spread**2)
    part = spread / jnp.sqrt(root * (root + 1.0))
    common = part * weight / jnp.where(length > 0, length, 1.0)
    return ImageCost(model, known, wander_m, flat, weight, common)
