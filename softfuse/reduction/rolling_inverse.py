"""The inverse of a reduced body's tangent, renewed a little every few frames.

A tangent costs ten times what a step may take, for it is a sum over all points of what each says about every
pair of modes; and its inverse another. Every few frames therefore a part of the points is added, as the body
is then; after the last part the sum is inverted and the next begins. Seldom, and much of it, so that most
frames have nothing of it to do and none has all. The step solves for what is out of balance, so what an
inverse is behind by makes it converge a little slower and moves no equilibrium.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from softfuse.body.base import AbstractBody
from softfuse.equilibrium.dense import Dense
from softfuse.equilibrium.linear_solver import AbstractLinearSolver
from softfuse.equilibrium.load import Loads
from softfuse.equilibrium.solution import State
from softfuse.reduction.reduced_body import ReducedBody

_FRAMES = 16
"""In which all points are added: a contact on the pad that moves by 0.75 mm a frame loses 0.3 % of its force
by that.
"""


class RollingTangent(NamedTuple):
    """K⁻¹ (n, n), the sum (n, n) of the parts that were added since, and how many these are."""

    inverse: Float[Array, "n n"]
    sum: Float[Array, "n n"]
    added: Int[Array, ""]


class RollingInverse(AbstractLinearSolver):
    """In single precision; `parts`: in so many renewals all points are added."""

    parts: int = eqx.field(static=True)

    @classmethod
    def plan(cls, body: AbstractBody) -> "RollingInverse":
        """Of a reduced body."""
        assert isinstance(body, ReducedBody)
        return cls(body.parts)

    @property
    def renew_every(self) -> int:
        """So that all parts together take sixteen frames."""
        return max(1, _FRAMES // self.parts)

    def factor(self, element_tangents: Float[Array, "1 n n"]) -> RollingTangent:
        """The inverse of a whole tangent."""
        tangent = element_tangents[0].astype(jnp.float32)
        return RollingTangent(jnp.linalg.inv(tangent), jnp.zeros_like(tangent), jnp.array(0, jnp.int32))

    def solve(self, factor: RollingTangent, rhs: Float[Array, "n c"]) -> Float[Array, "n c"]:
        """Solution (n, c) for right-hand sides (n, c)."""
        return (factor.inverse @ rhs.astype(jnp.float32)).astype(rhs.dtype)

    def renewed(
        self, factor: RollingTangent, body: AbstractBody, loads: Loads, state: State
    ) -> RollingTangent:
        """With one more part, and a new inverse after the last."""
        assert isinstance(body, ReducedBody)
        total = factor.sum + body.tangent_part(state.z, factor.added).astype(jnp.float32)

        def begin_again() -> RollingTangent:
            tangent = loads.stiffen(body, state.z, state.force, (body.linear + total)[None])
            return self.factor(tangent)

        return jax.lax.cond(
            factor.added + 1 < self.parts,
            lambda: RollingTangent(factor.inverse, total, factor.added + 1),
            begin_again,
        )


class ReducedDense(Dense):
    """Dense solution for a reduced body, whose rough solver renews itself."""

    parts: int = eqx.field(static=True)

    @classmethod
    def plan(cls, body: AbstractBody) -> "ReducedDense":
        """Of a reduced body."""
        assert isinstance(body, ReducedBody)
        return cls(body.element_unknowns, body.n, body.parts)

    def rough(self) -> RollingInverse:
        """Renewed a little in every frame."""
        return RollingInverse(self.parts)
