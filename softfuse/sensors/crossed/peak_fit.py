"""Location of a contact by fitting the profiles of rows and columns to the response of a cylinder.

The unknowns and what speaks for them are those of `peak_model`. The fit begins anew at the profile's coarse
middle and takes a fixed number of Levenberg-Marquardt steps; derivatives are by the implicit function theorem
at the minimum. `peak_follow` does the same from frame to frame, in fewer steps.

An electrode that lies (a broken trace that no longer answers, a reading that is stuck since the touch) has
too much leverage on eight unknowns for a robust cost to help. So `fit_peak_of_honest`, when the residual is
bad, fits anew without each electrode in turn and leaves out the one whose absence mends the fit.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from softfuse.sensors.crossed.peak_model import (
    SHAPE,
    Evidence,
    LinearShape,
    PeakFit,
    PeakModel,
    PeakShape,
    evidence_of,
    minimum_at,
    peak_found,
    peak_shape,
)

MENDED = 0.3
"""Of the residual, a tenth of its square: what is left when a lying electrode is left out."""
_DAMPING = 1.0  # of the diagonal: a start up to half a pitch off does not overshoot


def coarse_location(
    position_m: Float[Array, " n"], signal: Float[Array, " n"], valid: Bool[Array, " n"]
) -> Float[Array, ""]:
    """Centroid of the strongest three neighbouring electrodes, a start that one spike cannot mislead.

    Args: position_m (n,) [m]; signal (n,) [counts]; valid (n,), invalid electrodes are filled from their
    neighbours.
    Returns: coordinate [m].
    """
    weight = jnp.where(valid, jnp.maximum(signal, 0.0), 0.0)

    def neighbours(v):
        padded = jnp.pad(v, 1)
        return padded[:-2], padded[2:]

    below, above = neighbours(weight)
    known_below, known_above = neighbours(valid.astype(weight.dtype))
    filled = jnp.where(valid, weight, (below + above) / jnp.maximum(known_below + known_above, 1.0))
    below, above = neighbours(filled)
    # The second largest of three is blind to a spike on a single electrode.
    median = below + filled + above - jnp.maximum(jnp.maximum(below, filled), above)
    median = median - jnp.minimum(jnp.minimum(below, filled), above)
    peak = jnp.argmax(median + 1e-3 * (below + filled + above))
    near = jnp.abs(jnp.arange(position_m.shape[0]) - peak) <= 1
    weight = jnp.where(near, filled, 0.0)
    total = jnp.sum(weight)
    centroid = jnp.sum(weight * position_m) / jnp.where(total > 0, total, 1.0)
    return jax.lax.stop_gradient(jnp.where(total > 0, centroid, jnp.mean(position_m)))


def coarse_unknowns(
    model: PeakModel, shape: PeakShape, signal: Float[Array, " e"], valid: Bool[Array, " e"]
) -> tuple[Float[Array, "8"], LinearShape]:
    """Unknowns (8,) to begin with: coarse location, nominal cylinder, amplitudes by least squares; and the
    response about them.
    """
    rows = model.row_y_m.shape[0]
    x = coarse_location(model.column_x_m, signal[rows:], valid[rows:])
    y = coarse_location(model.row_y_m, signal[:rows], valid[:rows])
    zero = jnp.zeros_like(x)
    linear = shape.linear(jnp.stack([x, y, model.radius_m, zero]))

    def amplitude(f, s, v):
        f = jnp.where(v, f, 0.0)
        return jnp.sum(f * jnp.where(v, s, 0.0)) / (jnp.sum(f * f) + 1e-12)

    f = linear.response
    a_row = amplitude(f[:rows], signal[:rows], valid[:rows])
    a_col = amplitude(f[rows:], signal[rows:], valid[rows:])
    return jnp.stack([x, y, a_row, a_col, zero, zero, model.radius_m, zero]), linear


def descend(
    shape: PeakShape,
    evidence: Evidence,
    z: Float[Array, "8"],
    linear: LinearShape,
    steps: int,
) -> tuple[Float[Array, "8"], LinearShape, Float[Array, ""]]:
    """Levenberg-Marquardt steps down from z, near which the response is known.

    Returns: unknowns z (8,), the response about them, and the length of the last accepted step of the
    location [m].
    """

    def step(carry, _):
        z, linear, residual, damping, last = carry
        delta = evidence.step(z, residual, evidence.jacobian(z, linear), damping)
        trial = z + delta
        there = shape.linear((trial * evidence.scale)[SHAPE])
        left = evidence.residual(trial, there.response)
        better = evidence.cost(trial, left) <= evidence.cost(z, residual)
        moved = jnp.hypot(delta[0] * evidence.scale[0], delta[1] * evidence.scale[1])
        after = (trial, there, left, 0.1 * damping, moved)
        before = (z, linear, residual, 10.0 * damping, last)
        return jax.tree.map(lambda new, old: jnp.where(better, new, old), after, before), None

    residual = evidence.residual(z, linear.at((z * evidence.scale)[SHAPE]))
    first = (z, linear, residual, *(jnp.asarray(value, z.dtype) for value in (_DAMPING, jnp.inf)))
    (z, linear, _, _, moved), _ = jax.lax.scan(step, first, None, length=steps)
    return z, linear, moved


def fit_peak(model: PeakModel, signal: Float[Array, " e"], valid: Bool[Array, " e"]) -> PeakFit:
    """Fit a cylinder to the signals of all electrodes.

    Args: signal (r + c,) counts above the baseline, rows first; valid (r + c,), invalid electrodes are left
    out.
    Returns: PeakFit. With fewer valid electrodes than unknowns the priors keep it finite and the covariance
    says so.
    """
    shape = peak_shape(model)
    # The start is a guess, not a part of the estimate: no derivative passes through it. Derivatives come from
    # the minimum by the implicit function theorem, not from the steps that led there.
    start, _ = jax.lax.stop_gradient(coarse_unknowns(model, shape, signal, valid))
    evidence = evidence_of(model, signal, valid, start)

    def minimise(_, start_z):
        there = shape.linear((start_z * evidence.scale)[SHAPE])
        z, _, moved = descend(shape, evidence, start_z, there, model.iterations)
        return z, moved

    def cost(z):
        return 0.5 * evidence.cost(z, evidence.residual(z, shape((z * evidence.scale)[SHAPE])))

    z, moved = jax.lax.custom_root(
        jax.grad(cost),
        jax.lax.stop_gradient(evidence.mean),
        minimise,
        lambda linear, rhs: jnp.linalg.solve(jax.jacfwd(linear)(rhs), rhs),
        has_aux=True,
    )
    linear = shape.linear((z * evidence.scale)[SHAPE])
    return peak_found(model, evidence, minimum_at(evidence, z, linear, moved))


def fit_peak_of_honest(
    model: PeakModel, signal: Float[Array, " e"], valid: Bool[Array, " e"]
) -> tuple[PeakFit, Bool[Array, " e"]]:
    """Fit a cylinder to all electrodes but one that lies, if one does.

    Args: signal (r + c,) counts above the baseline, rows first; valid (r + c,).
    Returns: PeakFit and honest (r + c,): valid without the electrode left out. One is left out only where the
    misfit exceeds `outlier` and falls to less than a tenth without it, so that an unusual finger loses none.
    """
    whole = fit_peak(model, signal, valid)
    bad = whole.chi_squared > model.outlier**2 * jnp.maximum(jnp.sum(valid), 1)

    def search():
        without = valid & ~jnp.eye(signal.shape[0], dtype=bool)
        fits = jax.vmap(lambda v: fit_peak(model, signal, v))(without)
        error = jnp.where(valid, fits.residual_counts, jnp.inf)
        best = jnp.argmin(error)
        mends = error[best] < MENDED * whole.residual_counts
        chosen = jax.tree.map(lambda one, all_: jnp.where(mends, one[best], all_), fits, whole)
        return chosen, jnp.where(mends, without[best], valid)

    return jax.lax.cond(bad, search, lambda: (whole, valid))
