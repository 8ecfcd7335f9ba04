"""Location of a contact by fitting the profiles of rows and columns to the response of a cylinder.

Unknowns p = (x, y, A_row, A_col, o_row, o_col, R, g): the axis of a grounded cylinder [m], one amplitude and
one offset [counts] for the rows and one for the columns (other things that couple to every line, such as the
hand behind a finger), the cylinder's radius R [m] and the air gap g [m] that adds to the depth of the
electrodes. The fit is

    min_p  sum_i h((s_i - A f_i(x, y, R, d + g) - o) / sigma) + |(o, R - R0, g) / prior|^2,

f being `diamond_array.line_response`, h Huber's function, so that one electrode that lies does not move the
contact, and sigma^2 = noise^2 + (model_error * largest signal)^2, because the noise of the counts is far
below what a model of the peak can promise. The profile ends where the array ends, in the measurement and in
the model, hence no border bias. Solved by a fixed number of Levenberg-Marquardt steps.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from softfuse.sensing.diamond_array import line_response

_DAMPING = 1e-3
_WEAK_PRIOR = 1e-2
_LEAST_DEPTH = 0.3  # of the electrode's own depth: a negative gap means a dented pad, not a pierced one


class PeakModel(eqx.Module):
    """Where the electrode lines are and what is assumed about what touches them; every field but one is a
    leaf."""

    row_y_m: Float[Array, " r"]
    """(r,) y of the rows' centre lines [m], ascending."""
    column_x_m: Float[Array, " c"]
    """(c,) x of the columns' centre lines [m], ascending."""
    row_depth_m: Float[Array, ""]
    """Depth of the rows below the pad's top [m]."""
    column_depth_m: Float[Array, ""]
    """Depth of the columns below the pad's top [m]."""
    row_rim_m: Float[Array, ""]
    """Width beyond the rim whose flux the outermost rows share [m]."""
    column_rim_m: Float[Array, ""]
    """Width beyond the rim whose flux the outermost columns share [m]."""
    radius_m: Float[Array, ""]
    """Expected radius of what touches [m]."""
    radius_sigma_m: Float[Array, ""]
    """Standard deviation of that expectation [m]."""
    gap_sigma_m: Float[Array, ""]
    """Standard deviation of the gap (electrical distance beyond the nominal depth) [m]."""
    offset_sigma_counts: Float[Array, ""]
    """Standard deviation of the common offset of all lines of one direction [counts]."""
    noise_counts: Float[Array, ""]
    """Standard deviation of one reading [counts]."""
    model_error: Float[Array, ""]
    """Standard deviation of the model's misfit relative to the largest signal."""
    huber: Float[Array, ""]
    """Residual in standard deviations above which it counts linearly."""
    iterations: int = eqx.field(static=True)
    """Number of Levenberg-Marquardt steps."""


class PeakFit(eqx.Module):
    """The fitted cylinder."""

    location_m: Float[Array, "2"]
    """(2,) x, y [m]."""
    covariance_m2: Float[Array, "2 2"]
    """(2, 2) covariance of the location from noise, model misfit and priors [m^2]."""
    noise_covariance_m2: Float[Array, "2 2"]
    """(2, 2) covariance of the location from the counts' noise alone [m^2]: its scatter between frames."""
    amplitude_counts: Float[Array, "2"]
    """(2,) amplitude of rows, columns [counts]."""
    offset_counts: Float[Array, "2"]
    """(2,) offset of rows, columns [counts]."""
    radius_m: Float[Array, ""]
    """Radius [m]."""
    gap_m: Float[Array, ""]
    """Gap beyond the nominal depth [m]."""
    residual_counts: Float[Array, ""]
    """Root mean square residual over the valid electrodes [counts]."""
    step_m: Float[Array, ""]
    """Length of the last accepted step of the location [m]: tells whether the fit has converged."""


