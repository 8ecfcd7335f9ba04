"""The estimate step: relinearise, bounded QP, advance (Navarro et al. 2020, eqs. 2 and 8 to 10).

At a state the body and its loads are linearised (`motion`), which gives the equilibrium's correction at
unchanged drives u, z₀, and the sensitivity t = dz/du of each drive. With W = ∂s/∂z t and the innovation e =
s_measured − s(z₀),

    Δu = argmin |L⁻¹ (e − W Δu)|² + Σ_j ε_j Δu_j²   subject to u_min ≤ u + Δu ≤ u_max

with the readings' covariance S = L Lᵀ, and, where strokes c(z, x) are limited, c_min ≤ c + (dc/du) Δu ≤
c_max;

then z = z₀ + t Δu. Where a contact's place is its forces' (`Limits.place`), a term (Σ a_i F_i)² / (σ_p F)² of
each joins the sum, a_i the forces' arms about the middle and F the contact's force before the step. ε damps
the step and leaves no bias once the steps have converged.

Where the places of contacts are not known exactly (`PlacePrior`), they are unknowns as well. A place is taken
to be o away from where it was seen, and really is T η away, η standard normal. With the sensitivity t_p of
the equilibrium to places and G = ∂s/∂z t_p,

    Δu, η = argmin |L⁻¹ (e + G o − W Δu − G T η)|² + |η|² + ...,   z = z₀ + t Δu + t_p (T η − o),

so that the readings tell where contacts are as far as what looks for them does not know. Steps that go on
from o = T η are Gauss and Newton's method for the most probable drives and places.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from softfuse.estimation.bounded_qp import Rows, solve_bounded_qp
from softfuse.estimation.limits import Limits
from softfuse.estimation.motion import motion
from softfuse.functional.chart import moved
from softfuse.mechanics.linear_solver import Solve
from softfuse.mechanics.load import Loads
from softfuse.mechanics.model import Model
from softfuse.mechanics.newton import tangent_at
from softfuse.mechanics.solution import State

_LEAST_FORCE_N = 0.05
"""A contact's force below which its place is held as if it were that large."""


class PlacePrior(NamedTuple):
    """What is known of the places of c contacts, along both tangents of each, before the readings.

    `offset` o (c, 2) [m]: how far contacts are taken to be from where they were seen; `spread` T (2 c, 2 c)
    [m]: the Cholesky factor of the covariance of where they are, zeros where that is known; `low`, `high` (c,
    2) [m]: how far they may be moved in this step.
    """

    offset: Float[Array | np.ndarray, "c 2"]
    spread: Float[Array | np.ndarray, "2*c 2*c"]
    low: Float[Array | np.ndarray, "c 2"]
    high: Float[Array | np.ndarray, "c 2"]


class Observation(NamedTuple):
    """What the sensors say in one frame: readings since rest (k,) in SI, L⁻¹ (k, k) that makes their errors
    standard normal (a column of zeros: ignore), the places (c, 3, 3) where contacts are taken to be, and what
    is known of these; None: all.
    """

    reading: Float[Array, " k"]
    whitening: Float[Array, "k k"]
    places: Array
    prior: PlacePrior | None = None

    @classmethod
    def on_host(cls, reading: Any, whitening: Any, places: Any, prior: Any = None) -> "Observation":
        """Of numpy's arrays, which a live step takes as they are."""
        return cls(reading, whitening, places, prior)

    def found_at(self, offset: Any) -> "Observation":
        """With contacts where a step found them, at an offset (c, 2) [m], if it was to find them."""
        if self.prior is None:
            return self
        places = moved(self.places, offset - self.prior.offset)
        return self._replace(places=places, prior=self.prior._replace(offset=offset))

    def heard(self, innovation: Float[Array, " k"]) -> Float[Array, " k"]:
        """An innovation (k,) whitened, without what is to be ignored, which may be no number."""
        ignored = jnp.all(self.whitening == 0, axis=0)
        return self.whitening @ jnp.where(ignored, 0.0, innovation)


class StepReport(NamedTuple):
    """How good a step was.

    `misfit` (k,): measured minus modelled reading after it; `compliance` (k, D): W; `by_place` (k, P): G per
    metre along the tangents of each contact, 0 where places are known; `information` (D + P, D + P): half the
    second derivative of the QP's cost in drives and the numbers η (P,) of places that are not known, the
    inverse covariance of those that are within their limits; `offset` (c, 2) [m]: o after it, None where
    places are known; `kkt`: optimality of the QP, in units of the drives; `taken` [-]: the part of the QP's
    step that was taken, below 1 where it was shortened to `Limits.motion`; `unbalanced` [N]: largest nodal
    force out of balance before it; `contraction` [-]: by how much the first refinement shrank the error of
    the linear solves (of a live step without refinements: how far the next one goes for what this one left
    out of balance, as a part of it); `least_volume_ratio` [-]: smallest det F after it; `truncation` [-]:
    what part of a reduced body's state its last modes are.
    """

    misfit: Float[Array, " k"]
    compliance: Float[Array, "k D"]
    by_place: Float[Array, "k P"]
    information: Float[Array, "DP DP"]
    offset: Float[Array | np.ndarray, "c 2"] | None
    kkt: Float[Array, ""]
    taken: Float[Array, ""]
    unbalanced: Float[Array, ""]
    contraction: Float[Array, ""]
    least_volume_ratio: Float[Array, ""]
    truncation: Float[Array | np.ndarray | np.float64, ""]


