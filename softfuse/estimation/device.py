"""A soft sensing device: a body, the cavities whose volumes are measured, and how things press on it.

`volume_change(state)` is the measurement model ΔV(q) of Navarro et al. 2020, eq. 8; `jax.jacfwd` of it
through the equilibrium is the compliance W_va.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from softfuse.body.body import Body
from softfuse.equilibrium.linear_solver import AbstractLinearSolver
from softfuse.equilibrium.newton import Newton, solve
from softfuse.equilibrium.solution import Solution, State
from softfuse.functional.cavity import Cavity
from softfuse.functional.contact import Contact


class Device(eqx.Module):
    """Body, k cavities, and a contact that stands for every disc that may press; its location is given with
    each use.
    """

    body: Body
    cavities: tuple[Cavity, ...]
    contact: Contact
    linear: AbstractLinearSolver

    def rest_state(self, contacts: int) -> State:
        """The undeformed state under so many contacts without force."""
        return State.rest(self.body, contacts, self.contact.cells.count)

    def volumes(self, z: Float[Array, " n"]) -> Float[Array, " k"]:
        """Enclosed volumes (k,) [m³] at the body's unknowns z (n,)."""
        positions = self.body.rest + self.body.displacement(z)
        return jnp.stack([cavity(positions) for cavity in self.cavities])

    def volume_change(self, z: Float[Array, " n"]) -> Float[Array, " k"]:
        """Volumes minus those at rest (k,) [m³] at the body's unknowns z (n,)."""
        return self.volumes(z) - self.volumes(jnp.zeros_like(z))

    def at(self, location: Float[Array, "3"]) -> Contact:
        """The contact at a location (3,) m."""
        return eqx.tree_at(lambda contact: contact.location, self.contact, location)

    def contact_rows(self, locations: Float[Array, "c 3"]) -> Float[Array, "n c m"]:
        """Nodal forces per newton in each cell (n, c, m) of the contacts at locations (c, 3) m."""
        return jax.vmap(lambda location: self.at(location).rows(self.body), out_axes=1)(locations)

    def overlap(self, locations: Float[Array, "c 3"]) -> Float[Array, " c"]:
        """Fraction (c,) of each disc that stands on the body."""
        return jax.vmap(lambda location: self.at(location).overlap(self.body))(locations)


@eqx.filter_jit
def simulate(
    device: Device, locations: Float[Array, "c 3"], force: Float[Array, " c"], start: State | None = None
) -> Solution:
    """The equilibrium under contacts at locations (c, 3) m with total forces (c,) N, searched from rest or
    `start`.

    Pure and differentiable in everything; `Solution.result` says how it ended.
    """
    start = device.rest_state(len(force)) if start is None else start
    return solve(Newton(device.linear), device.body, device.contact_rows(locations), force, start)


@eqx.filter_jit
def compliance(
    device: Device, locations: Float[Array, "c 3"], force: Float[Array, " c"], start: State | None = None
) -> Float[Array, "k c"]:
    """W_va = ∂ΔV/∂λ (k, c) [m³/N] at the equilibrium under forces (c,) N: one linear solve for each
    contact.
    """

    def measured(total):
        return device.volume_change(simulate(device, locations, total, start).state.z)

    return jax.jacfwd(measured)(force)
