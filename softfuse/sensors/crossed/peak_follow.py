"""A contact's location followed from frame to frame: the fit of `peak_model`, begun where the last one ended.

A fit that begins anew starts at the profile's coarse middle and takes a fixed number of Levenberg-Marquardt
steps (`descend`). While something is near, two steps of Gauss and Newton (damped only after one that failed)
take the last frame's unknowns to this frame's minimum instead. The response f(q) does not depend on the
signals, so that f and its derivatives at the first step's end serve three times: for the second step, for the
covariance, and for the next frame's first step: one evaluation a frame is mostly all that it costs.

An electrode that lies (a broken trace that no longer answers, a reading that is stuck since the touch) has
too much leverage on eight unknowns for a robust cost to help. So what the followed fit does not explain, a
misfit above `outlier` or a step that still moves, is searched for one, with one fit a frame: all electrodes,
anew; then all but the first, all but the second and so on, from the coarse middle that the others tell and in
few steps; then, anew and in full, without the one whose absence left least. That electrode is named when its
absence mends the fit (`_MENDED`), and this fit goes on; else the round begins again. So e electrodes take
e + 1 frames from the first with a misfit: of 16, one that lies is named 17 frames later, 0.17 s at 100 Hz.
Until then the location is that of all electrodes, with a covariance that grows with the misfit. A frame that
the fit explains takes the round one fit back.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from softfuse.sensors.crossed.peak_model import (
    SHAPE,
    UNKNOWNS,
    Evidence,
    LinearShape,
    Minimum,
    PeakFit,
    PeakModel,
    PeakShape,
    evidence_of,
    minimum_at,
    peak_found,
    peak_shape,
)

_MENDED = 0.3
"""Of the residual, a tenth of its square: what is left when a lying electrode is left out."""
_FIRST_DAMPING = 1.0  # of the diagonal, beginning anew: a start up to half a pitch off does not overshoot
_SETTLED = 5e-3  # of the pitch: a last step below it has converged, its error is its square
_CLOSE = 5e-4  # of the pitch, 4 um of 8 mm: what a last step below it leaves to go is a fraction of it
_DAMPING = 1e-3  # of the diagonal, after a step that failed
_BRIEF_STEPS = 4  # enough to tell which electrode's absence helps most


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
    first = (z, linear, residual, *(jnp.asarray(value, z.dtype) for value in (_FIRST_DAMPING, jnp.inf)))
    (z, linear, _, _, moved), _ = jax.lax.scan(step, first, None, length=steps)
    return z, linear, moved


class PeakTrack(eqx.Module):
    """Memory between frames."""

    known: Bool[Array, ""]
    """There is a fit to go on from."""
    unknowns: Float[Array, "8"]
    """(8,) the last frame's."""
    shape: LinearShape
    """The response near them."""
    damping: Float[Array, ""]
    """Of the next step."""
    turn: Int[Array, ""]
    """Fits of this round that have been tried; 0 while all is explained."""
    least: Float[Array, ""]
    """Smallest residual without an electrode in this round, as part of that with all [-]."""
    suspect: Int[Array, ""]
    """The electrode whose absence left it."""


def no_peak(model: PeakModel) -> PeakTrack:
    """The memory while nothing is near."""
    e = model.row_y_m.shape[0] + model.column_x_m.shape[0]
    return PeakTrack(
        known=jnp.asarray(False),
        unknowns=jnp.zeros(UNKNOWNS),
        shape=LinearShape(jnp.zeros(4), jnp.zeros(e), jnp.zeros((e, 4))),
        damping=jnp.zeros(()),
        turn=jnp.zeros((), int),
        least=jnp.full((), jnp.inf, float),
        suspect=jnp.zeros((), int),
    )


