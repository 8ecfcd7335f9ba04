"""The inverses of a reduced body's tangent in some states, of which a live step takes the nearest.

A tangent costs ten times what a step may take, for it is a sum over all points of what each says about every
pair of modes; and its inverse another. A chart is small, though: among a few dozen states as far from each
other as those it was taught there is one near any other. The step solves for what is out of balance, so what
an inverse is off by makes it converge a little slower and moves no equilibrium. Where that is too slow, the
estimator makes one for the state at hand, which serves as long as it is the nearest.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.body.base import AbstractBody
from softfuse.errors import SolveError
from softfuse.mechanics.dense import Dense
from softfuse.mechanics.linear_solver import AbstractLinearSolver
from softfuse.mechanics.load import Loads


class KnownInverses(AbstractLinearSolver):
    """In single precision: K⁻¹ `inverses` (t, n, n) in `states` (t, n), the first of which is rest."""

    states: Float[Array, "t n"]
    inverses: Float[Array, "t n n"]

    @classmethod
    def plan(cls, body: AbstractBody) -> "KnownInverses":
        """With rest as the only state."""
        return cls.of(body, Loads(()), np.zeros((1, body.n)))

    @classmethod
    def of(cls, body: AbstractBody, loads: Loads, states: Float[np.ndarray, "t n"]) -> "KnownInverses":
        """Those of a reduced body with the springs of its loads in some states (t, n).

        Raises SolveError where the body is singular.
        """
        tangents = _tangents(body, loads, jnp.asarray(states))
        with np.errstate(all="ignore"):
            inverses = np.linalg.inv(tangents)
        if not np.isfinite(inverses).all():
            raise SolveError(
                "the reduced body's stiffness is singular: fix more nodes, or mend materials and mesh"
            )
        return cls(*(jnp.asarray(each, jnp.float32) for each in (states, inverses)))

    @property
    def knows(self) -> bool:
        """That is what it is for."""
        return True

    def at_rest(self) -> Float[Array, "n n"]:
        """The inverse (n, n) there, which is the first."""
        return self.inverses[0]

    def near(
        self, factor: Float[Array, "n n"], made_at: Float[Array, " n"], z: Float[Array, " n"]
    ) -> Float[Array, "n n"]:
        """K⁻¹ (n, n) in the state that is nearest to z (n,), by energy at rest: a known one, or the one that
        the factor was `made_at` (n,).
        """
        at = z.astype(jnp.float32)
        away = jnp.sum((self.states - at) ** 2, axis=1)
        nearest = jnp.argmin(away)
        own = jnp.sum((made_at.astype(jnp.float32) - at) ** 2) < away[nearest]
        return jnp.where(own, factor, self.inverses[nearest])

    def factor(self, element_tangents: Float[Array, "1 n n"]) -> Float[Array, "n n"]:
        """The inverse (n, n) of a tangent."""
        return jnp.linalg.inv(element_tangents[0].astype(jnp.float32))

    def solve(self, factor: Float[Array, "n n"], rhs: Float[Array, "n c"]) -> Float[Array, "n c"]:
        """Solution (n, c) for right-hand sides (n, c), with K⁻¹."""
        return (factor @ rhs.astype(jnp.float32)).astype(rhs.dtype)


class ReducedDense(Dense):
    """Dense solution for a reduced body; live steps take one of the inverses that are `known`."""

    known: KnownInverses

    @classmethod
    def plan(cls, body: AbstractBody) -> "ReducedDense":
        """Of a reduced body, with the inverse at rest alone known."""
        return cls.with_known(body, KnownInverses.plan(body))

    @classmethod
    def with_known(cls, body: AbstractBody, known: KnownInverses) -> "ReducedDense":
        """Of a reduced body."""
        return cls(body.element_unknowns, body.n, known)

    def rough(self) -> KnownInverses:
        """What is known."""
        return self.known


@eqx.filter_jit
def _tangents(body: AbstractBody, loads: Loads, states: Float[Array, "t n"]) -> Float[Array, "t n n"]:
    # What pressures add to the tangent is left out: the states say nothing of them, the step makes up for it.
    force = jnp.zeros(loads.sizes.forces)
    return jax.lax.map(lambda z: loads.stiffen(body, z, force, body.element_tangents(z))[0], states)


def far_apart(states: Float[np.ndarray, "s n"], count: int) -> Float[np.ndarray, "t n"]:
    """Of states (s, n) and rest, which is the first, so many (t, n) that each is as far as can be from those
    before; some come again where there are fewer.

    Source for the greedy choice: Gonzalez, Theor. Comput. Sci. 38, 1985.
    """
    every = np.concatenate([np.zeros((1, states.shape[1])), states])
    chosen, away = [0], np.linalg.norm(every, axis=1)
    while len(chosen) < count:
        chosen.append(int(np.argmax(away)))
        away = np.minimum(away, np.linalg.norm(every - every[chosen[-1]], axis=1))
    return every[chosen]
