"""A soft body: rest shape, materials, fixed nodes, and the equilibrium equations that follow from its energy.

Unknowns z (n,): free displacement components [m], node by node, then pressures in units of `pressure_unit`
(Taylor-Hood). The Lagrangian is L(z) = Σ_e Σ_q w density(F, p) − ∫ ρ g·u dV; residual r = ∂L/∂z, tangent K =
∂²L/∂z². At rest K = [[A, B], [Bᵀ, −C]]. Everything numeric is an array leaf, so the residual can be
differentiated with respect to materials and rest nodes too.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from softfuse.body.element import TAYLOR_HOOD, Element, shape_gradients
from softfuse.errors import MeshError, SoftfuseError
from softfuse.material.base import AbstractMaterial, jacobian
from softfuse.mesh.tetmesh import TetMesh, linear, quadratic


class Body(eqx.Module):
    """What does not change while a soft body deforms; elements are sorted by material."""

    rest: Float[Array, "k 3"]
    tets: Int[Array, "e a"]
    gradients: Float[Array, "e q a 3"]
    weights: Float[Array, "e q"]
    materials: tuple[AbstractMaterial, ...]
    densities: Float[Array, " m"]
    gravity: Float[Array, "3"]
    pressure_unit: Float[Array, ""]
    displacement_index: Int[Array, "k 3"]
    element_unknowns: Int[Array, "e d"]
    element: Element = eqx.field(static=True)
    counts: tuple[int, ...] = eqx.field(static=True)
    n_displacements: int = eqx.field(static=True)
    n: int = eqx.field(static=True)

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
        unknowns = np.concatenate([index[tets].reshape(len(tets), -1), pressures], axis=1)
        gradients, weights = shape_gradients(element, jnp.asarray(mesh.nodes[tets]))
        worst = np.unravel_index(int(jnp.argmin(weights)), weights.shape)
        if not float(weights[worst]) > 0:
            raise MeshError(
                f"tet {order[worst[0]]} is turned inside out at a quadrature point: "
                "straighten its edges or remesh"
            )
        stiffness = jnp.mean(jnp.stack([jnp.asarray(m.shear_modulus(), float) for m in materials]))
        return cls(
            rest=jnp.asarray(mesh.nodes),
            tets=jnp.asarray(tets),
            gradients=gradients,
            weights=weights,
            materials=tuple(materials),
            densities=jnp.zeros(len(materials)) if densities is None else jnp.asarray(densities, float),
            gravity=jnp.asarray(gravity, float),
            pressure_unit=jax.lax.stop_gradient(stiffness),
            displacement_index=jnp.asarray(index, jnp.int32),
            element_unknowns=jnp.asarray(unknowns, jnp.int32),
            element=element,
            counts=tuple(int(np.sum(region == r)) for r in range(len(materials))),
            n_displacements=n_displacements,
            n=n,
        )

    @property
    def n_nodes(self) -> int:
        """Number of displacement nodes."""
        return self.rest.shape[0]

    def with_rest(self, rest: Float[Array, "k 3"]) -> "Body":
        """The same body with other rest nodes (k, 3) m; differentiable in them."""
        gradients, weights = shape_gradients(self.element, rest[self.tets])
        return eqx.tree_at(lambda b: (b.rest, b.gradients, b.weights), self, (rest, gradients, weights))

    def with_materials(self, materials: Sequence[AbstractMaterial]) -> "Body":
        """The same body of other materials, one for each region; differentiable in their constants."""
        return eqx.tree_at(lambda b: b.materials, self, tuple(materials))

    def displacement(self, z: Float[Array, " n"]) -> Float[Array, "k 3"]:
        """Nodal displacements (k, 3) m of the unknowns z (n,); fixed nodes stay at 0."""
        return z.at[self.displacement_index].get(mode="fill", fill_value=0.0)


def mesh_for(element: Element, mesh: TetMesh) -> TetMesh:
    """The mesh with the nodes that the element needs: mid-edge nodes added or dropped."""
    return quadratic(mesh) if element.order == 2 else linear(mesh)


def _strains(body: Body, z: Float[Array, " n"]) -> tuple[Float[Array, "e q 3 3"], Float[Array, "e q"]]:
    """Deformation gradient and pressure [Pa] at every quadrature point."""
    local = z.at[body.element_unknowns].get(mode="fill", fill_value=0.0)
    a = body.element.nodes
    u = local[:, : 3 * a].reshape(-1, a, 3)
    f = jnp.eye(3) + jnp.einsum("eai,eqaj->eqij", u, body.gradients)
    if not body.element.pressures:
        return f, jnp.zeros(f.shape[:2])
    corner_values = jnp.asarray(body.element.points)
    return f, body.pressure_unit * jnp.einsum("ep,qp->eq", local[:, 3 * a :], corner_values)


def _by_region(body: Body, function, *fields: Array) -> Array:
    """Apply function(material, *field values) at all quadrature points, region by region, and join the
    results.
    """
    over_points = jax.vmap(jax.vmap(function, (None, *(0 for _ in fields))), (None, *(0 for _ in fields)))
    parts, start = [], 0
    for material, count in zip(body.materials, body.counts, strict=True):
        parts.append(over_points(material, *(f[start : start + count] for f in fields)))
        start += count
    return parts[0] if len(parts) == 1 else jnp.concatenate(parts)


def lagrangian(body: Body, z: Float[Array, " n"]) -> Float[Array, ""]:
    """L(z) [J] of the unknowns z (n,): strain energy (perturbed by the pressure) minus the work of
    gravity.
    """
    density = _by_region(body, body.element.density, *_strains(body, z))
    mass = jnp.repeat(body.densities, np.array(body.counts), total_repeat_length=len(body.tets))
    u = body.displacement(z)[body.tets]
    fall = jnp.einsum("eq,qa,eai,i->e", body.weights, jnp.asarray(body.element.values), u, body.gravity)
    return jnp.sum(body.weights * density) - jnp.sum(mass * fall)


def residual(body: Body, z: Float[Array, " n"]) -> Float[Array, " n"]:
    """r(z) = ∂L/∂z (n,): nodal forces [N] that the body exerts against loads, then volume mismatches [J]."""
    return jax.grad(lagrangian, argnums=1)(body, z)


def element_tangents(body: Body, z: Float[Array, " n"]) -> Float[Array, "e d d"]:
    """Second derivatives (e, d, d) of every element's energy in the order of `element_unknowns`: Σ_q w Bᵀ
    (∂²density/∂h²) B.
    """
    mixed = body.element.pressures > 0
    size = 10 if mixed else 9

    def density(h, material):
        return body.element.density(material, h[:9].reshape(3, 3), h[9] if mixed else jnp.zeros(()))

    f, p = _strains(body, z)
    h = f.reshape(*f.shape[:2], 9)
    if mixed:
        h = jnp.concatenate([h, p[..., None]], axis=-1)
    moduli = _by_region(body, lambda material, x: jax.hessian(density)(x, material), h)
    e, q, a, _ = body.gradients.shape
    # B maps the element's unknowns to h: F_ij = Σ_a u_ai ∂N_a/∂X_j, p = Σ_c p_c L_c.
    b = jnp.einsum("eqaj,ik->eqijak", body.gradients, jnp.eye(3)).reshape(e, q, 9, 3 * a)
    if mixed:
        corner = body.pressure_unit * jnp.asarray(body.element.points)
        b = jnp.pad(b, ((0, 0), (0, 0), (0, 1), (0, corner.shape[1])))
        b = b.at[:, :, 9, 3 * a :].set(corner)
    db = (body.weights[..., None, None] * moduli) @ b
    d = b.shape[-1]
    return b.reshape(e, q * size, d).swapaxes(1, 2) @ db.reshape(e, q * size, d)


def tangent_action(body: Body, z: Float[Array, " n"], directions: Float[Array, "n c"]) -> Float[Array, "n c"]:
    """K(z) applied to c directions (n, c), without forming K."""
    _, action = jax.linearize(lambda x: residual(body, x), z)
    return jax.vmap(action, 1, 1)(directions)


def volume_ratios(body: Body, z: Float[Array, " n"]) -> Float[Array, "e q"]:
    """J = det F at every quadrature point; J ≤ 0 means an inverted element."""
    f, _ = _strains(body, z)
    return jax.vmap(jax.vmap(jacobian))(f)
