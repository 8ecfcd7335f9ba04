"""A body whose shape is a sum of modes, and whose energy is measured at a few weighted points.

Unknowns z = (α, β): amplitudes of displacement modes, u = Σ α_k U_k, and of pressure modes. Its equations are
those of the full body, projected onto the modes (Galerkin). What the energy has beyond its quadratic part at
rest is summed over the sample, quadrature points q with volumes w_q, while the linear part K₀ z is exact:

    r(z) = K₀ z + Σ_q w_q B_qᵀ (s(B_q z) − s'(0) B_q z) − g,

with the generalised strains B_q of the modes at a point, the stresses s that answer to them, and gravity's
work g. Where that leaves more to the sample than it takes, as in a body that turns, all is summed: r = Σ w_q
B_qᵀ s(B_q z) − g. As the modes are the same for loads, functionals and energy, the forces have a potential
and W_va keeps its symmetry. Source for the sampling of points: Hernández, Caicedo and Ferrer, Comput. Methods
Appl. Mech. Eng. 313, 2017; that it is applied to what is beyond the linear part is ours.
"""

from collections.abc import Callable
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.body.base import AbstractBody
from softfuse.body.element import Element
from softfuse.material.base import AbstractMaterial
from softfuse.rom.mode_points import ModePoints


class ReducedBody(AbstractBody):
    """See the module; m of the n unknowns are displacement modes.

    `modes` (u, m) [m]: the displacement modes; `index` (k, 3): which of their rows each node's components
    are, u or more for held ones; `pressure_modes` (c, n − m) [-]: in units of pressure at the pressure nodes;
    `seen` (k,): the place of each watched node in `seen_shapes` (w, 3, m) [m], w for nodes that nothing looks
    at; `sample`: the weighted points, those of each material together; `linear` (n, n): K₀ − Σ w B_qᵀ s'(0)
    B_q, or 0; `weight` (n,): g; `rest_volume` [m³]; `carried` (n + 1, 6): gravity's resultant
    by each unknown, then at rest; `stiffness` [N/m]: of the body under a contact, by which energies are told
    as forces.
    """

    rest: Float[Array, "k 3"]
    tets: Int[Array, "e a"]
    pressure_unit: Float[Array, ""]
    modes: Float[Array, "u m"]
    index: Int[Array, "k 3"]
    pressure_modes: Float[Array, "c b"]
    factors: Float[Array, " e"] | None
    seen: Int[Array, " k"]
    seen_shapes: Float[Array, "w 3 m"]
    sample: tuple[ModePoints, ...]
    linear: Float[Array, "n n"]
    weight: Float[Array, " n"]
    rest_volume: Float[Array, ""]
    carried: Float[Array, "n_plus_1 6"]
    stiffness: Float[Array, ""]
    element: Element = eqx.field(static=True)
    n: int = eqx.field(static=True)

    @property
    def displacement_modes(self) -> int:
        """m: how many of the unknowns move nodes."""
        return self.modes.shape[1]

    def law(self, region: int) -> AbstractMaterial:
        """The material of a region of its mesh."""
        return self.sample[region].material

    @property
    def volume(self) -> Float[Array, ""]:
        """Volume [m³] of the material at rest."""
        return self.rest_volume

    @property
    def element_unknowns(self) -> Int[Array, "1 n"]:
        """All unknowns: the body is one element."""
        return jnp.arange(self.n)[None]

    def residual(self, z: Float[Array, " n"]) -> Float[Array, " n"]:
        """r(z) (n,): see the module."""
        return self.linear @ z + sum(points.residual(z) for points in self.sample) - self.weight

    def element_tangents(self, z: Float[Array, " n"]) -> Float[Array, "1 n n"]:
        """K(z) (1, n, n)."""
        return (self.linear + sum(points.tangent(z) for points in self.sample))[None]

    @property
    def inertia(self) -> Float[Array, "1 n n"]:
        """Of the modes (1, n, n), the volume shared out evenly among the nodes that are not held."""
        free = self.rest_volume * 3 / self.modes.shape[0]
        rest = self.n - self.displacement_modes
        return jnp.pad(free * (self.modes.T @ self.modes), (0, rest)).astype(float)[None]

    @property
    def signs(self) -> Float[Array, " n"]:
        """1 for displacement modes, −1 for pressure modes (n,)."""
        return jnp.where(jnp.arange(self.n) < self.displacement_modes, 1.0, -1.0)

    def tangent_action(self, z: Float[Array, " n"]) -> Callable[[Float[Array, "n c"]], Float[Array, "n c"]]:
        """The map of directions (n, c) to K(z) applied to them, all columns at once: what the modes weigh in
        memory is read once for them.
        """
        parts = [points.tangent_action(z) for points in self.sample]
        return lambda directions: self.linear @ directions + sum(part(directions) for part in parts)

    def truncation(self, z: Float[Array | np.ndarray, " n"]) -> Float[Array | np.ndarray | np.float64, ""]:
        """The last modes' part of the shape [-], by energy at rest: modes are in the order of their need."""
        moved, last = z[: self.displacement_modes], z[self.last_modes]
        # In operators that numpy's arrays have too: for these nothing is compiled.
        return (last @ last) ** 0.5 / ((moved @ moved) ** 0.5 + jnp.finfo(z.dtype).tiny)

    @property
    def last_modes(self) -> slice:
        """Of the unknowns: those displacement modes that are needed least, an eighth."""
        return slice(-(-7 * self.displacement_modes // 8), self.displacement_modes)

    def rough(self) -> "ReducedBody":
        """With modes and sample, what is beyond the linear part, in single precision."""
        sample = tuple(points.single() for points in self.sample)
        modes, pressures, seen = (
            each.astype(jnp.float32) for each in (self.modes, self.pressure_modes, self.seen_shapes)
        )
        return replace(self, sample=sample, modes=modes, pressure_modes=pressures, seen_shapes=seen)

    def weight_resultant(self, z: Float[Array, " n"]) -> Float[Array, "6"]:
        """Gravity's force [N], and its moment about the origin [Nm], on the whole body (6,)."""
        return z @ self.carried[:-1] + self.carried[-1]

    def stiffened(
        self,
        tangents: Float[Array, "1 n n"],
        element: Int[Array, " f"],
        nodes: Int[Array, "f s"],
        blocks: Float[Array, "f x x"],
    ) -> Float[Array, "1 n n"]:
        """K (1, n, n) plus stiffnesses (f, 3 s, 3 s) [N/m] between nodes (f, s)."""
        del element
        m = self.displacement_modes
        modes = self.seen_shapes[self.seen[nodes]].reshape(*blocks.shape[:2], m)
        stiff = jnp.einsum("fab,fbm->fam", blocks, modes)
        return tangents.at[0, :m, :m].add(modes.reshape(-1, m).T @ stiff.reshape(-1, m))

    def volume_ratios(self, z: Float[Array, " n"]) -> Float[Array, "k 1"]:
        """J = det F at the sample's points."""
        return jnp.concatenate([points.volume_ratios(z) for points in self.sample])[:, None]

    def displacement(self, z: Float[Array, " n"]) -> Float[Array, "k 3"]:
        """Displacements (k, 3) m of all nodes."""
        m = self.displacement_modes
        free = self.modes @ z[:m].astype(self.modes.dtype)
        return jnp.append(free, 0)[jnp.minimum(self.index, len(free))]

    def watched(self, z: Float[Array, " n"]) -> Float[Array, "k 3"]:
        """Displacements (k, 3) m of the nodes that loads and functionals look at, NaN of others."""
        moved = self.seen_shapes @ z[: self.displacement_modes]
        return jnp.concatenate([moved, jnp.full((1, 3), jnp.nan)])[self.seen]

    def pressures(self, z: Float[Array, " n"], nodes: Int[Array, "..."]) -> Float[Array, "..."]:
        """Pressures (...) [Pa], tension positive, of pressure nodes (...) of mixed elements."""
        return self.pressure_unit * (self.pressure_modes[nodes] @ z[self.displacement_modes :])

    def spread(self, nodes: Int[Array, "..."], forces: Float[Array, "... 3 c"]) -> Float[Array, "n c"]:
        """c generalised forces (n, c) of forces (..., 3, c) [N] on nodes (...); NaN where one is on a node
        that is not watched, so that nothing is lost without a word.
        """
        w, c = self.seen_shapes.shape[0], forces.shape[-1]
        nodal = jnp.zeros((w + 1, 3, c)).at[self.seen[nodes]].add(forces)
        return self._pushed(self.seen_shapes.reshape(3 * w, -1), nodal[:w].reshape(-1, c), nodal[w])

    def spread_along(
        self,
        direction: Float[Array, "3"],
        nodes: Int[Array, "p s"],
        forces: Float[Array, "p s"],
        column: Int[Array, " p"],
        columns: int,
    ) -> Float[Array, "n columns"]:
        """Generalised forces (n, columns) of forces (p, s) [N] on nodes (p, s), see `spread`."""
        w = self.seen_shapes.shape[0]
        nodal = jnp.zeros((w + 1, columns)).at[self.seen[nodes], column[:, None]].add(forces)
        shapes = jnp.einsum("wim,i->wm", self.seen_shapes, direction.astype(self.seen_shapes.dtype))
        return self._pushed(shapes, nodal[:w], nodal[w:])

    def _pushed(
        self, shapes: Float[Array, "f m"], forces: Float[Array, "f c"], unseen: Float[Array, "u c"]
    ) -> Float[Array, "n c"]:
        """Generalised forces (n, c) of forces (f, c) that move by shapes (f, m); NaN where others are."""
        m, c = self.displacement_modes, forces.shape[1]
        lost = jnp.where(jnp.any(unseen != 0, axis=0), jnp.nan, 0.0)
        pushed = (shapes.T @ forces.astype(shapes.dtype)).astype(float)
        return jnp.concatenate([pushed + lost, jnp.zeros((self.n - m, c))])

    def forces(self, residual: Float[Array, " n"]) -> Float[Array, " n"]:
        """The forces [N] that store as much energy in `stiffness` as the generalised ones in the body: its
        modes are orthonormal in the energy.
        """
        return jnp.sqrt(self.stiffness) * residual

    def motion(self, dz: Float[Array, "n *c"]) -> Float[Array, "u *c"]:
        """The displacements (3 w,) or (3 w, c) [m] of the watched nodes."""
        m = self.displacement_modes
        return self.seen_shapes.reshape(-1, m) @ dz[:m]
