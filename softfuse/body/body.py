"""A soft body: rest shape, materials, fixed nodes, and the equilibrium equations that follow from its energy.

Unknowns z (n,): free displacement components [m], node by node, then pressures in units of `pressure_unit`
(Taylor-Hood). The Lagrangian is L(z) = Σ_e Σ_q w density(F, p) − ∫ ρ g·u dV; residual r = ∂L/∂z, tangent K =
∂²L/∂z². At rest K = [[A, B], [Bᵀ, −C]]. Everything numeric is an array leaf, so the residual can be
differentiated with respect to materials and rest nodes too.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from softfuse.body.base import AbstractBody
from softfuse.body.element import TAYLOR_HOOD, Element, frames
from softfuse.body.region import Region
from softfuse.errors import MeshError, SoftfuseError
from softfuse.material.base import AbstractMaterial
from softfuse.material.components import Tensor, determinant
from softfuse.mesh.tetmesh import TetMesh, linear, quadratic


class Body(AbstractBody):
    """What does not change while a soft body deforms; elements are sorted by material.

    `frames` [m²], `volumes` [m³] and `weight` [N] are what `from_mesh` and `with_rest` compute from rest
    nodes, densities and gravity: see `Region` and `lagrangian`. `factors` [-]: how many times as stiff as
    its material each element is; None: all just as stiff. `excess` [Pa]: of each material, see `Region`; None
    but in what `expecting` makes.
    """

    rest: Float[Array, "k 3"]
    tets: Int[Array, "e a"]
    frames: Float[Array, "3 3 q e"]
    volumes: Float[Array, "q e"]
    materials: tuple[AbstractMaterial, ...]
    densities: Float[Array, " m"]
    gravity: Float[Array, "3"]
    weight: Float[Array, " n"]
    pressure_unit: Float[Array, ""]
    displacement_index: Int[Array, "k 3"]
    displacement_unknowns: Int[Array, "3 a e"]
    pressure_unknowns: Int[Array, "c e"]
    factors: Float[Array, " e"] | None
    element: Element = eqx.field(static=True)
    counts: tuple[int, ...] = eqx.field(static=True)
    n_displacements: int = eqx.field(static=True)
    n: int = eqx.field(static=True)
    excess: tuple[Tensor, ...] | None = None

    @classmethod
    def from_mesh(
        cls,
        mesh: TetMesh,
        materials: Sequence[AbstractMaterial],
        fixed: Bool[np.ndarray, " k"],
        *,
        element: Element = TAYLOR_HOOD,
        densities: Sequence[float] | None = None,
        gravity: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> "Body":
        """A body on a mesh whose nodes are those of the element's order (`mesh_for` gives such a mesh).

        `materials`: one for each region 0, 1, ... of the mesh; `fixed` (k,): nodes that cannot move;
        `densities` [kg/m³]: one a region, 0 where not given; `gravity` [m/s²]. Raises MeshError where mesh,
        regions and fixed nodes do not fit, SoftfuseError when JAX computes in single precision.
        """
        if jnp.zeros(()).dtype != jnp.float64:
            raise SoftfuseError(
                "JAX computes in single precision, which mechanics cannot do with: call "
                'jax.config.update("jax_enable_x64", True) first, or set JAX_ENABLE_X64=1'
            )
        if mesh.order != element.order:
            raise MeshError(
                f"a {element.name} body needs a mesh of order {element.order}, "
                f"this one has {mesh.order}: use mesh_for"
            )
        regions = np.unique(mesh.region)
        if regions.min() < 0 or regions.max() >= len(materials):
            raise MeshError(
                f"mesh has material regions {regions.tolist()}, "
                f"but {len(materials)} materials are given: name one for each"
            )
        if len(fixed) != len(mesh.nodes):
            raise MeshError(
                f"fixed names {len(fixed)} nodes, the mesh has {len(mesh.nodes)}: give one flag a node"
            )
        if not np.any(fixed):
            raise MeshError("no node is fixed, so the body could float away: fix at least one face")
        order = np.argsort(mesh.region, kind="stable")
        tets, region = mesh.tets[order], mesh.region[order]
        free = np.repeat(~np.asarray(fixed)[:, None], 3, axis=1)
        n_displacements = int(free.sum())
        index = np.cumsum(free.ravel()).reshape(-1, 3) - 1
        n = n_displacements
        pressures = np.zeros((len(tets), 0), np.int64)
        if element.pressures:
            # The pressure jumps where the material changes, so nodes shared by two regions get one for each.
            key = tets[:, : element.pressures].astype(np.int64) * len(materials) + region[:, None]
            unique, place = np.unique(key, return_inverse=True)
            pressures = n + place.reshape(key.shape)
            n += len(unique)
        index = np.where(free, index, n)
        rest = jnp.asarray(mesh.nodes)
        # One program: as single operations each would be compiled for itself.
        body_frames, volumes = jax.jit(frames, static_argnums=0)(element, mesh.nodes[tets])
        worst = np.unravel_index(int(np.argmin(np.asarray(volumes))), volumes.shape)
        if not float(volumes[worst]) > 0:
            raise MeshError(
                f"tet {order[worst[1]]} is turned inside out at a quadrature point: "
                "straighten its edges or remesh"
            )
        stiffness = jnp.mean(jnp.stack([jnp.asarray(m.shear_modulus(), float) for m in materials]))
        body = cls(
            rest=rest,
            tets=jnp.asarray(tets),
            frames=body_frames,
            volumes=volumes,
            materials=tuple(materials),
            densities=jnp.zeros(len(materials)) if densities is None else jnp.asarray(densities, float),
            gravity=jnp.asarray(gravity, float),
            weight=jnp.zeros(n),
            pressure_unit=jax.lax.stop_gradient(stiffness),
            displacement_index=jnp.asarray(index, jnp.int32),
            displacement_unknowns=jnp.asarray(index[tets].transpose(2, 1, 0), jnp.int32),
            pressure_unknowns=jnp.asarray(pressures.T, jnp.int32),
            factors=None,
            element=element,
            counts=tuple(int(np.sum(region == r)) for r in range(len(materials))),
            n_displacements=n_displacements,
            n=n,
        )
        return eqx.tree_at(lambda b: b.weight, body, jax.jit(_weight)(body))

    @property
    def full(self) -> "Body":
        """The body."""
        return self

    def law(self, region: int) -> AbstractMaterial:
        """The material of a region of its mesh."""
        return self.materials[region]

    @property
    def volume(self) -> Float[Array, ""]:
        """Volume [m³] of the material at rest."""
        return jnp.sum(self.volumes)

    @property
    def weights(self) -> Float[Array, "e q"]:
        """Volumes [m³] of the quadrature points, element by element."""
        return self.volumes.T

    @property
    def element_unknowns(self) -> Int[Array, "e d"]:
        """The unknowns of every element: displacements node by node, then pressures; n for held ones."""
        moves = self.displacement_unknowns.transpose(2, 1, 0).reshape(len(self.tets), -1)
        return jnp.concatenate([moves, self.pressure_unknowns.T], axis=1)

    def with_rest(self, rest: Float[Array, "k 3"]) -> "Body":
        """The same body with other rest nodes (k, 3) m; differentiable in them."""
        changed = (rest, *frames(self.element, rest[self.tets]))
        body = eqx.tree_at(lambda b: (b.rest, b.frames, b.volumes), self, changed)
        return eqx.tree_at(lambda b: b.weight, body, _weight(body))

    def with_materials(self, materials: Sequence[AbstractMaterial]) -> "Body":
        """The same body of other materials, one for each region; differentiable in their constants."""
        return eqx.tree_at(lambda b: b.materials, self, tuple(materials))

    def with_factors(self, factors: Float[Array, " e"]) -> "Body":
        """The same body with each element so many times (e,) as stiff as its material; differentiable in
        them.
        """
        return replace(self, factors=factors)

    def regions(self) -> Iterator[Region]:
        """The elements of each material."""
        start = 0
        for number, (material, count) in enumerate(zip(self.materials, self.counts, strict=True)):
            part = slice(start, start + count)
            start += count
            yield Region(
                self.element,
                material,
                self.frames[..., part],
                self.volumes[:, part],
                self.displacement_unknowns[..., part],
                self.pressure_unknowns[:, part],
                self.pressure_unit,
                None if self.factors is None else self.factors[part],
                None if self.excess is None else self.excess[number],
            )

    def lagrangian(self, z: Float[Array, " n"]) -> Float[Array, ""]:
        """L(z) [J]: strain energy (perturbed by the pressure) minus the work of gravity."""
        padded = _with_held(z)
        return sum(region.energy(padded) for region in self.regions()) - self.weight @ z

    def residual(self, z: Float[Array, " n"]) -> Float[Array, " n"]:
        """r(z) = ∂L/∂z (n,): nodal forces [N] that the body exerts against loads, then volume mismatches
        [J].
        """
        padded = _with_held(z)
        total = -_with_held(self.weight)
        for region in self.regions():
            total = region.add_forces(total, *region.conjugates(*region.strains(padded)))
        return total[: self.n]

    def element_tangents(self, z: Float[Array, " n"]) -> Float[Array, "e d d"]:
        """Second derivatives (e, d, d) of every element's energy in the order of `element_unknowns`."""
        padded = _with_held(z)
        parts = [region.tangents(padded) for region in self.regions()]
        return parts[0] if len(parts) == 1 else jnp.concatenate(parts)

    def masses(self) -> Float[Array, " k"]:
        """Of the nodes (k,) [kg]; those of quadratic elements may be negative."""
        density = jnp.repeat(self.densities, np.array(self.counts), total_repeat_length=len(self.tets))
        each = jnp.asarray(self.element.values).T @ (self.volumes * density)
        return jnp.zeros(self.n_nodes).at[self.tets.T].add(each)

    def weight_resultant(self, z: Float[Array, " n"]) -> Float[Array, "6"]:
        """Gravity's force [N], and its moment about the origin [Nm], on the whole body (6,)."""
        masses = self.masses()
        first = masses @ (self.rest + self.displacement(z))
        return jnp.concatenate([jnp.sum(masses) * self.gravity, jnp.cross(first, self.gravity)])

    def expecting(self, z: Float[Array, " n"], step: Float[Array, " n"]) -> "Body":
        """The body with the stresses at z that were expected of a step (n,) to there: see `Region.excess`."""
        padded, step = _with_held(z), _with_held(step)
        return replace(self, excess=tuple(region.excess_after(padded, step) for region in self.regions()))

    @property
    def inertia(self) -> Float[Array, "e d d"]:
        """∫ N_a N_b dV (e, d, d) [m³] of every element, 0 for pressures."""
        values = jnp.asarray(self.element.values)
        shared = jnp.einsum("qe,qa,qb->eab", self.volumes, values, values)
        blocks = jnp.einsum("eab,ij->eaibj", shared, jnp.eye(3))
        moving, held = 3 * self.element.nodes, self.element.pressures
        blocks = blocks.reshape(-1, moving, moving)
        return jnp.pad(blocks, ((0, 0), (0, held), (0, held)))

    @property
    def signs(self) -> Float[Array, " n"]:
        """1 for displacements, −1 for pressures (n,)."""
        return jnp.where(jnp.arange(self.n) < self.n_displacements, 1.0, -1.0)

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
        local = jnp.argmax(self.tets[element][:, None, :] == nodes[:, :, None], axis=2)
        slots = (3 * local[:, :, None] + jnp.arange(3)).reshape(len(nodes), -1)
        return tangents.at[element[:, None, None], slots[:, :, None], slots[:, None, :]].add(blocks)

    def volume_ratios(self, z: Float[Array, " n"]) -> Float[Array, "e q"]:
        """J = det F at every quadrature point; J ≤ 0 means an inverted element."""
        padded = _with_held(z)
        parts = [determinant(region.deformation(region.strains(padded)[0])).T for region in self.regions()]
        return parts[0] if len(parts) == 1 else jnp.concatenate(parts)

    def displacement(self, z: Float[Array, " n"]) -> Float[Array, "k 3"]:
        """Nodal displacements (k, 3) m of the unknowns z (n,); fixed nodes stay at 0."""
        return z.at[self.displacement_index].get(mode="fill", fill_value=0.0)

    def watched(self, z: Float[Array, " n"]) -> Float[Array, "k 3"]:
        """All nodal displacements (k, 3) m."""
        return self.displacement(z)

    def pressures(self, z: Float[Array, " n"], nodes: Int[Array, "..."]) -> Float[Array, "..."]:
        """Pressures (...) [Pa], tension positive, of pressure nodes (...) of mixed elements."""
        return self.pressure_unit * z[self.n_displacements + nodes]

    def spread(self, nodes: Int[Array, "..."], forces: Float[Array, "... 3 c"]) -> Float[Array, "n c"]:
        """Nodal forces (n, c) [N] of forces (..., 3, c) on nodes (...); what is on held ones is dropped."""
        index = self.displacement_index[nodes]
        return jnp.zeros((self.n, forces.shape[-1])).at[index].add(forces, mode="drop")

    def spread_along(
        self,
        direction: Float[Array, "3"],
        nodes: Int[Array, "p s"],
        forces: Float[Array, "p s"],
        column: Int[Array, " p"],
        columns: int,
    ) -> Float[Array, "n columns"]:
        """Nodal forces (n, columns) [N]; what is on held ones is dropped."""
        index, each = self.displacement_index[nodes], forces[:, :, None] * direction
        return jnp.zeros((self.n, columns)).at[index, column[:, None, None]].add(each, mode="drop")

    def forces(self, residual: Float[Array, " n"]) -> Float[Array, " u"]:
        """The forces among the generalised ones (u,) [N]."""
        return residual[: self.n_displacements]

    def motion(self, dz: Float[Array, "n *c"]) -> Float[Array, "u *c"]:
        """The displacements (u,) or (u, c) [m] among the changes of unknowns."""
        return dz[: self.n_displacements]


def _weight(body: Body) -> Float[Array, " n"]:
    """The work (n,) of gravity per unit of each unknown: [N]."""
    density = jnp.repeat(body.densities, np.array(body.counts), total_repeat_length=len(body.tets))
    masses = jnp.asarray(body.element.values).T @ (body.volumes * density)
    forces = body.gravity[:, None, None] * masses
    return jnp.zeros(body.n).at[body.displacement_unknowns].add(forces, mode="drop")


def mesh_for(element: Element, mesh: TetMesh) -> TetMesh:
    """The mesh with the nodes that the element needs: mid-edge nodes added or dropped."""
    return quadratic(mesh) if element.order == 2 else linear(mesh)


def _with_held(z: Float[Array, " n"]) -> Float[Array, " n_plus_1"]:
    return jnp.append(z, 0.0)
