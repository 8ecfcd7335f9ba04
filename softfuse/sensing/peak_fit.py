"""Location of a contact by fitting the profiles of rows and columns to the response of a cylinder.

Unknowns p = (x, y, A_row, A_col, o_row, o_col, R, g): the axis of a grounded cylinder [m], one amplitude and
one offset [counts] for the rows and one for the columns (other things that couple to every line, such as the
hand behind a finger), the cylinder's radius R [m] and the air gap g [m] that adds to the depth of the
electrodes. The fit is

    min_p  sum_i ((s_i - A f_i(x, y, R, d + g) - o) / sigma)^2 + |(o, R - R0, g) / prior|^2,

f being `diamond_array.array_response` and sigma^2 = noise^2 + (model_error * largest signal)^2, because the
noise of the counts is far below what a model of the peak can promise. The profile ends where the array ends,
in the measurement and in the model, hence no border bias. Solved by a fixed number of Levenberg-Marquardt
steps; derivatives by the implicit function theorem at the minimum.

An electrode that lies (a broken trace that no longer answers, a reading that is stuck since the touch) has
too much leverage on eight unknowns for a robust cost to help. So `fit_peak_of_honest`, when the residual is
bad, fits anew without each electrode in turn and leaves out the one whose absence mends the fit.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from softfuse.sensing.diamond_array import array_response, line_points, mean_pitch

_DAMPING = 1.0  # of the diagonal: a start up to half a pitch off does not overshoot
_WEAK_PRIOR = 1e-2
_UNKNOWNS = 8
_SHAPE = np.array([0, 1, 6, 7])  # x, y, R, g among the unknowns
_MENDED = 0.3  # of the residual: a tenth of its square
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
    outlier: Float[Array, ""]
    """Root mean square residual from which a lying electrode is looked for [standard deviations]."""
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
    chi_squared: Float[Array, ""]
    """Minimum of the cost in the module's docstring."""
    step_m: Float[Array, ""]
    """Length of the last accepted step of the location [m]: tells whether the fit has converged."""


def peak_model(
    row_y_m: Float[ArrayLike, " r"],
    column_x_m: Float[ArrayLike, " c"],
    row_depth_m: float,
    column_depth_m: float,
    *,
    radius_m: float = 10e-3,
    radius_sigma_m: float = 0.5e-3,
    gap_sigma_m: float = 0.5e-3,
    offset_sigma_counts: float = 100.0,
    noise_counts: float = 8.0,
    model_error: float = 0.005,
    outlier: float = 3.0,
    iterations: int = 8,
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
        outlier=jnp.asarray(outlier, float),
        iterations=iterations,
    )


def peak_response(
    model: PeakModel,
) -> Callable[[Float[Array, "2"], Float[Array, ""], Float[Array, ""]], Float[Array, " e"]]:
    """Function of location (2,) [m], radius [m] and gap [m] that returns all electrodes' response (r + c,).

    What does not depend on its arguments is computed once, here.
    """
    rows = line_points(model.row_y_m, model.column_x_m, model.row_rim_m)
    columns = line_points(model.column_x_m, model.row_y_m, model.column_rim_m)
    pitch = mean_pitch(model.row_y_m)

    def response(location_m, radius_m, gap_m):
        row_depth = jnp.maximum(model.row_depth_m + gap_m, _LEAST_DEPTH * model.row_depth_m)
        column_depth = jnp.maximum(model.column_depth_m + gap_m, _LEAST_DEPTH * model.column_depth_m)
        return array_response(rows, columns, location_m, radius_m, row_depth, column_depth, pitch)

    return response


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
    response = peak_response(model)(location_m, radius_m, gap_m)
    layer = _layer(model)
    return layer @ amplitude_counts * response + layer @ offset_counts


