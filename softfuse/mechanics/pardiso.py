"""Sparse direct solution of K x = b by oneMKL Pardiso inside jit (the extra softfuse[mkl], x86-64 CPU only).

LDLᵀ with Bunch-Kaufman pivoting of symmetric indefinite matrices, so it serves the Taylor-Hood saddle. The
factor that travels through jit is the assembled upper triangle; each `solve` factorises it again for all its
right-hand sides at once, so give them together. Source: Schenk and Gärtner, Future Gener. Comput. Syst.
20(3), 2004.
"""

from importlib import import_module
from types import ModuleType

import jax
from jaxtyping import Array, Float

from softfuse.body.body import Body
from softfuse.errors import SolveError
from softfuse.mechanics.assembly import Pattern, assemble, upper_pattern
from softfuse.mechanics.linear_solver import AbstractLinearSolver


def _library() -> ModuleType:
    try:
        return import_module("pardiso_mkl_jax")
    except ImportError as error:
        raise SolveError(f"Pardiso is not installed ({error}): pip install 'softfuse[mkl]'") from error


class Pardiso(AbstractLinearSolver):
    """Pardiso for any regular symmetric tangent."""

    pattern: Pattern

    @classmethod
    def plan(cls, body: Body) -> "Pardiso":
        """Plan the assembly of a body's tangent. Raises SolveError when Pardiso is not installed."""
        _library()
        return cls(upper_pattern(body))

    def factor(self, element_tangents: Float[Array, "e d d"]) -> Float[Array, " z"]:
        """Upper triangle (z,) of the matrix that element tangents (e, d, d) assemble to."""
        return assemble(self.pattern, element_tangents)

    def solve(self, factor: Float[Array, " z"], rhs: Float[Array, "n c"]) -> Float[Array, "n c"]:
        """Solution (n, c) for right-hand sides (n, c). Raises JaxRuntimeError if K is singular."""
        library = _library()
        kind = library.MatrixType.REAL_SYMMETRIC_INDEFINITE

        def solved(b):
            return library.solve(self.pattern.row_starts, self.pattern.columns, factor, b, matrix_type=kind)

        return jax.vmap(solved, 1, 1)(rhs)
