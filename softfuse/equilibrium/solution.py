"""What an equilibrium is, and how its search ended."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from softfuse.body.body import Body


class RESULTS(eqx.Enumeration):
    """How a solve ended; data inside jit, turned into words or an exception at the edge."""

    converged = "converged"
    diverged = "diverged: no load step converged; the body may have buckled, or cannot carry the load"
    inverted = (
        "inverted element: the load turns an element inside out; refine the mesh there or lower the load"
    )
    step_limit = "step limit: more load steps are needed; raise max_load_steps"


class State(eqx.Module):
    """What changes while a body deforms, for c contacts of m pressure cells.

    `z` (n,): the body's unknowns; `cells` (c, m) [N]: forces of the cells; `depth` (c,) [m]: how far each
    disc has moved; `pressed` (c, m): which cells touch.
    """

    z: Float[Array, " n"]
    cells: Float[Array, "c m"]
    depth: Float[Array, " c"]
    pressed: Bool[Array, "c m"]

    @classmethod
    def rest(cls, body: Body, contacts: int, cells: int) -> "State":
        """The undeformed state of a body with so many contacts of so many cells."""
        return cls(
            jnp.zeros(body.n),
            jnp.zeros((contacts, cells)),
            jnp.zeros(contacts),
            jnp.ones((contacts, cells), bool),
        )

    def force(self) -> Float[Array, " c"]:
        """Total force (c,) [N] of each contact."""
        return jnp.sum(self.cells, axis=1)


class Stats(eqx.Module):
    """What a solve took: Newton iterations, accepted load steps, and the largest unbalanced nodal force [N]
    at its end.
    """

    newton_iterations: Int[Array, ""]
    load_steps: Int[Array, ""]
    residual: Float[Array, ""]


class Solution(eqx.Module):
    """A state, how its search ended, and what it took; on failure the last state that was an equilibrium."""

    state: State
    result: RESULTS
    stats: Stats
