"""Element tangents to one sparse symmetric matrix: K = Σ_e P_eᵀ k_e P_e, on a pattern that depends on the
mesh alone.

Which entries of which elements add up to a nonzero is sorted once, so that assembling values is one gather
and one sum over sorted segments. Constrained unknowns (index n) are dropped.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.body.body import Body


class Pattern(eqx.Module):
    """The nonzeros `rows`, `columns` (z,) of an n × n matrix, sorted by row, then column, and where they come
    from.
    """

    rows: Int[Array, " z"]
    columns: Int[Array, " z"]
    entries: Int[Array, " m"]
    targets: Int[Array, " m"]
    n: int = eqx.field(static=True)

    @property
    def row_starts(self) -> Int[Array, " n_plus_1"]:
        """Where each row's nonzeros start (n + 1,), as in compressed sparse rows."""
        return jnp.searchsorted(self.rows, jnp.arange(self.n + 1)).astype(jnp.int32)


def _pattern(body: Body, wanted) -> Pattern:
    unknowns = np.asarray(body.element_unknowns, np.int64)
    d = unknowns.shape[1]
    row, column = np.repeat(unknowns, d, axis=1).ravel(), np.tile(unknowns, (1, d)).ravel()
    used = np.flatnonzero((row < body.n) & (column < body.n) & wanted(row, column))
    key = row[used] * body.n + column[used]
    order = np.argsort(key, kind="stable")
    key = key[order]
    first = np.concatenate([[True], key[1:] != key[:-1]])
    rows, columns = np.divmod(key[first], body.n)

    def index(a):
        return jnp.asarray(a, jnp.int32)

    return Pattern(index(rows), index(columns), index(used[order]), index(np.cumsum(first) - 1), body.n)


def full_pattern(body: Body) -> Pattern:
    """All nonzeros of a body's tangent."""
    return _pattern(body, lambda row, column: np.ones(row.shape, bool))


def upper_pattern(body: Body) -> Pattern:
    """The nonzeros of a body's tangent on and above the diagonal."""
    return _pattern(body, lambda row, column: row <= column)


def assemble(pattern: Pattern, element_tangents: Float[Array, "e d d"]) -> Float[Array, " z"]:
    """The values (z,) of the pattern's nonzeros that element tangents (e, d, d) add up to."""
    parts = element_tangents.ravel().at[pattern.entries].get(mode="promise_in_bounds")
    return jax.ops.segment_sum(
        parts,
        pattern.targets,
        num_segments=len(pattern.rows),
        indices_are_sorted=True,
        mode=jax.lax.GatherScatterMode.PROMISE_IN_BOUNDS,
    )
