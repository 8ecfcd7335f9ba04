"""One interface for K x = b: plan once a body, factor a tangent, solve with the factor as often as needed.

`tangent_inverse` makes an exact differentiable solve of any factor, also a stale one: the factor
preconditions, the body's own tangent action corrects. Source for the split: lineax' linear solvers.
"""

from abc import abstractmethod
from collections.abc import Callable

import equinox as eqx
import jax
from jaxtyping import Array, Float, PyTree

from softfuse.body.base import AbstractBody

Solve = Callable[[Float[Array, "n c"]], Float[Array, "n c"]]


class AbstractLinearSolver(eqx.Module):
    """Direct solver of a body's symmetric tangent."""

    @classmethod
    @abstractmethod
    def plan(cls, body: AbstractBody) -> "AbstractLinearSolver":
        """Everything about the tangent of this body that does not depend on its values."""

    @abstractmethod
    def factor(self, element_tangents: Float[Array, "e d d"]) -> PyTree[Array]:
        """Factor of the matrix that element tangents (e, d, d) assemble to; NaN where that matrix is
        singular.
        """

    @abstractmethod
    def solve(self, factor: PyTree[Array], rhs: Float[Array, "n c"]) -> Float[Array, "n c"]:
        """Solution (n, c) for right-hand sides (n, c)."""

    @property
    def knows(self) -> bool:
        """Whether factors near most states of live steps are known, so that these refine nothing."""
        return False

    def at_rest(self) -> PyTree[Array]:
        """The factor at rest, of a solver that `knows`; raises TypeError for others."""
        raise TypeError(f"{type(self).__name__} knows no factors")

    def near(
        self, factor: PyTree[Array], made_at: Float[Array, " n"], z: Float[Array, " n"]
    ) -> PyTree[Array]:
        """The factor for a state z (n,): one `made_at` another (n,), unless one that is known is nearer."""
        del made_at, z
        return factor

    def rough(self) -> "AbstractLinearSolver":
        """A faster solver of the same plan, whose solutions are only good enough to be refined; itself where
        there is none.
        """
        return self


def tangent_inverse(
    solver: AbstractLinearSolver,
    factor: PyTree[Array],
    action: Solve,
    *,
    refinements: int,
) -> Solve:
    """The map b (n, c) ↦ K⁻¹ b, differentiable in b and in all that `action`, x (n, c) ↦ K x, depends on, to
    any order and in both modes.

    With a factor of K itself no refinement is needed; with one of a nearby tangent each reduces the error by
    the factor's distance ‖1 − F⁻¹K‖. Implicit differentiation of K x = b: ẋ = K⁻¹(ḃ − K̇ x).
    """
    factor = jax.lax.stop_gradient(factor)

    def approximate(matrix, b):
        x = solver.solve(factor, b)
        for _ in range(refinements):
            x = x + solver.solve(factor, b - matrix(x))
        return x

    def inverse(b):
        return jax.lax.custom_linear_solve(action, b, approximate, symmetric=True)

    return inverse
