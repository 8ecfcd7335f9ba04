"""What a contact leaves on crossed lines of electrodes, and how well unknowns explain a profile.

Unknowns p = (x, y, A_row, A_col, o_row, o_col, R, g): the axis of a grounded cylinder [m], one amplitude and
one offset [counts] for the rows and one for the columns (other things that couple to every line, such as the
hand behind a finger), the cylinder's radius R [m] and the air gap g [m] that adds to the depth of the
electrodes. The signals are

    s_i = A f_i(x, y, R, d + g) + o,

f being `diamond_array.array_response`. The profile ends where the array ends, in the measurement and in the
model, hence no border bias. What speaks for p is the least of

    sum_i ((s_i - A f_i - o) / sigma)^2 + |(o, R - R0, g) / prior|^2,

with sigma^2 = noise^2 + (model_error * largest signal)^2, because the noise of the counts is far below what a
model of the peak can promise. Only the four unknowns q = (x, y, R, g) of the shape f enter in a nonlinear
way.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from softfuse.sensors.crossed.diamond_array import (
    ArrayPoints,
    array_points,
    array_response,
    array_slopes,
    mean_pitch,
)

SHAPE = np.array([0, 1, 6, 7])
"""x, y, R, g among the unknowns."""
UNKNOWNS = 8
_LEAST_DEPTH = 0.3
"""Of the electrode's own depth: a negative gap means a dented body, not a pierced one."""
_WEAK_PRIOR = 1e-2


class PeakModel(eqx.Module):
    """Where the electrode lines are and what is assumed about what touches them; every field but one is a
    leaf."""

    row_y_m: Float[Array, " r"]
    """(r,) y of the rows' centre lines [m], ascending."""
    column_x_m: Float[Array, " c"]
    """(c,) x of the columns' centre lines [m], ascending."""
    row_depth_m: Float[Array, ""]
    """Depth of the rows below the body's top [m]."""
    column_depth_m: Float[Array, ""]
    """Depth of the columns below the body's top [m]."""
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
    """Number of Levenberg-Marquardt steps of a fit that begins anew."""


class PeakFit(eqx.Module):
    """The fitted cylinder."""

    unknowns: Float[Array, "8"]
    """(8,) see the module's docstring."""
    covariance_m2: Float[Array, "2 2"]
    """(2, 2) covariance of the location from noise, model misfit and priors [m^2]."""
    widening: Float[Array, ""]
    """By how much, at least 1, the misfit makes the covariance larger (Birge's ratio) [-]."""
    residual_counts: Float[Array, ""]
    """Root mean square residual over the valid electrodes [counts]."""

    @property
    def location_m(self) -> Float[Array, "2"]:
        """(2,) x, y [m]."""
        return self.unknowns[..., :2]


class PeakShape(eqx.Module):
    """Response of all electrodes (r + c,), rows first, as a function of q = (x, y, R, g) [m]."""

    points: ArrayPoints
    depth_m: Float[Array, " e"]
    """(r + c,) of the electrodes below the body's top [m]."""

    def __call__(self, q: Float[Array, "4"]) -> Float[Array, " e"]:
        """The response, dimensionless."""
        return array_response(self.points, q[:2], q[2], self._depth(q[3]))

    def linear(self, q: Float[Array, "4"]) -> "LinearShape":
        """The response and its derivatives at q."""
        response, slopes = array_slopes(self.points, q[:2], q[2], self._depth(q[3]))
        # A gap that would leave less than the least depth moves nothing.
        moves = self.depth_m + q[3] > _LEAST_DEPTH * self.depth_m
        return LinearShape(q, response, slopes.at[:, 3].multiply(moves))

    def _depth(self, gap_m: Float[Array, ""]) -> Float[Array, " e"]:
        return jnp.maximum(self.depth_m + gap_m, _LEAST_DEPTH * self.depth_m)


class LinearShape(eqx.Module):
    """A response near q = (x, y, R, g) [m]."""

    q: Float[Array, "4"]
    response: Float[Array, " e"]
    slopes: Float[Array, "e 4"]
    """(r + c, 4) derivatives of the response by q [1/m]."""

    def at(self, q: Float[Array, "4"]) -> Float[Array, " e"]:
        """The response at another q, to first order."""
        return self.response + self.slopes @ (q - self.q)


def peak_shape(model: PeakModel) -> PeakShape:
    """The response that a model expects; what does not depend on its argument is computed here, once: when a
    program is compiled, where the model is a constant of it.
    """
    with jax.ensure_compile_time_eval():
        return line_shape(model)


@eqx.filter_jit
def line_shape(model: PeakModel) -> PeakShape:
    """The same, differentiable in the model."""
    points = array_points(model.row_y_m, model.column_x_m, model.row_rim_m, model.column_rim_m)
    depth = peak_layers(model) @ jnp.stack([model.row_depth_m, model.column_depth_m])
    return PeakShape(points, depth)


def peak_layers(model: PeakModel) -> Float[Array, "e 2"]:
    """Which electrode is a row, which a column: (r + c, 2) of ones and zeros."""
    is_column = np.arange(model.row_y_m.shape[0] + model.column_x_m.shape[0]) >= model.row_y_m.shape[0]
    return jnp.asarray(np.stack([~is_column, is_column], axis=1), model.row_y_m.dtype)


