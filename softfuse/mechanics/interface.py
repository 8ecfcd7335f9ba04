"""The dense problem between a body and its loads: E(x, y, u) = 0 with y = y₀ + S f.

x = (f, w) are the forces (f̃ of `HeldLoads`) and internal unknowns of all loads, y₀ (P,) the ports' values of
the body relaxed without them, S (P, Q) [y per f] its compliance. E is piecewise smooth: where a cell touches
or lifts off, or a cable goes slack, a law changes branch. Newton's method on it is then the primal-dual
active set method, which ends after finitely many changes of branch where ports are nearly independent
(Hintermüller, Ito and Kunisch, SIAM J. Optim. 13(3), 2002). Where a coarse mesh ties cells to each other it
goes in circles; damped until its simplified correction shrinks, it does not (Deuflhard, as in `newton`).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from softfuse.mechanics.held_loads import HeldLoads

_MAX_ITERATIONS = 120
_WHOLE = 5  # first iterations, which are not damped: nearly all problems need no more
_SMALLEST_DAMPING = 1 / 1024
_TOLERANCE = 1e-10  # of the unknowns' size, or of their units where those are larger


class Slopes(eqx.Module):
    """E's derivatives in x, y and u: (r, r), (r, P), (r, D)."""

    x: Float[Array, "r r"]
    y: Float[Array, "r P"]
    drive: Float[Array, "r D"]


def slopes(
    loads: HeldLoads,
    x: tuple[Float[Array, " Q"], Float[Array, " M"]],
    y: Float[Array, " P"],
    drive: Float[Array, " D"],
) -> Slopes:
    """The derivatives of the laws at forces and internal unknowns x, ports' values y (P,), drives (D,)."""
    (by_force, by_internal), by_y, by_drive = jax.jacfwd(
        lambda x, y, u: loads.equations(x[0], x[1], y, u), argnums=(0, 1, 2)
    )(x, y, drive)
    return Slopes(jnp.concatenate([by_force, by_internal], axis=1), by_y, by_drive)


def stiffness(at: Slopes, compliance: Float[Array, "P Q"]) -> Float[Array, "r r"]:
    """dE/dx (r, r) with the body's answer to the forces: E_x + E_y [S, 0]."""
    return at.x.at[:, : compliance.shape[1]].add(at.y @ compliance)


class Settled(eqx.Module):
    """Forces (Q,) and internal unknowns (M,) that obey the laws, and whether they were found."""

    force: Float[Array, " Q"]
    internal: Float[Array, " M"]
    found: Bool[Array, ""]


def settle(
    loads: HeldLoads,
    free: Float[Array, " P"],
    compliance: Float[Array, "P Q"],
    drive: Float[Array, " D"],
    start: tuple[Float[Array, " Q"], Float[Array, " M"]],
) -> Settled:
    """Solve the laws for forces and internal unknowns, searching from `start`.

    `free` (P,): y₀; `compliance` (P, Q); `drive` (D,). The derivative is that of the implicit function, to
    any order, on the solution's branch.
    """
    x, found = _searched(loads, free, compliance, drive, jax.lax.stop_gradient(jnp.concatenate(start)))
    q = compliance.shape[1]
    return Settled(x[:q], x[q:], found)


def _law(x: Array, loads: HeldLoads, free: Array, compliance: Array, drive: Array) -> Float[Array, " r"]:
    """E (r,) at forces and internal unknowns x (r,)."""
    force, internal = x[: compliance.shape[1]], x[compliance.shape[1] :]
    return loads.equations(force, internal, free + compliance @ force, drive)


def _slope(x: Array, loads: HeldLoads, free: Array, compliance: Array, drive: Array) -> Float[Array, "r r"]:
    """dE/dx (r, r) there."""
    force, internal = x[: compliance.shape[1]], x[compliance.shape[1] :]
    return stiffness(slopes(loads, (force, internal), free + compliance @ force, drive), compliance)


@eqx.filter_custom_jvp
def _searched(
    loads: HeldLoads,
    free: Float[Array, " P"],
    compliance: Float[Array, "P Q"],
    drive: Float[Array, " D"],
    start: Float[Array, " r"],
) -> tuple[Float[Array, " r"], Bool[Array, ""]]:
    """Newton's method from `start` (r,), and whether it came to an end."""
    units = loads.units()
    given = loads, free, compliance, drive

    def improve(carry):
        x, _, count = carry
        factor = jax.scipy.linalg.lu_factor(_slope(x, *given))

        def correction(x):
            return -jax.scipy.linalg.lu_solve(factor, _law(x, *given))

        step = correction(x)

        def refused(damping):
            left = jnp.linalg.norm(correction(x + damping * step) / units)
            return ~(left <= (1 - damping / 4) * jnp.linalg.norm(step / units))

        damping = jax.lax.while_loop(
            lambda damping: (count >= _WHOLE) & (damping > _SMALLEST_DAMPING) & refused(damping),
            lambda damping: damping / 2,
            jnp.array(1.0),
        )
        return x + damping * step, jnp.max(jnp.abs(step) / jnp.maximum(units, jnp.abs(x))), count + 1

    def unfinished(carry):
        _, change, count = carry
        return (change > _TOLERANCE) & (count < _MAX_ITERATIONS)

    x, change, _ = jax.lax.while_loop(unfinished, improve, (start, jnp.array(jnp.inf), 0))
    return x, change <= _TOLERANCE


@_searched.def_jvp
def _searched_jvp(primals, tangents):
    *given, start = primals
    x, found = _searched(*given, start)
    *moved, _ = tangents
    _, along = eqx.filter_jvp(lambda *at: _law(x, *at), tuple(given), tuple(moved))
    return (x, found), (-jnp.linalg.solve(_slope(x, *given), along), None)