def _layer(model: PeakModel) -> Float[Array, "e 2"]:
    """Which electrode is a row, which a column: (r + c, 2) of ones and zeros."""
    is_column = np.arange(model.row_y_m.shape[0] + model.column_x_m.shape[0]) >= model.row_y_m.shape[0]
    return jnp.asarray(np.stack([~is_column, is_column], axis=1), model.row_y_m.dtype)


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
    shape = peak_response(model)(jnp.stack([x, y]), model.radius_m, jnp.zeros_like(model.radius_m))

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
    # Unknowns in units of order one: where there is a prior, its standard deviation. The weak prior on
    # amplitude and location (a hundred units wide) only keeps the normal matrix regular when electrodes are
    # missing.
    scale = jnp.stack(
        [
            mean_pitch(model.column_x_m),
            mean_pitch(model.row_y_m),
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

    response = peak_response(model)
    layer = _layer(model)

    def shape(q):
        return response(q[:2], q[2], q[3])

    def data_residual(z):
        p = z * scale
        modelled = layer @ p[2:4] * shape(p[_SHAPE]) + layer @ p[4:6]
        return jnp.where(valid, (modelled - signal) / sigma, 0.0)

    def residual_and_jacobian(z):
        p = z * scale
        # Amplitudes and offsets enter linearly: only the shape's four unknowns need a derivative.
        slope, f = jax.jacfwd(lambda q: (shape(q),) * 2, has_aux=True)(p[_SHAPE])
        gain = layer @ p[2:4]
        modelled = gain * f + layer @ p[4:6]
        slope = gain[:, None] * slope
        jac = jnp.concatenate([slope[:, :2], layer * f[:, None], layer, slope[:, 2:]], axis=1) * scale
        keep = jnp.where(valid, 1.0 / sigma, 0.0)
        return keep * (modelled - signal), keep[:, None] * jac

    def prior_residual(z):
        return prior * (z - mean)

    def cost(r, z):
        return jnp.sum(r**2) + jnp.sum(prior_residual(z) ** 2)

    def step(carry, _):
        z, damping, last = carry
        r, jac = residual_and_jacobian(z)
        matrix = jac.T @ jac + jnp.diag(prior**2)
        gradient = jac.T @ r + prior * prior_residual(z)
        delta = -jnp.linalg.solve(matrix + damping * jnp.diag(jnp.diag(matrix)), gradient)
        trial = z + delta
        better = cost(data_residual(trial), trial) <= cost(r, z)
        moved = jnp.hypot(delta[0] * scale[0], delta[1] * scale[1])
        return (
            jnp.where(better, trial, z),
            jnp.where(better, 0.1 * damping, 10.0 * damping),
            jnp.where(better, moved, last),
        ), None

    def minimise(_, start_z):
        first = (start_z, jnp.asarray(_DAMPING, scale.dtype), jnp.asarray(jnp.inf, scale.dtype))
        (z, _, moved), _ = jax.lax.scan(step, first, None, length=model.iterations)
        return z, moved

    # Derivatives come from the implicit function theorem at the minimum, not from the steps that led there.
    z, moved = jax.lax.custom_root(
        jax.grad(lambda z: 0.5 * cost(data_residual(z), z)),
        jax.lax.stop_gradient(mean),
        minimise,
        lambda linear, rhs: jnp.linalg.solve(jax.jacfwd(linear)(rhs), rhs),
        has_aux=True,
    )
    p = z * scale
    r, jac = residual_and_jacobian(z)
    inverse = jnp.linalg.inv(jac.T @ jac + jnp.diag(prior**2)) * scale[:, None] * scale[None, :]
    gain = (inverse[:2] / scale) @ jac.T * (model.noise_counts / sigma)
    count = jnp.maximum(jnp.sum(valid), 1)
    # A misfit beyond the expected one widens the covariance in proportion (Birge's ratio).
    least = cost(r, z)
    inverse = inverse * jnp.maximum(1.0, least / jnp.maximum(jnp.sum(valid) - _UNKNOWNS, 1))
    return PeakFit(
        location_m=p[:2],
        covariance_m2=inverse[:2, :2],
        noise_covariance_m2=gain @ gain.T,
        amplitude_counts=p[2:4],
        offset_counts=p[4:6],
        radius_m=p[6],
        gap_m=jnp.maximum(p[7], (_LEAST_DEPTH - 1.0) * model.column_depth_m),
        residual_counts=jnp.sqrt(jnp.sum(r**2) / count) * sigma,
        chi_squared=least,
        step_m=moved,
    )


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
        mends = error[best] < _MENDED * whole.residual_counts
        chosen = jax.tree.map(lambda one, all_: jnp.where(mends, one[best], all_), fits, whole)
        return chosen, jnp.where(mends, without[best], valid)

    return jax.lax.cond(bad, search, lambda: (whole, valid))