class Evidence(eqx.Module):
    """The signals of one frame and what is known beforehand, in units of order one.

    z = p / scale: where there is a prior, its standard deviation is the unit. The weak prior on amplitude and
    location (a hundred units wide) only keeps the normal matrix regular when electrodes are missing.
    """

    signal: Float[Array, " e"]
    """(r + c,) [counts], 0 where it takes no part."""
    weight: Float[Array, " e"]
    """(r + c,) 1 / sigma, 0 where it takes no part [1/counts]."""
    sigma: Float[Array, ""]
    """Standard deviation of a signal from the model's [counts]."""
    scale: Float[Array, "8"]
    """(8,) units of the unknowns p."""
    mean: Float[Array, "8"]
    """(8,) of the prior, in these units."""
    prior: Float[Array, "8"]
    """(8,) one over the standard deviations of the prior, in these units."""
    layer: Float[Array, "e 2"]
    """(r + c, 2) which electrode is a row, which a column."""

    def residual(self, z: Float[Array, "8"], response: Float[Array, " e"]) -> Float[Array, " e"]:
        """Modelled minus measured (r + c,) [standard deviations], for the response at z."""
        p = z * self.scale
        modelled = self.layer @ p[2:4] * response + self.layer @ p[4:6]
        return self.weight * (modelled - self.signal)

    def jacobian(self, z: Float[Array, "8"], shape: LinearShape) -> Float[Array, "e 8"]:
        """Derivatives (r + c, 8) of the residual by z, for a response that is linear about z."""
        p = z * self.scale
        slope = (self.layer @ p[2:4])[:, None] * shape.slopes
        response = shape.at(p[SHAPE])
        jac = jnp.concatenate(
            [slope[:, :2], self.layer * response[:, None], self.layer, slope[:, 2:]], axis=1
        )
        return self.weight[:, None] * jac * self.scale

    def cost(self, z: Float[Array, "8"], residual: Float[Array, " e"]) -> Float[Array, ""]:
        """What is to be made least, for the residual at z."""
        return jnp.sum(residual**2) + jnp.sum((self.prior * (z - self.mean)) ** 2)

    def step(
        self,
        z: Float[Array, "8"],
        residual: Float[Array, " e"],
        jacobian: Float[Array, "e 8"],
        damping: Float[Array, ""],
    ) -> Float[Array, "8"]:
        """The Levenberg-Marquardt step (8,) from z, damped by that part of the diagonal."""
        matrix = self.information(jacobian)
        gradient = jacobian.T @ residual + self.prior**2 * (z - self.mean)
        return -jnp.linalg.solve(matrix + damping * jnp.diag(jnp.diag(matrix)), gradient)

    def information(self, jacobian: Float[Array, "e 8"]) -> Float[Array, "8 8"]:
        """The normal matrix (8, 8): data and prior."""
        return jacobian.T @ jacobian + jnp.diag(self.prior**2)


def evidence_of(
    model: PeakModel,
    signal: Float[Array, " e"],
    valid: Bool[Array, " e"],
    about: Float[Array, "8"],
) -> Evidence:
    """The evidence in one frame.

    Args: signal (r + c,) counts above the baseline, rows first; valid (r + c,), the others are left out;
    about (8,): unknowns where the weak prior of location and amplitude has its middle. Offsets and gap are
    expected at zero, the radius at the model's.
    """
    signal = jnp.where(valid, signal, 0.0)
    peak = jnp.max(jnp.abs(signal))
    sigma = jnp.sqrt(model.noise_counts**2 + (model.model_error * peak) ** 2)
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
    expected = jnp.where(np.arange(UNKNOWNS) < 4, about, jnp.zeros(UNKNOWNS).at[6].set(model.radius_m))
    return Evidence(
        signal=signal,
        weight=jnp.where(valid, 1.0 / sigma, 0.0),
        sigma=sigma,
        scale=scale,
        mean=expected / scale,
        prior=jnp.asarray([_WEAK_PRIOR] * 4 + [1.0] * 4),
        layer=peak_layers(model),
    )


class Minimum(eqx.Module):
    """Where a fit has come to."""

    z: Float[Array, "8"]
    """(8,) unknowns in the evidence's units."""
    shape: LinearShape
    """The response near them."""
    residual: Float[Array, " e"]
    """(r + c,) modelled minus measured [standard deviations], 0 where it takes no part."""
    jacobian: Float[Array, "e 8"]
    """(r + c, 8) its derivatives by z."""
    cost: Float[Array, ""]
    """What was to be made least."""
    moved_m: Float[Array, ""]
    """Length of the last step of the location [m]."""
    damping: Float[Array, ""]
    """For a step from here, part of the diagonal."""

    @property
    def rms(self) -> Float[Array, ""]:
        """Root mean square residual of the electrodes that took part [standard deviations]."""
        return jnp.sqrt(jnp.sum(self.residual**2) / jnp.maximum(jnp.sum(self.residual != 0.0), 1))


def minimum_at(
    evidence: Evidence, z: Float[Array, "8"], shape: LinearShape, moved_m: Float[Array, ""]
) -> Minimum:
    """What a fit has found at z, near which the response is known."""
    residual = evidence.residual(z, shape.at((z * evidence.scale)[SHAPE]))
    cost, none = evidence.cost(z, residual), jnp.zeros_like(moved_m)
    return Minimum(z, shape, residual, evidence.jacobian(z, shape), cost, moved_m, none)


def peak_found(evidence: Evidence, found: Minimum) -> PeakFit:
    """The cylinder at a minimum and how well it is known."""
    scale = evidence.scale
    inverse = jnp.linalg.inv(evidence.information(found.jacobian)) * scale[:, None] * scale[None, :]
    count = jnp.sum(evidence.weight > 0.0)
    # A misfit beyond the expected one widens the covariance in proportion.
    widening = jnp.maximum(1.0, found.cost / jnp.maximum(count - UNKNOWNS, 1))
    mean_square = jnp.sum(found.residual**2) / jnp.maximum(count, 1)
    return PeakFit(
        unknowns=found.z * scale,
        covariance_m2=widening * inverse[:2, :2],
        widening=widening,
        residual_counts=jnp.sqrt(mean_square) * evidence.sigma,
    )
