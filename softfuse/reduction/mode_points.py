"""Quadrature points of one material, and how they are strained by a body's modes.

At a point the generalised strain is linear in the amplitudes z = (α, β): F = I + Σ α_k H_k, with the mode's
displacement gradient H_k, and p = Σ β_k p_k. So no node and no element is left of the mesh: forces and
tangent are sums over points of what the material's density answers there, times the modes' own strains.
"""

from collections.abc import Callable
from typing import NamedTuple

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


class _Moduli(NamedTuple):
    """Second derivatives of the points' energies in their strains."""

    stiffness: Float[Array, "k 9 9"]
    coupling: Float[Array, "k 9"]
    softness: Float[Array, " k"]


class ModePoints(eqx.Module):
    """Points of one material with their `volumes` (k,) [m³]: `gradients` (9 k, m) [1/m] of m displacement
    modes, `pressures` (k, b) [Pa] of b pressure modes; and both transposed, because XLA multiplies a vector
    by the rows of a matrix ten times as fast as by its columns.
    """

    material: AbstractMaterial
    gradients: Float[Array, "9k m"]
    pressures: Float[Array, "k b"]
    by_gradient: Float[Array, "m 9k"]
    by_pressure: Float[Array, "b k"]
    volumes: Float[Array, " k"]
    element: Element = eqx.field(static=True)

    @classmethod
    def of(
        cls,
        material: AbstractMaterial,
        gradients: Float[Array, "k 9 m"],
        pressures: Float[Array, "k b"],
        volumes: Float[Array, " k"],
        element: Element,
    ) -> "ModePoints":
        """Points of gradients (k, 9, m) and pressures (k, b) of the modes."""
        flat = gradients.reshape(-1, gradients.shape[-1])
        return cls(material, flat, pressures, flat.T.copy(), pressures.T.copy(), volumes, element)

    def single(self) -> "ModePoints":
        """The same points in single precision; amplitudes and forces stay in double."""
        return jax.tree.map(lambda leaf: leaf.astype(jnp.float32), self)

    def residual(self, z: Float[Array, " n"]) -> Float[Array, " n"]:
        """Generalised forces (n,) of the points at amplitudes (n,)."""
        return self._collected(*self._conjugates(*self._strains(z)))

    def tangent_action(self, z: Float[Array, " n"]) -> Callable[[Float[Array, "n c"]], Float[Array, "n c"]]:
        """The map of directions (n, c) to what they change in the `residual`."""
        at = self._moduli(z)

        def action(directions: Float[Array, "n c"]) -> Float[Array, "n c"]:
            h, pressure = self._strains(directions)
            stress = jnp.einsum("kab,kb...->ka...", at.stiffness, h)
            stress = stress + jnp.einsum("ka,k...->ka...", at.coupling, pressure)
            mismatch = jnp.einsum("kb,kb...->k...", at.coupling, h)
            return self._collected(stress, mismatch + jnp.einsum("k,k...->k...", at.softness, pressure))

        return action

    def tangent(self, z: Float[Array, " n"]) -> Float[Array, "n n"]:
        """Derivative (n, n) of the `residual` at amplitudes (n,)."""
        at = self._moduli(z)
        each = self.gradients.reshape(*at.coupling.shape, -1)
        upper = self.by_gradient @ jnp.einsum("kab,kbm->kam", at.stiffness, each).reshape(
            self.gradients.shape
        )
        side = self.by_gradient @ (at.coupling[:, :, None] * self.pressures[:, None]).reshape(
            len(self.gradients), -1
        )
        lower = self.by_pressure @ (at.softness[:, None] * self.pressures)
        return jnp.block([[upper, side], [side.T, lower]]).astype(z.dtype)

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
        moved = jnp.einsum("mkc,kc->mk", self.by_gradient.reshape(-1, *stress.shape), stress)
        return jnp.concatenate([moved, self.by_pressure * mismatch])

    def _strains(self, z: Float[Array, "n *c"]) -> tuple[Float[Array, "k 9 *c"], Float[Array, "k *c"]]:
        """Displacement gradients and pressures of amplitudes, in the points' own precision."""
        own, m = z.astype(self.gradients.dtype), self.gradients.shape[1]
        h = (self.gradients @ own[:m]).reshape(len(self.volumes), 9, *z.shape[1:])
        return h, self.pressures @ own[m:]

    def _collected(
        self, stress: Float[Array, "k 9 *c"], mismatch: Float[Array, "k *c"]
    ) -> Float[Array, "n *c"]:
        """Generalised forces of what works on gradients and pressures."""
        # Or XLA computes the stresses anew for every mode.
        stress, mismatch = jax.lax.optimization_barrier((stress, mismatch))
        moved = self.by_gradient @ stress.reshape(-1, *stress.shape[2:])
        return jnp.concatenate([moved, self.by_pressure @ mismatch]).astype(float)

    def _moduli(self, z: Float[Array, " n"]) -> _Moduli:
        h, pressure = self._strains(z)
        _, action = jax.linearize(self._conjugates, h, pressure)
        units = jnp.broadcast_to(jnp.eye(9, dtype=h.dtype)[:, None], (9, *h.shape))
        stiffness, coupling = jax.vmap(lambda unit: action(unit, jnp.zeros_like(pressure)))(units)
        _, softness = action(jnp.zeros_like(h), jnp.ones_like(pressure))
        return _Moduli(stiffness.transpose(1, 0, 2), coupling.T, softness)

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
        ModePoints.of(
            region.material,
            jnp.asarray(gradients.transpose(1, 2, 0)),
            jnp.asarray(pressures.T),
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
                ModePoints.of(
                    each.material,
                    each.gradients.reshape(len(each.volumes), 9, -1)[at],
                    each.pressures[at],
                    each.volumes[at] * jnp.asarray(weights[own]),
                    each.element,
                )
            )
        first = last
    return tuple(found)


def _deformation(h: Float[Array, "k 9"]) -> Tensor:
    return components((h.T + jnp.eye(3, dtype=h.dtype).reshape(9, 1)).reshape(3, 3, -1))
