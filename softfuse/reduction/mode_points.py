"""Quadrature points of one material, and how they are strained by a body's modes.

At a point the generalised strain is linear in the amplitudes z = (α, β): F = I + Σ α_k H_k, with the mode's
displacement gradient H_k, and p = Σ β_k p_k. So no node and no element is left of the mesh: forces and
tangent are sums over points of what the material's density answers there, times the modes' own strains.
"""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.body.body import Body
from softfuse.body.element import Element
from softfuse.material.base import AbstractMaterial
from softfuse.material.components import Tensor, components, determinant, whole

_MODES_AT_ONCE = 16


class ModePoints(eqx.Module):
    """Points of one material with their `volumes` (k,) [m³]: `gradients` (k, 9, m) [1/m] of m displacement
    modes, `pressures` (k, b) [Pa] of b pressure modes.
    """

    material: AbstractMaterial
    gradients: Float[Array, "k 9 m"]
    pressures: Float[Array, "k b"]
    volumes: Float[Array, " k"]
    element: Element = eqx.field(static=True)

    def residual(self, z: Float[Array, " n"]) -> Float[Array, " n"]:
        """Generalised forces (n,) of the points at amplitudes (n,)."""
        stress, mismatch = self._conjugates(*self._strains(z))
        m = self.gradients.shape[-1]
        return jnp.concatenate(
            [self.gradients.reshape(-1, m).T @ stress.ravel(), self.pressures.T @ mismatch]
        )

    def tangent(self, z: Float[Array, " n"]) -> Float[Array, "n n"]:
        """Derivative (n, n) of the `residual` at amplitudes (n,)."""
        k, _, m = self.gradients.shape
        _, action = jax.linearize(self._conjugates, *self._strains(z))
        units = jnp.broadcast_to(jnp.eye(9)[:, None], (9, k, 9))
        stiffness, coupling = jax.vmap(lambda h: action(h, jnp.zeros(k)))(units)
        _, softness = action(jnp.zeros((k, 9)), jnp.ones(k))
        stressed = jnp.einsum("akc,kcm->kam", stiffness, self.gradients)
        upper = self.gradients.reshape(-1, m).T @ stressed.reshape(-1, m)
        side = jnp.einsum("ck,kcm->km", coupling, self.gradients).T @ self.pressures
        lower = self.pressures.T @ (softness[:, None] * self.pressures)
        return jnp.block([[upper, side], [side.T, lower]])

    def volume_ratios(self, z: Float[Array, " n"]) -> Float[Array, " k"]:
        """J = det F (k,) at amplitudes (n,)."""
        return determinant(_deformation(self._strains(z)[0]))

    def beyond_rest(self, z: Float[Array, " n"]) -> Float[Array, "n k"]:
        """Every point's own generalised forces (n, k) at amplitudes (n,), without those that its tangent at
        rest makes.
        """
        strains = self._strains(z)
        still = jax.tree.map(jnp.zeros_like, strains)
        linear = jax.jvp(self._conjugates, still, strains)[1]
        stress, mismatch = jax.tree.map(jnp.subtract, self._conjugates(*strains), linear)
        moved = jnp.einsum("kcm,kc->mk", self.gradients, stress)
        return jnp.concatenate([moved, self.pressures.T * mismatch])

    def _strains(self, z: Float[Array, " n"]) -> tuple[Float[Array, "k 9"], Float[Array, " k"]]:
        k, _, m = self.gradients.shape
        return (self.gradients.reshape(-1, m) @ z[:m]).reshape(k, 9), self.pressures @ z[m:]

    def _conjugates(
        self, h: Float[Array, "k 9"], pressure: Float[Array, " k"]
    ) -> tuple[Float[Array, "k 9"], Float[Array, " k"]]:
        """What does work on gradients [Pa m³] and pressures [m³]."""

        def energy(h, pressure):
            measures = self.material.measures(_deformation(h))
            return self.volumes @ self.element.density(*measures, self.material.lame, pressure)

        return jax.grad(energy, (0, 1))(h, pressure)


def mode_points(
    body: Body, displacement: Float[np.ndarray, "u m"], pressure: Float[np.ndarray, "c b"]
) -> tuple[ModePoints, ...]:
    """All quadrature points of a body, those of each material together in the order (q, e), under
    displacement modes (u, m) and pressure modes (c, b).
    """

    @jax.jit
    def strained(
        modes: Float[Array, "s n_plus_1"],
    ) -> list[tuple[Float[Array, "s k 9"], Float[Array, "s k"]]]:
        def gradients(region, z):
            slopes, pressure = region.strains(z)
            h = whole(region.deformation(slopes)).reshape(9, -1) - jnp.eye(3).reshape(9, 1)
            return h.T, pressure.ravel()

        return [jax.vmap(lambda z, r=r: gradients(r, z))(modes) for r in body.regions()]

    def parts(columns: Float[np.ndarray, "r s"], first: int) -> list[list[np.ndarray]]:
        """Of each region, gradients (s, k, 9) and pressures (s, k) of unknowns `first` and after (r, s)."""
        whole_modes = np.zeros((columns.shape[1], body.n + 1))
        whole_modes[:, first : first + len(columns)] = columns.T
        found = [
            jax.tree.map(np.asarray, strained(jnp.asarray(whole_modes[k : k + _MODES_AT_ONCE])))
            for k in range(0, max(len(whole_modes), 1), _MODES_AT_ONCE)
        ]
        return [[np.concatenate(each) for each in zip(*of, strict=True)] for of in zip(*found, strict=True)]

    moves, presses = parts(displacement, 0), parts(pressure, body.n_displacements)
    return tuple(
        ModePoints(
            region.material,
            jnp.asarray(np.ascontiguousarray(gradients.transpose(1, 2, 0))),
            jnp.asarray(np.ascontiguousarray(pressures.T)),
            region.volumes.ravel(),
            body.element,
        )
        for region, (gradients, _), (_, pressures) in zip(body.regions(), moves, presses, strict=True)
    )


def weighted(
    points: tuple[ModePoints, ...], numbers: Int[np.ndarray, " c"], weights: Float[np.ndarray, " c"]
) -> tuple[ModePoints, ...]:
    """Some of all points, numbered (c,) material by material, their volumes multiplied by weights (c,) [-];
    materials without any are left out.
    """
    found, first = [], 0
    for each in points:
        last = first + len(each.volumes)
        own = (numbers >= first) & (numbers < last)
        if own.any():
            at = numbers[own] - first
            found.append(
                replace(
                    each,
                    gradients=each.gradients[at],
                    pressures=each.pressures[at],
                    volumes=each.volumes[at] * jnp.asarray(weights[own]),
                )
            )
        first = last
    return tuple(found)


def _deformation(h: Float[Array, "k 9"]) -> Tensor:
    return components((h.T + jnp.eye(3).reshape(9, 1)).reshape(3, 3, -1))
