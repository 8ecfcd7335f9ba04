"""Sparse direct solution of K x = b for symmetric quasi-definite K, as dense linear algebra inside jit.

K = [[A, B], [Bᵀ, −C]] with A and C positive definite can be eliminated in any symmetric order without
pivoting across fronts (Vanderbei, SIAM J. Optim. 5(1), 1995), so the order is chosen for sparsity alone
(`dissection`). Each front keeps D⁻¹ (s, s) and G = D⁻¹U (s, t); with them a solve is two sweeps of batched
matrix products: upward b_border −= Gᵀ b_pivots, downward x_pivots = D⁻¹ b_pivots − G x_border. A singular
front gives NaN, which the caller reads as a result code.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.body.body import Body
from softfuse.mechanics.dissection import dissect
from softfuse.mechanics.linear_solver import AbstractLinearSolver

_FEW_COLUMNS = 5


class _Fronts(eqx.Module):
    """The index arrays of one `dissection.Batch` as leaves; children (c,), (c,) and (c, m) of each batch."""

    pivots: Int[Array, "f s"]
    border: Int[Array, "f t"]
    elements: Int[Array, " e"]
    element_front: Int[Array, " e"]
    element_slots: Int[Array, "e d"]
    children: tuple[tuple[Int[Array, "_"], Int[Array, "_"], Int[Array, "_ _"]], ...]
    sources: tuple[int, ...] = eqx.field(static=True)


def _gather_rows(blocks: Float[Array, "c t u"], rows: Int[Array, "c m"]) -> Float[Array, "c m u"]:
    return jax.vmap(lambda block, row: block.at[row].get(mode="promise_in_bounds"))(blocks, rows)


def _inverse(block: Float[Array, "*f s s"]) -> Float[Array, "*f s s"]:
    # By LU as in `jnp.linalg.inv`, whose general solve takes longer to trace and to compile for each shape.
    lu, _, order = jax.lax.linalg.lu(block)
    right = (order[..., None] == jnp.arange(block.shape[-1])).astype(block.dtype)
    half = jax.lax.linalg.triangular_solve(lu, right, left_side=True, lower=True, unit_diagonal=True)
    return jax.lax.linalg.triangular_solve(lu, half, left_side=True)


def _inverses(blocks: Float[Array, "f s s"]) -> Float[Array, "f s s"]:
    # On a CPU one after the other. JAX's LAPACK calls for many matrices share them out among the threads that
    # programs run on, and wait: as many such calls at once as there are threads wait for ever. One after the
    # other takes a fifth less time, too.
    return jax.lax.platform_dependent(blocks, cpu=lambda each: jax.lax.map(_inverse, each), default=_inverse)


class Factor(eqx.Module):
    """What solving needs: for each batch of fronts D⁻¹ (f, s, s) and G = D⁻¹U (f, s, t)."""

    inverses: tuple[Float[Array, "_ _ _"], ...]
    couplings: tuple[Float[Array, "_ _ _"], ...]


class Multifrontal(AbstractLinearSolver):
    """Elimination plan of a mesh; `factor` and `solve` are pure and may be jitted, vmapped and run on any
    device.
    """

    fronts: tuple[_Fronts, ...]
    n: int = eqx.field(static=True)
    precision: str = eqx.field(static=True, default="float64")

    @classmethod
    def plan(cls, body: Body) -> "Multifrontal":
        """Plan the elimination of a body's tangent."""
        batches = dissect(
            np.asarray(body.element_unknowns),
            body.element.local_nodes,
            np.asarray(body.tets),
            np.asarray(body.rest),
            body.n,
        )

        def index(a):
            # Converted by numpy and with the type named: else JAX compiles a program for every shape.
            return jnp.asarray(np.asarray(a, np.int32), jnp.int32)

        fronts = tuple(
            _Fronts(
                index(b.pivots),
                index(b.border),
                index(b.elements),
                index(b.element_front),
                index(b.element_slots),
                tuple((index(c), index(p), index(m)) for _, c, p, m in b.children),
                tuple(source for source, _, _, _ in b.children),
            )
            for b in batches
        )
        return cls(fronts, body.n)

    def rough(self) -> "Multifrontal":
        """The same plan in single precision: half the memory to move and half the time."""
        return Multifrontal(self.fronts, self.n, "float32")

    def factor(self, element_tangents: Float[Array, "e d d"]) -> Factor:
        """Eliminate all fronts of the matrix that the element tangents (e, d, d) assemble to."""
        element_tangents = element_tangents.astype(self.precision)
        schur: list[Array] = []
        inverses, couplings = [], []
        for batch in self.fronts:
            f, s = batch.pivots.shape
            size = s + batch.border.shape[1]
            # The last row and column collect what belongs to constrained unknowns, and are dropped.
            front = jnp.zeros((f, size + 1, size + 1), element_tangents.dtype)
            slots = batch.element_slots
            front = front.at[batch.element_front[:, None, None], slots[:, :, None], slots[:, None, :]].add(
                element_tangents[batch.elements]
            )[:, :size, :size]
            for source, (child, parent, take) in zip(batch.sources, batch.children, strict=True):
                # Symmetric: gather rows, transpose, gather rows again; the added zero row serves absent
                # slots.
                block = jnp.pad(schur[source][child], ((0, 0), (0, 1), (0, 1)))
                front = front.at[parent].add(_gather_rows(_gather_rows(block, take).swapaxes(1, 2), take))
            d, u = front[:, :s, :s], front[:, :s, s:]
            # Padding pivots get a unit diagonal.
            unit = (batch.pivots == self.n).astype(d.dtype)
            inverse = _inverses(d + unit[:, :, None] * jnp.eye(s, dtype=d.dtype))
            coupling = inverse @ u
            schur.append(front[:, s:, s:] - u.swapaxes(1, 2) @ coupling)
            inverses.append(inverse)
            couplings.append(coupling)
        return Factor(tuple(inverses), tuple(couplings))

    def solve(self, factor: Factor, rhs: Float[Array, "n k"]) -> Float[Array, "n k"]:
        """Solve for k right-hand sides (n, k) with a factor of the same plan."""
        if rhs.shape[1] > _FEW_COLUMNS:
            return self._solve(factor, rhs)
        # A product with a matrix of few columns is slower on a CPU than as many with a vector.
        return jnp.concatenate([self._solve(factor, rhs[:, k : k + 1]) for k in range(rhs.shape[1])], axis=1)

    def _solve(self, factor: Factor, rhs: Float[Array, "n k"]) -> Float[Array, "n k"]:
        b = jnp.pad(rhs.astype(self.precision), ((0, 1), (0, 0)))
        eliminated = []
        for batch, coupling in zip(self.fronts, factor.couplings, strict=True):
            y = b[batch.pivots]
            eliminated.append(y)
            b = b.at[batch.border].add(-_product("fst,fsk->ftk", coupling, y))
        x = jnp.zeros_like(b)
        for batch, inverse, coupling, y in reversed(
            list(zip(self.fronts, factor.inverses, factor.couplings, eliminated, strict=True))
        ):
            x_border = x.at[self.n].set(0.0)[batch.border]
            x = x.at[batch.pivots].set(
                _product("fst,ftk->fsk", inverse, y) - _product("fst,ftk->fsk", coupling, x_border)
            )
        return x[: self.n].astype(rhs.dtype)


def _product(indices: str, matrices: Float[Array, "f s t"], columns: Float[Array, "f _ k"]) -> Array:
    if columns.shape[2] == 1:
        return jnp.einsum(indices.replace("k", ""), matrices, columns[:, :, 0])[:, :, None]
    return jnp.einsum(indices, matrices, columns)