def peak_model(
    row_y_m: Float[Array, " r"],
    column_x_m: Float[Array, " c"],
    row_depth_m: float,
    column_depth_m: float,
    *,
    radius_m: float = 10e-3,
    radius_sigma_m: float = 0.5e-3,
    gap_sigma_m: float = 0.5e-3,
    offset_sigma_counts: float = 100.0,
    noise_counts: float = 8.0,
    model_error: float = 0.005,
    huber: float = 4.0,
    iterations: int = 6,
) -> PeakModel:
    """Peak model of a crossed array in which the deeper layer collects the flux around the array's rim.

    Args: row_y_m (r,), column_x_m (c,) centre lines [m], ascending; row_depth_m, column_depth_m [m]; the
    options are the fields of PeakModel. The rim strip of the deeper layer is as wide as the distance between
    the layers (the height by which the array's side face exposes it), that of the other layer zero.
    """
    gap = row_depth_m - column_depth_m
    return PeakModel(
        row_y_m=jnp.asarray(row_y_m, float),
        column_x_m=jnp.asarray(column_x_m, float),
        row_depth_m=jnp.asarray(row_depth_m, float),
        column_depth_m=jnp.asarray(column_depth_m, float),
        row_rim_m=jnp.asarray(max(gap, 0.0), float),
        column_rim_m=jnp.asarray(max(-gap, 0.0), float),
        radius_m=jnp.asarray(radius_m, float),
        radius_sigma_m=jnp.asarray(radius_sigma_m, float),
        gap_sigma_m=jnp.asarray(gap_sigma_m, float),
        offset_sigma_counts=jnp.asarray(offset_sigma_counts, float),
        noise_counts=jnp.asarray(noise_counts, float),
        model_error=jnp.asarray(model_error, float),
        huber=jnp.asarray(huber, float),
        iterations=iterations,
    )


def peak_signal(
    model: PeakModel,
    location_m: Float[Array, "2"],
    amplitude_counts: Float[Array, "2"],
    offset_counts: Float[Array, "2"],
    radius_m: Float[Array, ""],
    gap_m: Float[Array, ""],
) -> Float[Array, " e"]:
    """Signal of all electrodes, rows first, for a cylinder standing on the pad.

    Args: location_m (2,) [m]; amplitude_counts (2,), offset_counts (2,) of rows, columns [counts]; radius_m,
    gap_m [m].
    Returns: signal (r + c,) [counts].
    """
    x, y = location_m[0], location_m[1]
    row_depth = jnp.maximum(model.row_depth_m + gap_m, _LEAST_DEPTH * model.row_depth_m)
    column_depth = jnp.maximum(model.column_depth_m + gap_m, _LEAST_DEPTH * model.column_depth_m)
    rows = line_response(model.row_y_m, model.column_x_m, model.row_rim_m, y, x, radius_m, row_depth)
    columns = line_response(model.column_x_m, model.row_y_m, model.column_rim_m, x, y, radius_m, column_depth)
    return jnp.concatenate(
        [amplitude_counts[0] * rows + offset_counts[0], amplitude_counts[1] * columns + offset_counts[1]]
    )


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


def _start(model: PeakModel, signal: Float[Array, " e"], valid: Bool[Array, " e"]) -> Float[Array, "8"]:
    """Coarse location, nominal cylinder, amplitudes by least squares."""
    rows = model.row_y_m.shape[0]
    x = coarse_location(model.column_x_m, signal[rows:], valid[rows:])
    y = coarse_location(model.row_y_m, signal[:rows], valid[:rows])
    shape = peak_signal(
        model, jnp.stack([x, y]), jnp.ones(2), jnp.zeros(2), model.radius_m, jnp.zeros_like(model.radius_m)
    )

    def amplitude(f, s, v):
        f = jnp.where(v, f, 0.0)
        return jnp.sum(f * jnp.where(v, s, 0.0)) / (jnp.sum(f * f) + 1e-12)

    a_row = amplitude(shape[:rows], signal[:rows], valid[:rows])
    a_col = amplitude(shape[rows:], signal[rows:], valid[rows:])
    zero = jnp.zeros_like(x)
    return jnp.stack([x, y, a_row, a_col, zero, zero, model.radius_m, zero])


