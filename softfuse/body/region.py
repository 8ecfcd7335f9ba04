"""The elements of one material, and the derivatives of their energy with respect to their own unknowns.

Arrays over quadrature points end in (q, e), so that loops run along the elements. With natural coordinates ξ,
slopes G_im = Σ_a u_ai ∂N_a/∂ξ_m are the same sums in all elements, and the displacement gradient is

    H_ij = Σ_m G_im B_mj / w,   B_mj = w ∂ξ_m/∂X_j,   F = I + H,

with the points' volumes w [m³]. Back from the stress P = ∂density/∂F, a node's force is Σ_q Σ_m S_im
∂N_a/∂ξ_m with S_im = Σ_j P_ij B_mj. The division by w is where XLA stores H instead of computing it again for
everything that depends on it.

An element that is f times as stiff as its material has all moduli times f: its density is f density(F, p/f).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.body.element import Element
from softfuse.material.base import AbstractMaterial
from softfuse.material.components import Tensor, cofactor, contraction, determinant

Slopes = tuple[Float[Array, "3 q e"], Float[Array, "3 q e"], Float[Array, "3 q e"]]
"""Of each component i of a nodal vector field: its slopes along ξ, [m] (3, q, e)."""


class Region(NamedTuple):
    """One material's elements: B (3, 3, q, e) [m²], w (q, e) [m³], the unknowns of their displacements
    (3, a, e) and pressures (c, e), and how many times as stiff each is (e,), None: all just as stiff.

    `excess` (q, e) [Pa]: a second Piola-Kirchhoff stress that tangents have beyond that of the strain, see
    `excess_after`.
    """

    element: Element
    material: AbstractMaterial
    frames: Float[Array, "3 3 q e"]
    volumes: Float[Array, "q e"]
    displacements: Int[Array, "3 a e"]
    pressures: Int[Array, "c e"]
    pressure_unit: Float[Array, ""]
    factors: Float[Array, " e"] | None
    excess: Tensor | None = None

    def strains(self, z: Float[Array, " n_plus_1"]) -> tuple[Slopes, Float[Array, "q e"]]:
        """Natural slopes [m] and pressures [Pa] of unknowns followed by a 0 for those that are held."""
        to_points = jnp.asarray(natural_slopes(self.element))
        a, b, c = (
            (to_points @ _taken(z, self.displacements[i])).reshape(3, *self.volumes.shape) for i in range(3)
        )
        return (a, b, c), self._pressure(z)

    def _pressure(self, z: Float[Array, " n_plus_1"]) -> Float[Array, "q e"]:
        if not self.element.pressures:
            return jnp.zeros_like(self.volumes)
        return self.pressure_unit * (jnp.asarray(self.element.points) @ _taken(z, self.pressures))

    def deformation(self, slopes: Slopes) -> Tensor:
        """F at the quadrature points."""

        def entry(i: int, j: int) -> Float[Array, "q e"]:
            g, b = slopes[i], self.frames
            h = (g[0] * b[0, j] + g[1] * b[1, j] + g[2] * b[2, j]) / self.volumes
            return h + 1.0 if i == j else h

        a, b, c = ((entry(i, 0), entry(i, 1), entry(i, 2)) for i in range(3))
        return a, b, c

    def density(self, f: Tensor, pressure: Float[Array, "q e"]) -> Float[Array, "q e"]:
        """The element's density [J/m³] at the quadrature points."""
        if self.factors is None:
            density = self._of_material(f, pressure)
        else:
            density = self.factors * self._of_material(f, pressure / self.factors)
        return density if self.excess is None else density + 0.5 * contraction(self.excess, _gram(f, f))

    def _of_material(self, f: Tensor, pressure: Float[Array, "q e"]) -> Float[Array, "q e"]:
        return self.element.density(*self.material.measures(f), self.material.lame, pressure)

    def excess_after(self, z: Float[Array, " n_plus_1"], step: Float[Array, " n_plus_1"]) -> Tensor:
        """By how much the stress S that the tangent at z − step expected of the step exceeds S(z).

        A step that turns a slender body stretches it, which a linear S does not see: Newton's method with
        S as an unknown of its own, of which no more is left than its excess over S(z), is not led astray by
        that stretch. Source: Magisano, Leonetti and Garcea, Comput. Methods Appl. Mech. Eng. 313 (2017) 934.
        """

        def stress(z):
            slopes, pressure = self.strains(z)
            f = self.deformation(slopes)
            first = jax.grad(lambda f: jnp.sum(self.density(f, pressure)))(f)
            pulled, volume = _gram(cofactor(f), first), determinant(f)
            return tuple(tuple(entry / volume for entry in row) for row in pulled)

        expected = jax.tree.map(jnp.add, *jax.jvp(stress, (z - step,), (step,)))
        excess = jax.tree.map(jnp.subtract, expected, stress(z))
        # Or XLA computes it anew for every column of the tangents.
        return jax.lax.optimization_barrier(excess)

    def energy(self, z: Float[Array, " n_plus_1"]) -> Float[Array, ""]:
        """Σ_e Σ_q w density [J]."""
        slopes, pressure = self.strains(z)
        return jnp.sum(self.volumes * self.density(self.deformation(slopes), pressure))

    def conjugates(self, slopes: Slopes, pressure: Float[Array, "q e"]) -> tuple[Slopes, Float[Array, "q e"]]:
        """What does work on slopes and pressures: S [N] and the volume mismatch w ∂density/∂p [m³]."""

        def total(f, p):
            return jnp.sum(self.density(f, p))

        stress, mismatch = jax.grad(total, (0, 1))(self.deformation(slopes), pressure)
        columns = [self.frames[:, j] for j in range(3)]
        a, b, c = (row[0] * columns[0] + row[1] * columns[1] + row[2] * columns[2] for row in stress)
        return (a, b, c), self.volumes * mismatch

    def add_forces(
        self, total: Float[Array, " n_plus_1"], forces: Slopes, mismatch: Float[Array, "q e"]
    ) -> Float[Array, " n_plus_1"]:
        """Add to `total` what the `conjugates` amount to at the unknowns."""
        from_points = jnp.asarray(natural_slopes(self.element).T)
        for i in range(3):
            nodal = from_points @ forces[i].reshape(-1, self.volumes.shape[1])
            total = _added(total, self.displacements[i], nodal)
        if self.element.pressures:
            nodal = self.pressure_unit * (jnp.asarray(self.element.points).T @ mismatch)
            total = _added(total, self.pressures, nodal)
        return total

    def tangents(self, z: Float[Array, " n_plus_1"]) -> Float[Array, "e d d"]:
        """Second derivatives (e, d, d) of the elements' energies: displacements by node, then pressures."""
        slopes, pressure = self.strains(z)
        points, elements = self.volumes.shape
        a, c = self.element.nodes, self.element.pressures
        each = natural_slopes(self.element).reshape(3, points, a)
        pairs = np.einsum("nqb,mqa->nmqab", each, each).reshape(9 * points, a * a)
        mixed = np.einsum("nqb,qc->nqbc", each, self.element.points[:, :c]).reshape(3 * points, a * c)
        blocks: dict[tuple[int, int], Array] = {}
        coupling: list[Array] = []
        for k in range(3):

            def along(g, k=k):
                first, second, third = (g if i == k else slopes[i] for i in range(3))
                return self.conjugates((first, second, third), pressure)

            unit = jnp.broadcast_to(jnp.eye(3)[:, :, None, None], (3, *slopes[k].shape))
            _, action = jax.linearize(along, slopes[k])
            forces, mismatch = jax.vmap(action)(unit)
            for i in range(k, 3):
                block = (forces[i].reshape(9 * points, elements).T @ pairs).reshape(elements, a, a)
                blocks[i, k], blocks[k, i] = block, block.swapaxes(1, 2)
            coupling.append((mismatch.reshape(3 * points, elements).T @ mixed).reshape(elements, a, c))
        stiffness = jnp.stack([jnp.stack([blocks[i, k] for k in range(3)], -1) for i in range(3)], 2)
        stiffness = stiffness.reshape(elements, 3 * a, 3 * a)
        if not c:
            return stiffness
        _, (_, softness) = jax.jvp(
            lambda p: self.conjugates(slopes, p), (pressure,), (jnp.ones_like(pressure),)
        )
        corners = np.einsum("qc,qd->qcd", self.element.points, self.element.points).reshape(points, c * c)
        lower = self.pressure_unit**2 * (softness.T @ corners).reshape(elements, c, c)
        side = self.pressure_unit * jnp.stack(coupling, 2).reshape(elements, 3 * a, c)
        upper = jnp.concatenate([stiffness, side], 2)
        return jnp.concatenate([upper, jnp.concatenate([side.swapaxes(1, 2), lower], 2)], 1)


def _gram(s: Tensor, t: Tensor) -> Tensor:
    """Sᵀ T."""

    def row(i: int) -> tuple[Array, Array, Array]:
        a, b, c = (sum((s[k][i] * t[k][j] for k in (1, 2)), s[0][i] * t[0][j]) for j in range(3))
        return a, b, c

    return row(0), row(1), row(2)


def natural_slopes(element: Element) -> Float[np.ndarray, "m a"]:
    """∂N_a/∂ξ_m at the quadrature points (3 q, a), all points for each m; ξ are the last three barycentric
    coordinates.
    """
    slopes = element.slopes[:, :, 1:] - element.slopes[:, :, :1]
    return np.moveaxis(slopes, -1, 0).reshape(-1, element.nodes)


def _taken(z: Float[Array, " n_plus_1"], index: Int[Array, "..."]) -> Float[Array, "..."]:
    return z.at[index].get(mode="promise_in_bounds", wrap_negative_indices=False)


def _added(
    total: Float[Array, " n_plus_1"], index: Int[Array, "..."], values: Float[Array, "..."]
) -> Float[Array, " n_plus_1"]:
    return total.at[index].add(values, mode="promise_in_bounds", wrap_negative_indices=False)
