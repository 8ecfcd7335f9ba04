"""The dense problem between a body and its loads: E(x, y, u) = 0 with y = y₀ + S f.

x = (f, w) are the forces (f̃ of `HeldLoads`) and internal unknowns of all loads, y₀ (P,) the ports' values of
the body relaxed without them, S (P, Q) [y per f] its compliance. E is piecewise smooth: where a cell touches
or lifts off, or a cable goes slack, a law changes branch. Newton's method on it is then the primal-dual
active set method and ends after finitely many changes of branch (Hintermüller, Ito and Kunisch, SIAM J.
Optim. 13(3), 2002).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from softfuse.equilibrium.load import HeldLoads

_MAX_ITERATIONS = 60
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

    `free` (P,): y₀; `compliance` (P, Q); `drive` (D,). The derivative is that of one Newton step from the
    solution: exact to first order.
    """
    x, found = _searched(loads, free, compliance, drive, jax.lax.stop_gradient(jnp.concatenate(start)))
    q = compliance.shape[1]
    return Settled(x[:q], x[q:], found)


def _better(
    x: Float[Array, " r"],
    loads: HeldLoads,
    free: Float[Array, " P"],
    compliance: Float[Array, "P Q"],
    drive: Float[Array, " D"],
) -> Float[Array, " r"]:
    """Forces and internal unknowns (r,) after one Newton step."""
    q = compliance.shape[1]
    force, internal = x[:q], x[q:]
    y = free + compliance @ force
    matrix = stiffness(slopes(loads, (force, internal), y, drive), compliance)
    return x - jnp.linalg.solve(matrix, loads.equations(force, internal, y, drive))


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

    def improve(carry):
        x, _, count = carry
        after = _better(x, loads, free, compliance, drive)
        return after, jnp.max(jnp.abs(after - x) / jnp.maximum(units, jnp.abs(x))), count + 1

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
    _, along = eqx.filter_jvp(lambda *at: _better(jax.lax.stop_gradient(x), *at), tuple(given), tuple(moved))
    return (x, found), (along, None)
