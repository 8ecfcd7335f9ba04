"""The estimate step: relinearise, bounded QP, advance (Navarro et al. 2020, eqs. 2 and 8 to 10).

At a state the body is linearised, the loads find their forces x on it at unchanged drives u (`interface`),
and the linear system around them,

    K δz − G_f δf = −(r(z) − G_f f),    E_x δx + E_y Gᵀ δz + E_u δu = −E,

gives the equilibrium's correction at δu = 0, z₀, and the sensitivity t = dz/du of each drive. With W = ∂s/∂z
t and the innovation e = s_measured − s(z₀),

    Δu = argmin |L⁻¹ (e − W Δu)|² + Σ_j ε_j Δu_j²   subject to u_min ≤ u + Δu ≤ u_max

with the readings' covariance S = L Lᵀ, and, where strokes c(z, x) are limited, c_min ≤ c + (dc/du) Δu ≤
c_max;

then z = z₀ + t Δu. Where a contact's place is its forces' (`Limits.place`), a term (Σ a_i F_i)² / (σ_p F)² of
each joins the sum, a_i the forces' arms about the middle and F the contact's force before the step. ε damps
the step and leaves no bias once the steps have converged. The factor of K may belong to an older tangent:
refinements with the tangent's own action make up for it, and their first contraction is returned so that the
caller knows when a new factor pays. A second refinement is made only where the first did not come close, and
z₀ is refined only where its error would be felt.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PyTree

from softfuse.equilibrium.interface import slopes
from softfuse.equilibrium.linear_solver import Solve
from softfuse.equilibrium.linearised import coupled, linearise, settled_on, stiffness_map
from softfuse.equilibrium.load import Loads
from softfuse.equilibrium.newton import tangent_at
from softfuse.equilibrium.solution import State
from softfuse.estimation.bounded_qp import Rows, solve_bounded_qp
from softfuse.estimation.device import Device
from softfuse.estimation.limits import Limits

_CLOSE = 0.15
"""A first refinement that is smaller than this part of the solution leaves an error of its square."""

_UNFELT = 1e-4
"""An error of the correction that is smaller than this part of the state is left to the next step."""

_LEAST_FORCE_N = 0.05
"""A contact's force below which its place is held as if it were that large."""


class Observation(NamedTuple):
    """What the sensors say in one frame: readings since rest (k,) in SI, L⁻¹ (k, k) that makes their errors
    standard normal (a column of zeros: ignore), and the places (c, ...) of contacts.
    """

    reading: Float[Array, " k"]
    whitening: Float[Array, "k k"]
    places: Array

    @classmethod
    def on_host(cls, reading: Any, whitening: Any, places: Any) -> "Observation":
        """Of numpy's arrays, which a live step takes as they are."""
        return cls(reading, whitening, places)

    def heard(self, innovation: Float[Array, " k"]) -> Float[Array, " k"]:
        """An innovation (k,) whitened, without what is to be ignored, which may be no number."""
        ignored = jnp.all(self.whitening == 0, axis=0)
        return self.whitening @ jnp.where(ignored, 0.0, innovation)


class StepReport(NamedTuple):
    """How good a step was.

    `misfit` (k,): measured minus modelled reading after it; `compliance` (k, D): W; `information` (D, D):
    half the second derivative of the QP's cost, the inverse covariance of drives that are within their
    limits; `kkt`: optimality of the QP, in units of the drives; `taken` [-]: the part of the QP's step that
    was taken, below 1 where it was shortened to `Limits.motion`; `unbalanced` [N]: largest nodal force out of
    balance before it; `contraction` [-]: by how much the first refinement shrank the error of the linear
    solves (of a live step without refinements: how far the next one goes for what this one left out of
    balance, as a part of it); `least_volume_ratio` [-]: smallest det F after it; `truncation` [-]: what part
    of a reduced body's state its last modes are.
    """

    misfit: Float[Array, " k"]
    compliance: Float[Array, "k D"]
    information: Float[Array, "D D"]
    kkt: Float[Array, ""]
    taken: Float[Array, ""]
    unbalanced: Float[Array, ""]
    contraction: Float[Array, ""]
    least_volume_ratio: Float[Array, ""]
    truncation: Float[Array | np.ndarray, ""]


