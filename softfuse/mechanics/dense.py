"""Dense solution of K x = b by LU with partial pivoting: for bodies of some hundred unknowns, and as the
reference in tests.

Time grows as n³ and memory as n². A singular matrix gives infinities or NaN.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from softfuse.body.base import AbstractBody
from softfuse.mechanics.linear_solver import AbstractLinearSolver


class Dense(AbstractLinearSolver):
    """Assembles the whole matrix; the factor is LU (n, n) and its row exchanges (n,)."""

    element_unknowns: Int[Array, "e d"]
    n: int = eqx.field(static=True)

    @classmethod
    def plan(cls, body: AbstractBody) -> "Dense":
        """Plan the assembly of a body's tangent."""
        return cls(body.element_unknowns, body.n)

    def factor(self, element_tangents: Float[Array, "e d d"]) -> tuple[Float[Array, "n n"], Int[Array, " n"]]:
        """LU factors of the matrix that element tangents (e, d, d) assemble to."""
        rows, columns = self.element_unknowns[:, :, None], self.element_unknowns[:, None, :]
        # Constrained unknowns have the index n, which is out of bounds and dropped.
        matrix = jnp.zeros((self.n, self.n)).at[rows, columns].add(element_tangents, mode="drop")
        return jax.scipy.linalg.lu_factor(matrix)

    def solve(self, factor: tuple[Array, Array], rhs: Float[Array, "n c"]) -> Float[Array, "n c"]:
        """Solution (n, c) for right-hand sides (n, c)."""
        return jax.scipy.linalg.lu_solve(factor, rhs)