def fit_peak(model: PeakModel, signal: Float[Array, " e"], valid: Bool[Array, " e"]) -> PeakFit:
    """Fit a cylinder to the signals of all electrodes (equation in the module's docstring).

    Args: signal (r + c,) counts above the baseline, rows first; valid (r + c,), invalid electrodes are left
    out.
    Returns: PeakFit. With fewer valid electrodes than unknowns the priors keep it finite and the covariance
    says so.
    """
    signal = jnp.where(valid, signal, 0.0)
    peak = jnp.max(jnp.abs(signal))
    sigma = jnp.sqrt(model.noise_counts**2 + (model.model_error * peak) ** 2)
    # The start is a guess, not a part of the estimate: no derivative passes through it. The prior's mean of
    # the radius is a parameter, so that one does.
    start = jax.lax.stop_gradient(_start(model, signal, valid)).at[6].set(model.radius_m)
    pitch_x = (model.column_x_m[-1] - model.column_x_m[0]) / (model.column_x_m.shape[0] - 1)
    pitch_y = (model.row_y_m[-1] - model.row_y_m[0]) / (model.row_y_m.shape[0] - 1)
    # Unknowns in units of order one: where there is a prior, its standard deviation. The weak prior on
    # amplitude and location (a hundred units wide) only keeps the normal matrix regular when electrodes are
    # missing.
    scale = jnp.stack(
        [
            pitch_x,
            pitch_y,
            jnp.maximum(peak, sigma),
            jnp.maximum(peak, sigma),
            model.offset_sigma_counts,
            model.offset_sigma_counts,
            model.radius_sigma_m,
            model.gap_sigma_m,
        ]
    )
    mean = start / scale
    prior = jnp.asarray([_WEAK_PRIOR] * 4 + [1.0] * 4)

    def data_residual(z):
        p = z * scale
        model_signal = peak_signal(model, p[:2], p[2:4], p[4:6], p[6], p[7])
        return jnp.where(valid, (model_signal - signal) / sigma, 0.0)

    def prior_residual(z):
        return prior * (z - mean)

    def cost(r, z):
        size = jnp.abs(r)
        h = jnp.where(size <= model.huber, 0.5 * r**2, model.huber * (size - 0.5 * model.huber))
        return jnp.sum(h) + 0.5 * jnp.sum(prior_residual(z) ** 2)

    jacobian = jax.jacfwd(data_residual)

    def normal(r, jac):
        weight = jnp.minimum(1.0, model.huber / jnp.maximum(jnp.abs(r), model.huber))
        return (jac.T * weight) @ jac + jnp.diag(prior**2), weight

    def step(carry, _):
        z, damping, last = carry
        r = data_residual(z)
        jac = jacobian(z)
        matrix, weight = normal(r, jac)
        gradient = jac.T @ (weight * r) + prior * prior_residual(z)
        delta = -jnp.linalg.solve(matrix + damping * jnp.diag(jnp.diag(matrix)), gradient)
        trial = z + delta
        better = cost(data_residual(trial), trial) <= cost(r, z)
        moved = jnp.hypot(delta[0] * scale[0], delta[1] * scale[1])
        return (
            jnp.where(better, trial, z),
            jnp.where(better, 0.1 * damping, 10.0 * damping),
            jnp.where(better, moved, last),
        ), None

    first = (mean, jnp.asarray(_DAMPING, scale.dtype), jnp.asarray(jnp.inf, scale.dtype))
    (z, _, moved), _ = jax.lax.scan(step, first, None, length=model.iterations)
    p = z * scale
    r = data_residual(z)
    matrix, _ = normal(r, jac := jacobian(z))
    inverse = jnp.linalg.inv(matrix) * scale[:, None] * scale[None, :]
    gain = (inverse[:2] / scale) @ jac.T * (model.noise_counts / sigma)
    count = jnp.maximum(jnp.sum(valid), 1)
    return PeakFit(
        location_m=p[:2],
        covariance_m2=inverse[:2, :2],
        noise_covariance_m2=gain @ gain.T,
        amplitude_counts=p[2:4],
        offset_counts=p[4:6],
        radius_m=p[6],
        gap_m=jnp.maximum(p[7], (_LEAST_DEPTH - 1.0) * model.column_depth_m),
        residual_counts=jnp.sqrt(jnp.sum(r**2) / count) * sigma,
        step_m=moved,
    )