def strokes(model: Model, loads: Loads, state: State) -> Float[Array, " D"]:
    """What answers each drive (D,) in a state: see `AbstractLoad.conjugate`."""
    return loads.conjugate(state.force, state.internal, loads.values(model.body, state.z))


def _place_rows(
    model: Model, sigma: Float[Array, ""], places: Array, drive: Float[Array, " D"]
) -> Float[Array, "c D"]:
    """Rows A (c, D): A u is how far from its middle each contact presses, in standard deviations."""
    adding = model.adding(len(places))
    contacts, forces = adding.shape
    arms = jnp.concatenate([kind.arms for kind in model.kinds(contacts)])
    force = adding @ drive[:forces]
    rows = adding * arms / (sigma * jnp.maximum(force, _LEAST_FORCE_N))[:, None]
    return jnp.zeros((contacts, drive.shape[0])).at[:, :forces].set(rows)


def advance(
    model: Model,
    limits: Limits,
    inverse: Solve,
    state: State,
    seen: Observation,
    *,
    refinements: int,
    last: Float[Array, " n"],
    resistance: Float[Array, " n"] | None = None,
) -> tuple[State, StepReport]:
    """One estimate step with K⁻¹ as the map `inverse`, refined up to `refinements` times; the state after it,
    and its report. `last` (n,), `resistance` (n,): see `motion`.
    """
    prior, drives = seen.prior, state.drive.shape[0]
    moving = motion(
        model,
        inverse,
        state,
        seen.places,
        by_place=False if prior is None else jnp.any(prior.spread != 0),
        refinements=refinements,
        last=last,
        resistance=resistance,
    )
    value, w = moving.derivative(lambda s: model.reading(s, seen.places))
    innovation = seen.reading - value
    # Drives and places change by `scale` @ x − `back`, x = (Δu, η).
    unknowns = w.shape[1]
    scale, back = jnp.eye(unknowns), jnp.zeros(unknowns)
    endless = jnp.full(unknowns, jnp.inf)
    low, high = (
        end.at[:drives].set(limit - state.drive)
        for end, limit in ((-endless, limits.lower), (endless, limits.upper))
    )
    rows = Rows.none(unknowns)
    if prior is not None:
        scale = scale.at[drives:, drives:].set(prior.spread)
        back = back.at[drives:].set(jnp.ravel(prior.offset))
        ends = (jnp.ravel(end) + back[drives:] for end in (prior.low, prior.high))
        rows = rows.joined(Rows(scale[drives:], *ends))
    if limits.strokes is not None:
        loads = model.loads(seen.places)
        stroke, turn = moving.derivative(lambda s: strokes(model, loads, s))
        ends = (bound - stroke + turn @ back for bound in limits.strokes)
        rows = rows.joined(Rows(turn @ scale, *ends))
    whitened = seen.whitening @ w @ scale
    damping = jnp.ones(unknowns).at[:drives].set(limits.regularisation)
    hessian = whitened.T @ whitened + jnp.diag(damping)
    b = whitened.T @ seen.heard(innovation + w @ back)
    if limits.place is not None:
        around = _place_rows(model, limits.place, seen.places, state.drive)
        off, around = around @ state.drive, jnp.pad(around, ((0, 0), (0, unknowns - drives)))
        hessian, b = hessian + around.T @ around, b - around.T @ off
    found, kkt = solve_bounded_qp(hessian, b, low, high, rows)
    change, taken = scale @ found - back, jnp.ones(())
    if limits.motion is not None:
        farthest = jnp.max(jnp.abs(model.body.motion(moving.dz @ change)))
        taken = 1.0 / jnp.maximum(1.0, farthest / limits.motion)
    change = taken * change
    after = moving.after(change)
    return after, StepReport(
        innovation - w @ change,
        w[:, :drives],
        w[:, drives:],
        hessian,
        None if prior is None else (back + change)[drives:].reshape(prior.offset.shape),
        kkt,
        taken,
        jnp.max(jnp.abs(model.body.forces(moving.unbalanced))),
        moving.contraction,
        jnp.min(model.body.volume_ratios(after.z)).astype(float),
        model.body.truncation(after.z),
    )


def estimate_step(
    model: Model,
    limits: Limits,
    factor: PyTree[Array],
    state: State,
    seen: Observation,
    *,
    refinements: int = 2,
    last: Float[Array, " n"],
    resistance: Float[Array, " n"] | None = None,
) -> tuple[State, StepReport]:
    """The live step: an `advance` with a factor of a nearby tangent, by its solver. Pure; compiled once."""

    def inverse(b):
        return model.linear.solve(factor, b)

    return advance(
        model, limits, inverse, state, seen, refinements=refinements, last=last, resistance=resistance
    )


def exact_steps(
    model: Model, limits: Limits, state: State, seen: Observation, *, steps: int
) -> tuple[State, StepReport]:
    """`steps` estimate steps, each with its state's tangent; differentiable in everything, through all."""

    def step(carry, _):
        state, last, seen = carry
        inverse = tangent_at(
            model.linear, model.body.expecting(state.z, last), model.loads(seen.places), state
        )
        after, report = advance(model, limits, inverse, state, seen, refinements=0, last=last)
        return (after, after.z - state.z, seen.found_at(report.offset)), report

    (state, *_), reports = jax.lax.scan(step, (state, jnp.zeros_like(state.z), seen), length=steps)
    return state, jax.tree.map(lambda each: each[-1], reports)
