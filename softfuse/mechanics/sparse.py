"""Sparse direct solution of K x = b by SuiteSparse inside jit (package sparsax, CPU only): CHOLMOD and KLU.

The factor that travels through jit is the assembled matrix. sparsax keeps the numeric factorisation outside,
keyed by the matrix' values: the first solve with new values factorises, further ones reuse it. CHOLMOD keeps
one factorisation a pattern and KLU 32, so alternating between more matrices than that factorises again each
time, but is never wrong. (sparsax' explicit tokens keep every factorisation ever made alive.) Failure raises
out of the compiled program here; that it is data, NaN read as a result code, holds for `Multifrontal` only.
Sources: Chen, Davis, Hager and Rajamanickam, ACM TOMS 35(3), 2008 (CHOLMOD); Davis and Palamadai Natarajan,
ACM TOMS 37(3), 2010 (KLU).
"""

from jaxtyping import Array, Float

from softfuse.body.body import Body
from softfuse.errors import SolveError
from softfuse.mechanics.assembly import Pattern, assemble, full_pattern, upper_pattern
from softfuse.mechanics.linear_solver import AbstractLinearSolver


class SparseCholesky(AbstractLinearSolver):
    """CHOLMOD, for the positive definite tangents of displacement elements near a stable equilibrium."""

    pattern: Pattern

    @classmethod
    def plan(cls, body: Body) -> "SparseCholesky":
        """Plan the assembly of a body's tangent. Raises SolveError for mixed elements, whose tangent is a
        saddle.
        """
        if body.element.pressures:
            raise SolveError(
                f"the tangent of {body.element.name} elements is indefinite and has no Cholesky factor: "
                "use Multifrontal or SparseLU"
            )
        return cls(upper_pattern(body))

    def factor(self, element_tangents: Float[Array, "e d d"]) -> Float[Array, " z"]:
        """Upper triangle (z,) of the matrix that element tangents (e, d, d) assemble to."""
        return assemble(self.pattern, element_tangents)

    def solve(self, factor: Float[Array, " z"], rhs: Float[Array, "n c"]) -> Float[Array, "n c"]:
        """Solution (n, c) for right-hand sides (n, c). Raises jax.errors.JaxRuntimeError, also from inside
        jit, if K is not positive definite.
        """
        import sparsax

        return sparsax.solve(self.pattern.rows, self.pattern.columns, factor, rhs)


class SparseLU(AbstractLinearSolver):
    """KLU with partial pivoting, for any regular tangent, the Taylor-Hood saddle included."""

    pattern: Pattern

    @classmethod
    def plan(cls, body: Body) -> "SparseLU":
        """Plan the assembly of a body's tangent."""
        return cls(full_pattern(body))

    def factor(self, element_tangents: Float[Array, "e d d"]) -> Float[Array, " z"]:
        """Nonzeros (z,) of the matrix that element tangents (e, d, d) assemble to."""
        return assemble(self.pattern, element_tangents)

    def solve(self, factor: Float[Array, " z"], rhs: Float[Array, "n c"]) -> Float[Array, "n c"]:
        """Solution (n, c) for right-hand sides (n, c). Raises jax.errors.JaxRuntimeError, also from inside
        jit, if K is singular.
        """
        import sparsax

        return sparsax.lu_solve(self.pattern.rows, self.pattern.columns, factor, rhs)