def strokes(device: Device, loads: Loads, state: State) -> Float[Array, " D"]:
    """What answers each drive (D,) in a state: see `AbstractLoad.conjugate`."""
    return loads.conjugate(state.force, state.internal, loads.values(device.body, state.z))


def _moved(state: State, dz: Float[Array, " n"], dx: Float[Array, " r"]) -> State:
    q = state.force.shape[0]
    return State(state.z + dz, state.force + dx[:q], state.internal + dx[q:], state.drive)


def _place_rows(
    device: Device, sigma: Float[Array, ""], places: Array, drive: Float[Array, " D"]
) -> Float[Array, "c D"]:
    """Rows A (c, D): A u is how far from its middle each contact presses, in standard deviations."""
    arms = jax.vmap(device.contact.arms)(places)
    contacts, each = arms.shape
    force = drive[: contacts * each].reshape(contacts, each).sum(axis=1)
    rows = arms / (sigma * jnp.maximum(force, _LEAST_FORCE_N))[:, None]
    spread = jnp.eye(contacts)[:, :, None] * rows[:, None, :]
    return jnp.zeros((contacts, drive.shape[0])).at[:, : contacts * each].set(spread.reshape(contacts, -1))


class _Solved(NamedTuple):
    """Motions (n, j), changes of the loads' unknowns (r, j), and the first refinement's contraction."""

    dz: Float[Array, "n j"]
    dx: Float[Array, "r j"]
    contraction: Float[Array, ""]


def _refined(
    solved: tuple[Float[Array, "n j"], Float[Array, "r j"]],
    improve: Callable,
    motion: Callable,
    refinements: int,
    wanted: Bool[Array, ""] | bool = True,
) -> _Solved:
    """Up to so many refinements by `improve`, (dz, dx) ↦ (ddz, ddx): the first where it is `wanted`, others
    only where that was not close; `motion` of unknowns is what norms are taken of.
    """

    def refine(at: _Solved, first: Array) -> _Solved:
        ddz, ddx = improve(at.dz, at.dx)
        size, change = (jnp.linalg.norm(motion(each), axis=0) for each in (at.dz, ddz))
        contraction = jnp.where(first, jnp.max(change / (size + 1e-12)), at.contraction)
        return _Solved(at.dz + ddz, at.dx + ddx, contraction)

    def next_one(at: _Solved, first: Array) -> tuple[_Solved, None]:
        # Not `>=`: a contraction that is no number goes on, and stays none.
        close = jnp.where(first, jnp.logical_not(wanted), at.contraction < _CLOSE)
        return jax.lax.cond(close, lambda at, _: at, refine, at, first), None

    # A loop, so that the solve, the largest part of the step's program, is compiled once for all of them.
    return jax.lax.scan(next_one, _Solved(*solved, jnp.zeros(())), jnp.arange(refinements) == 0)[0]


