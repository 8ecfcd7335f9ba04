"""What every body can do, whatever its unknowns are: those of all nodes, or the few of a reduced body.

Unknowns z (n,) determine displacements u(z) of all nodes of a mesh, linearly, and an energy L(z); residual r
= ∂L/∂z, tangent K = ∂²L/∂z². Whatever pushes a body does so at its nodes: forces on nodes become generalised
forces on the unknowns by the transpose of u(z).
"""

from abc import abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.body.element import Element
from softfuse.errors import SoftfuseError
from softfuse.material.base import AbstractMaterial

if TYPE_CHECKING:
    from softfuse.body.body import Body

_WRITTEN_OUT = 3  # columns


class AbstractBody(eqx.Module):
    """A body in equilibrium under what pushes its nodes.

    `rest` (k, 3) [m] and `tets` (e, a): its mesh, of `element`s; `factors` (e,) [-]: how many times as stiff
    as its material each element is, None: all just as stiff; `weight` (n,): gravity's work per unit of each
    unknown; `pressure_unit` [Pa]: a typical stiffness of its materials; `n`: number of unknowns.
    """

    rest: eqx.AbstractVar[Float[Array, "k 3"]]
    tets: eqx.AbstractVar[Int[Array, "e a"]]
    element: eqx.AbstractVar[Element]
    factors: eqx.AbstractVar[Float[Array, " e"] | None]
    weight: eqx.AbstractVar[Float[Array, " n"]]
    pressure_unit: eqx.AbstractVar[Float[Array, ""]]
    n: eqx.AbstractVar[int]

    @property
    def n_nodes(self) -> int:
        """Number of displacement nodes."""
        return self.rest.shape[0]

    @property
    def full(self) -> "Body":
        """The body itself, if its unknowns are those of all nodes; raises SoftfuseError for a reduced one."""
        raise SoftfuseError("the body is a reduced one: this is done with the full one, then reduce that")

    @abstractmethod
    def law(self, region: int) -> AbstractMaterial:
        """The material of a region of its mesh."""

    @property
    @abstractmethod
    def volume(self) -> Float[Array, ""]:
        """Volume [m³] of the material at rest."""

    @property
    @abstractmethod
    def element_unknowns(self) -> Int[Array, "e d"]:
        """The unknowns that each of the `element_tangents` belongs to; n for held ones."""

    @abstractmethod
    def residual(self, z: Float[Array, " n"]) -> Float[Array, " n"]:
        """r(z) = ∂L/∂z (n,): generalised forces that the body exerts against loads."""

    @abstractmethod
    def element_tangents(self, z: Float[Array, " n"]) -> Float[Array, "e d d"]:
        """Second derivatives (e, d, d) of L's parts, in the order of `element_unknowns`."""

    def expecting(self, z: Float[Array, " n"], step: Float[Array, " n"]) -> "AbstractBody":
        """The body whose tangents at z are the best for the next step of Newton's method after a `step` (n,)
        to z; its energy and forces are of no use. Itself where it knows no better ones.
        """
        del z, step
        return self

    @property
    @abstractmethod
    def inertia(self) -> Float[Array, "e d d"]:
        """Mass matrices (e, d, d) at a density of 1, in the order of `element_unknowns`: a norm of motions in
        which no rotation is stiff.
        """

    @property
    @abstractmethod
    def signs(self) -> Float[Array, " n"]:
        """1 for unknowns that move the body, −1 for pressures (n,): the signs of a stable body's tangent."""

    @abstractmethod
    def weight_resultant(self, z: Float[Array, " n"]) -> Float[Array, "6"]:
        """Gravity's force [N], and its moment about the origin [Nm], on the whole body (6,)."""

    @abstractmethod
    def stiffened(
        self,
        tangents: Float[Array, "e d d"],
        element: Int[Array, " f"],
        nodes: Int[Array, "f s"],
        blocks: Float[Array, "f x x"],
    ) -> Float[Array, "e d d"]:
        """Element tangents (e, d, d) plus stiffnesses (f, 3 s, 3 s) [N/m] between the nodes (f, s) of an
        element (f,) each.
        """

    @abstractmethod
    def volume_ratios(self, z: Float[Array, " n"]) -> Float[Array, "e q"]:
        """J = det F at the quadrature points; J ≤ 0 means an inverted element."""

    @abstractmethod
    def displacement(self, z: Float[Array, " n"]) -> Float[Array, "k 3"]:
        """Displacements (k, 3) m of all nodes; fixed nodes stay at 0."""

    @abstractmethod
    def watched(self, z: Float[Array, " n"]) -> Float[Array, "k 3"]:
        """Displacements (k, 3) m of the nodes that loads and functionals look at, NaN where none does: what
        live steps use instead of `displacement`.
        """

    @abstractmethod
    def pressures(self, z: Float[Array, " n"], nodes: Int[Array, "..."]) -> Float[Array, "..."]:
        """Pressures (...) [Pa], tension positive, of pressure nodes (...) of a body of mixed elements."""

    @abstractmethod
    def spread(self, nodes: Int[Array, "..."], forces: Float[Array, "... 3 c"]) -> Float[Array, "n c"]:
        """c generalised forces (n, c) of forces (..., 3, c) on nodes (...), which may come several times: the
        transpose of `watched`.
        """

    @abstractmethod
    def spread_along(
        self,
        direction: Float[Array, "3"],
        nodes: Int[Array, "p s"],
        forces: Float[Array, "p s"],
        column: Int[Array, " p"],
        columns: int,
    ) -> Float[Array, "n columns"]:
        """Generalised forces (n, columns) of forces (p, s) in one direction (3,) on nodes (p, s), those of
        each p in a column of its own or shared with others: `spread` of forces of which most would be 0.
        """

    @abstractmethod
    def forces(self, residual: Float[Array, " n"]) -> Float[Array, " f"]:
        """Forces [N] that generalised forces (n,) amount to, in any order: for norms."""

    @abstractmethod
    def motion(self, dz: Float[Array, "n *c"]) -> Float[Array, "u *c"]:
        """Displacements (u,) or (u, c) [m] that changes of the unknowns, (n,) or c columns, amount to, in any
        order: for norms.
        """

    def tangent_action(self, z: Float[Array, " n"]) -> Callable[[Float[Array, "n c"]], Float[Array, "n c"]]:
        """The map of directions (n, c) to K(z) applied to them, without forming K; linearised once."""
        _, action = jax.linearize(self.residual, z)
        return lambda directions: column_by_column(action, directions)

    def truncation(self, z: Float[Array | np.ndarray, " n"]) -> Float[Array | np.ndarray | np.float64, ""]:
        """What part of the shape is made by the last of its modes [-]: about what those that were left out
        would have added. 0 for a body without modes.
        """
        return jnp.zeros_like(z[0])

    @property
    def last_modes(self) -> slice:
        """Of the unknowns: the last of its modes; none of a body without."""
        return slice(0)

    def rough(self) -> "AbstractBody":
        """The same body with faster arithmetic, good enough for estimates; itself where there is none."""
        return self


def column_by_column(
    action: Callable[[Float[Array, " n"]], Float[Array, " n"]], directions: Float[Array, "n c"]
) -> Float[Array, "n c"]:
    """A linear map of vectors (n,) applied to c columns (n, c), one after the other.

    What the map reads at every element stays in the processor's cache meanwhile, which all columns at once
    would push out. A few are written out, so that XLA need not store all that for a loop.
    """
    if directions.shape[1] <= _WRITTEN_OUT:
        return jnp.stack([action(column) for column in directions.T], axis=1)
    return jax.lax.map(action, directions.T).T