def follow_peak(
    model: PeakModel, track: PeakTrack, signal: Float[Array, " e"], valid: Bool[Array, " e"]
) -> tuple[PeakTrack, PeakFit, Bool[Array, " e"]]:
    """One frame in which something is near.

    Args: signal (r + c,) counts above the baseline, rows first; valid (r + c,), the others are left out. An
    electrode that was named must be among those in the following frames.
    Returns: the new memory, the PeakFit, and honest (r + c,): valid without an electrode that this frame has
    named.
    """
    e = signal.shape[0]
    shape = peak_shape(model)

    def without(suspect: Int[Array, ""]) -> Bool[Array, " e"]:
        return valid & (jnp.arange(e) != suspect)

    def anew(taking: Bool[Array, " e"], steps: int) -> tuple[Minimum, Float[Array, "8"]]:
        start, linear = coarse_unknowns(model, shape, signal, taking)
        evidence = evidence_of(model, signal, taking, start)
        z, linear, moved = descend(shape, evidence, start / evidence.scale, linear, steps)
        return minimum_at(evidence, z, linear, moved), z * evidence.scale

    evidence = evidence_of(model, signal, valid, track.unknowns)
    whole = jax.lax.cond(
        track.known, lambda: _followed(shape, track, evidence), lambda: _unknown(track, signal)
    )
    expected = whole.cost <= model.outlier**2 * jnp.maximum(jnp.sum(valid), 1)
    explained = expected & (whole.moved_m < _SETTLED * evidence.scale[0])
    turn = jnp.where(track.known, track.turn, 0)
    one_left_out = ~explained & (turn > 0) & (turn <= e)

    def brief():
        found, unknowns = anew(without(turn - 1), _BRIEF_STEPS)
        share = jnp.where(valid[turn - 1], found.rms / whole.rms, jnp.inf)
        less = share < track.least
        # What has gone astray comes back: all electrodes may like this place better than where it is.
        there = minimum_at(evidence, unknowns / evidence.scale, found.shape, found.moved_m)
        suspect = jnp.where(less, turn - 1, track.suspect)
        return jnp.minimum(share, track.least), suspect, _lower(there, whole)

    def begun():
        return jnp.where(turn > 0, track.least, jnp.inf), track.suspect, whole

    least, suspect, whole = jax.lax.cond(one_left_out, brief, begun)

    def full():
        judging = turn > e
        taking = jnp.where(judging, without(suspect), valid)
        found, _ = anew(taking, model.iterations)
        mends = judging & (found.rms < _MENDED * whole.rms)
        chosen = _chosen(mends, found, _chosen(judging, whole, _lower(found, whole)))
        return chosen, jnp.where(mends, taking, valid)

    found, honest = jax.lax.cond(~explained & ~one_left_out, full, lambda: (whole, valid))
    fit = peak_found(evidence_of(model, signal, honest, track.unknowns), found)
    later = PeakTrack(
        known=jnp.all(jnp.isfinite(fit.unknowns)),
        unknowns=fit.unknowns,
        shape=found.shape,
        damping=found.damping,
        turn=jnp.where(explained, jnp.maximum(turn - 1, 0), jnp.where(turn > e, 0, turn + 1)),
        least=least,
        suspect=suspect,
    )
    return later, fit, honest


def _chosen(condition: Bool[Array, ""], one: Minimum, other: Minimum) -> Minimum:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), one, other)


def _lower(one: Minimum, other: Minimum) -> Minimum:
    """The one with the lower cost."""
    return _chosen(one.cost < other.cost, one, other)


def _unknown(track: PeakTrack, signal: Float[Array, " e"]) -> Minimum:
    """Where nothing has been fitted yet: anything explains more."""
    never = jnp.full((), jnp.inf, signal.dtype)
    nothing = jnp.zeros((signal.shape[0], UNKNOWNS), signal.dtype)
    return Minimum(track.unknowns, track.shape, signal, nothing, never, never, jnp.zeros_like(never))


def _followed(shape: PeakShape, track: PeakTrack, evidence: Evidence) -> Minimum:
    """Two steps from the last frame's unknowns with one evaluation of the response between them, and another
    of both after a long one.
    """
    scale = evidence.scale
    z = track.unknowns / scale
    before = evidence.residual(z, track.shape.at(track.unknowns[SHAPE]))
    trial = z + evidence.step(z, before, evidence.jacobian(z, track.shape), track.damping)
    there = shape.linear((trial * scale)[SHAPE])
    left = evidence.residual(trial, there.response)
    better = evidence.cost(trial, left) <= evidence.cost(z, before)
    z, linear, residual = jax.tree.map(
        lambda new, old: jnp.where(better, new, old), (trial, there, left), (z, track.shape, before)
    )
    damping = jnp.where(better, 0.1 * track.damping, jnp.maximum(10.0 * track.damping, _DAMPING))
    damping = jnp.where(damping < _DAMPING, 0.0, damping)
    delta = evidence.step(z, residual, evidence.jacobian(z, linear), damping)

    def again():
        there = shape.linear(((z + delta) * scale)[SHAPE])
        left = evidence.residual(z + delta, there.response)
        better = evidence.cost(z + delta, left) <= evidence.cost(z, residual)
        at, near, rest = jax.tree.map(
            lambda new, old: jnp.where(better, new, old), (z + delta, there, left), (z, linear, residual)
        )
        return at, near, evidence.step(at, rest, evidence.jacobian(at, near), damping)

    far = jnp.hypot(delta[0] * scale[0], delta[1] * scale[1]) > _CLOSE * scale[0]
    z, linear, delta = jax.lax.cond(far, again, lambda: (z, linear, delta))
    moved = jnp.hypot(delta[0] * scale[0], delta[1] * scale[1])
    # A long step is for the next frame to take, from where it can be told whether it leads down.
    z = jnp.where(moved < _SETTLED * scale[0], z + delta, z)
    found = minimum_at(evidence, z, linear, moved)
    return eqx.tree_at(lambda m: m.damping, found, damping)