def advance(
    device: Device,
    limits: Limits,
    inverse: Solve,
    state: State,
    seen: Observation,
    *,
    refinements: int,
    resistance: Float[Array, " n"] | None = None,
) -> tuple[State, StepReport]:
    """One estimate step with K⁻¹ as the map `inverse`, refined up to `refinements` times; the state after it,
    and its report. `resistance` (n,): r(z) of the state, where it is known.
    """
    body, loads = device.body, device.loads(seen.places)
    linear = linearise(body, loads, inverse, state, resistance)
    held = linear.held
    settled, y = settled_on(linear, state)
    x, q, drives = (settled.force, settled.internal), settled.force.shape[0], state.drive.shape[0]
    slope = slopes(held, x, y, state.drive)
    system = coupled(loads, linear, slope)
    pushed = system.pushed
    at = State(state.z, settled.force, settled.internal, state.drive)
    stiffness = stiffness_map(body, loads, at)

    def improving(load, law):
        def improve(dz, dx):
            left = load + pushed @ dx[:q] - stiffness(dz)
            return system.respond(inverse(left), law - slope.x @ dx - slope.y @ (linear.rows.T @ dz))

        return improve

    # The correction at unchanged drives, of which the body's part is known, and the sensitivity to drives,
    # which move the body through the laws only.
    load = pushed @ (settled.force - linear.force) - linear.unbalanced
    unmet = -(held.equations(*x, y, state.drive) + slope.y @ (held.at - y))[:, None]
    alone = jnp.zeros((body.n, 1 + drives)).at[:, 0].set(linear.step(settled.force))
    dz, dx = system.respond(alone, jnp.concatenate([unmet, -slope.drive], axis=1))
    turned = _refined((dz[:, 1:], dx[:, 1:]), improving(0.0, -slope.drive), body.motion, refinements)
    moved, size = (jnp.linalg.norm(body.motion(each)) for each in (dz[:, :1], state.z))
    felt = ~(turned.contraction * moved <= _UNFELT * size)
    mending = improving(load[:, None], unmet)
    mended = _refined((dz[:, :1], dx[:, :1]), mending, body.motion, refinements, felt)
    contraction = jnp.maximum(turned.contraction, mended.contraction)
    dz, dx = (jnp.concatenate(each, axis=1) for each in zip(mended[:2], turned[:2], strict=True))
    dx = dx.at[:q].add(-loads.supports[:, None] * (pushed.T @ dz))  # what the springs carried
    settled_at = _moved(at, dz[:, 0], dx[:, 0])
    along = jax.vmap(lambda z, x: State(z, x[:q], x[q:], jnp.zeros(drives)), 1)(dz[:, 1:], dx[:, 1:])
    value, read = jax.linearize(device.reading, settled_at)
    w = jax.vmap(read, 0, 1)(along)
    innovation = seen.reading - value
    whitened = seen.whitening @ w
    hessian = whitened.T @ whitened + jnp.diag(limits.regularisation)
    b = whitened.T @ seen.heard(innovation)
    if limits.place is not None:
        around = _place_rows(device, limits.place, seen.places, state.drive)
        hessian, b = hessian + around.T @ around, b - around.T @ (around @ state.drive)
    rows = None
    if limits.strokes is not None:
        stroke, turn = jax.linearize(lambda s: strokes(device, loads, s), settled_at)
        rows = Rows(jax.vmap(turn, 0, 1)(along), *(bound - stroke for bound in limits.strokes))
    low, high = limits.lower - state.drive, limits.upper - state.drive
    change, kkt = solve_bounded_qp(hessian, b, low, high, rows)
    taken = jnp.ones(())
    if limits.motion is not None:
        taken = 1.0 / jnp.maximum(1.0, jnp.max(jnp.abs(body.motion(dz[:, 1:] @ change))) / limits.motion)
    change = taken * change
    after = _moved(settled_at, dz[:, 1:] @ change, dx[:, 1:] @ change)
    after = eqx.tree_at(lambda s: s.drive, after, state.drive + change)
    report = StepReport(
        innovation - w @ change,
        w,
        hessian,
        kkt,
        taken,
        jnp.max(jnp.abs(body.forces(linear.unbalanced))),
        contraction,
        jnp.min(body.volume_ratios(after.z)).astype(float),
        body.truncation(after.z),
    )
    return after, report


def estimate_step(
    device: Device,
    limits: Limits,
    factor: PyTree[Array],
    state: State,
    seen: Observation,
    *,
    refinements: int = 2,
    resistance: Float[Array, " n"] | None = None,
) -> tuple[State, StepReport]:
    """The live step: one `advance` with a factor of a tangent not far from here, of the solver that made it.
    Pure; compiled once.
    """

    def inverse(b):
        return device.linear.solve(factor, b)

    return advance(device, limits, inverse, state, seen, refinements=refinements, resistance=resistance)


def exact_steps(
    device: Device, limits: Limits, state: State, seen: Observation, *, steps: int
) -> tuple[State, StepReport]:
    """`steps` estimate steps, each with the tangent of its own state; differentiable in everything, through
    all steps.
    """
    loads = device.loads(seen.places)

    def step(state, _):
        inverse = tangent_at(device.linear, device.body, loads, state)
        return advance(device, limits, inverse, state, seen, refinements=0)

    state, reports = jax.lax.scan(step, state, length=steps)
    return state, jax.tree.map(lambda each: each[-1], reports)
