"""What a user would otherwise write for the same work, to be timed beside softfuse.

The elements are ours, so that only the linear algebra differs: a dense tangent by JAX's forward derivatives
and its dense solve; the tangent's elements assembled by scipy and factorised by SuperLU, at each iteration or
at each frame, as a step shaped like that of Navarro et al. 2020 does (new tangent, a solve for each actuator
and one for the free motion, W from the effectors' rows, a bounded QP).
"""

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.optimize
import scipy.sparse
import scipy.sparse.linalg
from jaxtyping import Float, Int
from sofa_pad import NOWHERE, SharedForce

from softfuse.body.body import Body
from softfuse.estimation.step import Observation
from softfuse.functional.cavity import Cavity
from softfuse.mechanics.model import Model
from softfuse.mechanics.reading import ShapeReading

_CLOSE = 1e-9  # m, as ours


def shared_force(model: Model, nodes: Int[np.ndarray, " p"]) -> Model:
    """The robot pushed down by a force that nodes (p,) share equally."""
    return replace(model, contacts=(SharedForce(jnp.asarray(nodes, jnp.int32)),))


_residual = eqx.filter_jit(lambda body, z: body.residual(z))
_tangents = eqx.filter_jit(lambda body, z: body.element_tangents(z))


class _Newton(ABC):
    """Newton's method in equal increments of the load."""

    def __init__(self, body: Body):
        self.body = body

    @abstractmethod
    def step(self, z: Float[np.ndarray, " n"], left: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """K(z)⁻¹ times what is out of balance (n,)."""

    def solve(self, push: Float[np.ndarray, " n"], increments: int) -> Float[np.ndarray, " n"]:
        """The equilibrium z (n,) under generalised forces (n,)."""
        z = np.zeros(self.body.n)
        for number in range(1, increments + 1):
            change = np.inf
            while change > _CLOSE:
                left = number / increments * push - np.asarray(_residual(self.body, jnp.asarray(z)))
                step = self.step(z, left)
                z, change = z + step, np.abs(step[: self.body.n_displacements]).max()
        return z


class DenseNewton(_Newton):
    """With `jax.jacfwd` of the residual and a dense solve."""

    def __init__(self, body: Body):
        super().__init__(body)
        self._step = jax.jit(lambda z, left: jnp.linalg.solve(jax.jacfwd(body.residual)(z), left))

    def step(self, z, left):
        """By LU of the dense tangent."""
        return np.asarray(self._step(z, left))


class SparseTangent:
    """Assembles a body's tangent in scipy."""

    def __init__(self, body: Body):
        self.body = body
        unknowns = np.asarray(body.element_unknowns)
        d = unknowns.shape[1]
        rows, columns = np.repeat(unknowns, d, axis=1).ravel(), np.tile(unknowns, (1, d)).ravel()
        self._used = (rows < body.n) & (columns < body.n)
        self._places = rows[self._used], columns[self._used]

    def factor(self, z: Float[np.ndarray, " n"]) -> scipy.sparse.linalg.SuperLU:
        """SuperLU of K(z)."""
        values = np.asarray(_tangents(self.body, jnp.asarray(z))).ravel()[self._used]
        tangent = scipy.sparse.csc_array((values, self._places), shape=(self.body.n, self.body.n))
        return scipy.sparse.linalg.splu(tangent)


class SparseNewton(_Newton):
    """With scipy's assembly and SuperLU."""

    def __init__(self, body: Body):
        super().__init__(body)
        self._tangent = SparseTangent(body)

    def step(self, z, left):
        """By SuperLU."""
        return self._tangent.factor(z).solve(left)


class Drives(NamedTuple):
    """Forces [N]."""

    drive: Float[np.ndarray, " 1"]


class PaperStep:
    """One force from the volumes of cavities, a step with a new factor for each frame."""

    def __init__(self, model: Model):
        shapes = [reading.functional for reading in model.readings if isinstance(reading, ShapeReading)]
        self._body, cavities = model.body, [each for each in shapes if isinstance(each, Cavity)]
        assert isinstance(self._body, Body) and len(cavities) == len(model.readings)
        loads = model.loads(NOWHERE)
        self._rows = np.asarray(loads.rows(self._body, jnp.zeros(self._body.n)))
        self._tangent = SparseTangent(self._body)

        def volumes(z):
            return jnp.stack([jnp.ravel(each.change(self._body, z))[0] for each in cavities])

        self._volumes, self._slopes = jax.jit(volumes), jax.jit(jax.jacrev(volumes))
        self.reset()

    def reset(self) -> None:
        """The body rests."""
        self._z, self._force = np.zeros(self._body.n), np.zeros(1)

    def update(self, seen: Observation) -> Drives:
        """One linearisation, W by a solve with a new factor, a bounded least squares."""
        z = jnp.asarray(self._z)
        left = self._rows @ self._force - np.asarray(_residual(self._body, z))
        answers = self._tangent.factor(self._z).solve(np.column_stack([left, self._rows]))
        slopes = np.asarray(self._slopes(z))
        free, w = slopes @ answers[:, 0], slopes @ answers[:, 1:]
        missed = seen.whitening @ (seen.reading - np.asarray(self._volumes(z)) - free)
        bounds = (-self._force, 50.0 - self._force)
        change = scipy.optimize.lsq_linear(seen.whitening @ w, missed, bounds=bounds).x
        self._z = self._z + answers[:, 0] + answers[:, 1:] @ change
        self._force = self._force + change
        return Drives(self._force)
