"""The estimate step: relinearise, bounded QP, advance (Navarro et al. 2020, eqs. 2 and 8 to 10).

At the state (z, a) with contact rows G, K δz = G δa − (r(z) − G a) gives the equilibrium's correction at
unchanged forces, z₀, and the sensitivity t = dz/dF of each contact. With W = ∂V/∂z t and the innovation e =
ΔV_measured − ΔV(z₀),

    ΔF = argmin Σ_i (e_i − (W ΔF)_i)² / σ_i² + ε ‖ΔF‖²   subject to 0 ≤ F + ΔF ≤ F_max,

then z = z₀ + t ΔF. ε damps the step and leaves no bias once the steps have converged. Cells that would pull
are let go (`unilateral`). The factor may belong to an older tangent: refinements with the body's own tangent
make up for it, and their first contraction is returned so that the caller knows when a new factor pays.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from softfuse.body.body import element_tangents, tangent_action, volume_ratios
from softfuse.equilibrium.linear_solver import Solve, tangent_inverse
from softfuse.equilibrium.newton import compliance_of, unbalanced
from softfuse.equilibrium.solution import State
from softfuse.equilibrium.unilateral import distribute, distribute_on
from softfuse.estimation.bounded_qp import solve_bounded_qp
from softfuse.estimation.device import Device


class Observation(eqx.Module):
    """What the sensors say in one frame: volume changes (k,) [m³], their weights 1/σ (k,) [1/m³] (0:
    ignore), contact locations (c, 3) m.
    """

    volume_change: Float[Array, " k"]
    weight: Float[Array, " k"]
    locations: Float[Array, "c 3"]


class Limits(eqx.Module):
    """Bounds of the forces, 0 to `force` (c,) [N], and the regularisation ε [1/N²] of one step."""

    force: Float[Array, " c"]
    regularisation: Float[Array, ""]


class StepReport(eqx.Module):
    """How good a step was.

    `misfit` (k,) [m³]: measured minus modelled volume change after it; `compliance` (k, c) [m³/N]: W; `kkt`
    [N]: optimality of the QP; `unbalanced` [N]: largest nodal force out of balance before it; `contraction`
    [-]: by how much the first refinement shrank the error of the linear solves; `least_volume_ratio` [-]:
    smallest det F after it.
    """

    misfit: Float[Array, " k"]
    compliance: Float[Array, "k c"]
    kkt: Float[Array, ""]
    unbalanced: Float[Array, ""]
    contraction: Float[Array, ""]
    least_volume_ratio: Float[Array, ""]


class _Contacts(eqx.Module):
    """Linearised contacts: rows G (n, c, m), responses K⁻¹G by the factor at hand, and their compliance."""

    rows: Float[Array, "n c m"]
    response: Float[Array, "n c m"]
    compliance: Float[Array, "c m c m"]


def _directions(
    device: Device,
    z: Array,
    inverse: Solve,
    at: _Contacts,
    pressed: Array,
    load: Array,
    gap: Array,
    total: Array,
    *,
    refinements: int,
) -> tuple[Array, Array, Array, Array]:
    """Solve K x − G y = load, Gᵀx + gap = d on pressed cells, Σ y = total for columns: load (n, j), gap (j,
    c, m), total (j, c).

    Returns x (n, j), y (j, c, m), d (j, c) and the contraction of the first refinement.
    """

    def once(load, gap, total):
        x = inverse(load)
        offset = jnp.einsum("ncm,nj->jcm", at.rows, x) + gap
        y, d = jax.vmap(lambda o, f: distribute_on(pressed, at.compliance, o, f))(offset, total)
        return x + jnp.einsum("ncm,jcm->nj", at.response, y), y, d

    moves = slice(0, device.body.n_displacements)
    x, y, d = once(load, gap, total)
    contraction = jnp.zeros(())
    for sweep in range(refinements):
        left = load + jnp.einsum("ncm,jcm->nj", at.rows, y) - tangent_action(device.body, z, x)
        dx, dy, dd = once(left, jnp.zeros_like(gap), jnp.zeros_like(total))
        if sweep == 0:
            contraction = jnp.max(
                jnp.linalg.norm(dx[moves], axis=0) / (jnp.linalg.norm(x[moves], axis=0) + 1e-12)
            )
        x, y, d = x + dx, y + dy, d + dd
    return x, y, d, contraction


def advance(
    device: Device, limits: Limits, inverse: Solve, state: State, seen: Observation, *, refinements: int
) -> tuple[State, StepReport]:
    """One estimate step with K⁻¹ as the map `inverse`, refined `refinements` times; the state after it, and
    its report.
    """
    body = device.body
    rows = device.contact_rows(seen.locations)
    n, c, m = rows.shape
    unsettled = unbalanced(body, rows, state)
    solved = inverse(jnp.concatenate([rows.reshape(n, c * m), unsettled[:, None]], axis=1))
    response = solved[:, :-1].reshape(n, c, m)
    at = _Contacts(rows, response, compliance_of(rows, response))
    settled = state.z - solved[:, -1] - jnp.einsum("ncm,cm->n", at.response, state.cells)
    force = state.force()
    _, _, pressed = distribute(state.pressed, at.compliance, jnp.einsum("ncm,n->cm", rows, settled), force)
    # First column: the correction at unchanged total forces. Others: the sensitivity to each contact's force.
    freed = jnp.where(pressed, state.cells, 0.0)
    let_go = jnp.einsum("ncm,cm->n", rows, freed - state.cells)
    load = jnp.zeros((n, 1 + c)).at[:, 0].set(let_go - unsettled)
    gap = jnp.zeros((1 + c, c, m)).at[0].set(jnp.einsum("ncm,n->cm", rows, state.z))
    total = jnp.concatenate([(force - jnp.sum(freed, axis=1))[None], jnp.eye(c)])
    x, y, d, contraction = _directions(
        device, state.z, inverse, at, pressed, load, gap, total, refinements=refinements
    )
    before = State(state.z + x[:, 0], freed + y[0], d[0], pressed)
    value, slope = jax.linearize(device.volume_change, before.z)
    w = jax.vmap(slope, 1, 1)(x[:, 1:])
    innovation = seen.volume_change - value
    whitened = w * seen.weight[:, None]
    q = whitened.T @ whitened + limits.regularisation * jnp.eye(c)
    b = whitened.T @ jnp.where(seen.weight > 0, innovation * seen.weight, 0.0)
    change, kkt = solve_bounded_qp(q, b, -force, limits.force - force)
    after = State(
        before.z + x[:, 1:] @ change,
        before.cells + jnp.einsum("jcm,j->cm", y[1:], change),
        before.depth + change @ d[1:],
        pressed,
    )
    report = StepReport(
        innovation - w @ change,
        w,
        kkt,
        jnp.max(jnp.abs(unsettled[: body.n_displacements])),
        contraction,
        jnp.min(volume_ratios(body, after.z)),
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
) -> tuple[State, StepReport]:
    """The live step: one `advance` with a factor of a tangent not far from here. Pure; compiled once."""

    def inverse(b):
        return device.linear.solve(factor, b)

    return advance(device, limits, inverse, state, seen, refinements=refinements)


def exact_steps(
    device: Device, limits: Limits, state: State, seen: Observation, *, steps: int
) -> tuple[State, StepReport]:
    """`steps` estimate steps, each with the tangent of its own state; differentiable in everything, through
    all steps.
    """

    def step(state, _):
        factor = device.linear.factor(element_tangents(*jax.lax.stop_gradient((device.body, state.z))))
        inverse = tangent_inverse(device.linear, factor, device.body, state.z, refinements=0)
        return advance(device, limits, inverse, state, seen, refinements=0)

    state, reports = jax.lax.scan(step, state, length=steps)
    return state, jax.tree.map(lambda each: each[-1], reports)
