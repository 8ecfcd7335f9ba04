"""Quadrature points of one material, and how they are strained by a body's modes.

At a point the generalised strain is linear in the amplitudes z = (α, β): F = I + Σ α_k H_k, with the mode's
displacement gradient H_k, and p = Σ β_k p_k. So no node and no element is left of the mesh: forces and
tangent are sums over points of what the material's density answers there, times the modes' own strains.

Where the body is f times as stiff as its material, w f density(F, p/f) is the energy of a point with f times
the volume and pressures over f: as such it is kept.
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
from softfuse.body.region import Region, natural_slopes
from softfuse.material.base import AbstractMaterial
from softfuse.material.components import Tensor, determinant
from softfuse.rom.basis import Basis

_Components = tuple[Float[Array, " k"], ...]
"""The nine components of a tensor at the points, row by row."""

_AT_ONCE = 1000  # points


class _Moduli(NamedTuple):
    """Second derivatives of the points' energies in their strains."""

    stiffness: Float[Array, "9 9 k"]
    coupling: Float[Array, "9 k"]
    softness: Float[Array, " k"]


class Work(NamedTuple):
    """Work (c, k) of k points in c directions: the `whole`, and what their tangents at rest make of it."""

    whole: Float[Array | np.ndarray, "c k"]
    of_rest: Float[Array | np.ndarray, "c k"]


class ModePoints(eqx.Module):
    """Points of one material with their `volumes` (k,) [m³]: `gradients` (9 k, m) [1/m] of m displacement
    modes, component by component; `pressures` (k, b) [Pa] of b pressure modes; and both transposed, because
    XLA multiplies a vector by the rows of a matrix ten times as fast as by its columns.
    """

    material: AbstractMaterial
    gradients: Float[Array, "nine_k m"]
    pressures: Float[Array, "k b"]
    by_gradient: Float[Array, "m nine_k"]
    by_pressure: Float[Array, "b k"]
    volumes: Float[Array, " k"]
    element: Element = eqx.field(static=True)

    @classmethod
    def of(
        cls,
        material: AbstractMaterial,
        gradients: Float[Array | np.ndarray, "9 k m"],
        pressures: Float[Array | np.ndarray, "k b"],
        volumes: Float[Array | np.ndarray, " k"],
        element: Element,
    ) -> "ModePoints":
        """Points of gradients (9, k, m) and pressures (k, b) of the modes."""
        flat = gradients.reshape(-1, gradients.shape[-1])
        by_gradient, by_pressure = flat.T.copy(), pressures.T.copy()
        arrays = map(jnp.asarray, (flat, pressures, by_gradient, by_pressure, volumes))
        return cls(material, *arrays, element=element)

    @property
    def each_gradient(self) -> Float[Array, "9 k m"]:
        """The modes' gradients, by component and point."""
        return self.gradients.reshape(9, len(self.volumes), -1)

    def padded(self, count: int) -> "ModePoints":
        """With points that have no volume, so many that there are `count`."""
        missing = count - len(self.volumes)
        return ModePoints.of(
            self.material,
            jnp.pad(self.each_gradient, ((0, 0), (0, missing), (0, 0))),
            jnp.pad(self.pressures, ((0, missing), (0, 0))),
            jnp.pad(self.volumes, (0, missing)),
            self.element,
        )

    def single(self) -> "ModePoints":
        """The same points in single precision; amplitudes and forces stay in double."""
        return jax.tree.map(lambda leaf: leaf.astype(jnp.float32), self)

    def residual(self, z: Float[Array, " n"]) -> Float[Array, " n"]:
        """Generalised forces (n,) of the points at amplitudes (n,)."""
        stress, mismatch = self._conjugates(*self._strained(z))
        # With each component in a loop of its own, before XLA puts them together.
        return self._collected(jnp.stack(jax.lax.optimization_barrier(stress)), mismatch)

    def tangent_action(self, z: Float[Array, " n"]) -> Callable[[Float[Array, "n c"]], Float[Array, "n c"]]:
        """The map of directions (n, c) to what they change in the `residual`."""
        at = self._moduli(z)

        def action(directions: Float[Array, "n c"]) -> Float[Array, "n c"]:
            h, pressure = self._strains(directions)
            stress = jnp.einsum("abk,bk...->ak...", at.stiffness, h)
            stress = stress + jnp.einsum("ak,k...->ak...", at.coupling, pressure)
            mismatch = jnp.einsum("bk,bk...->k...", at.coupling, h)
            return self._collected(stress, mismatch + jnp.einsum("k,k...->k...", at.softness, pressure))

        return action

    def tangent(self, z: Float[Array, " n"]) -> Float[Array, "n n"]:
        """Derivative (n, n) of the `residual` at amplitudes (n,), in the points' own precision."""
        at, each = self._moduli(z), self.each_gradient
        # One component after the other: XLA makes a loop over points of small products otherwise.
        stress = [sum(at.stiffness[a, b][:, None] * each[b] for b in range(9)) for a in range(9)]
        by_gradient = self.gradients.T
        upper = by_gradient @ jnp.concatenate(jax.lax.optimization_barrier(stress))
        side = by_gradient @ (at.coupling.reshape(-1, 1) * jnp.tile(self.pressures, (9, 1)))
        lower = self.pressures.T @ (at.softness[:, None] * self.pressures)
        return jnp.block([[upper, side], [side.T, lower]])

    def volume_ratios(self, z: Float[Array, " n"]) -> Float[Array, " k"]:
        """J = det F (k,) at amplitudes (n,)."""
        return determinant(_deformation(self._strained(z)[0]))

    def work(self, z: Float[Array, " n"], along: Float[Array, "n c"]) -> Work:
        """Every point's own work on directions (n, c) at amplitudes (n,)."""
        strained = self._strained(z)
        still = jax.tree.map(jnp.zeros_like, strained)
        of_rest = jax.jvp(self._conjugates, still, strained)[1]
        h, pressure = self._strains(along)

        def done(stress: _Components, mismatch: Float[Array, " k"]) -> Float[Array, "c k"]:
            return jnp.einsum("ak,akc->ck", jnp.stack(stress), h) + mismatch * pressure.T

        return Work(done(*self._conjugates(*strained)), done(*of_rest))

    def _strains(self, z: Float[Array, "n *c"]) -> tuple[Float[Array, "9 k *c"], Float[Array, "k *c"]]:
        """Displacement gradients and pressures of amplitudes, in the points' own precision."""
        own, m = z.astype(self.gradients.dtype), self.gradients.shape[1]
        h = (self.gradients @ own[:m]).reshape(9, len(self.volumes), *z.shape[1:])
        return h, self.pressures @ own[m:]

    def _strained(self, z: Float[Array, " n"]) -> tuple[_Components, Float[Array, " k"]]:
        """The strains with each component by itself."""
        h, pressure = self._strains(z)
        return tuple(h), pressure

    def _collected(
        self, stress: Float[Array, "9 k *c"], mismatch: Float[Array, "k *c"]
    ) -> Float[Array, "n *c"]:
        """Generalised forces of what works on gradients and pressures."""
        # Or XLA computes the stresses anew for every mode.
        stress, mismatch = jax.lax.optimization_barrier((stress, mismatch))
        moved = self.by_gradient @ stress.reshape(-1, *stress.shape[2:])
        return jnp.concatenate([moved, self.by_pressure @ mismatch]).astype(float)

    def _moduli(self, z: Float[Array, " n"]) -> _Moduli:
        h, pressure = self._strained(z)
        _, action = jax.linearize(self._conjugates, h, pressure)
        units = jnp.eye(9, dtype=pressure.dtype)[:, :, None] * jnp.ones_like(pressure)
        stress, coupling = jax.vmap(lambda unit: action(tuple(unit), jnp.zeros_like(pressure)))(units)
        _, softness = action(jax.tree.map(jnp.zeros_like, h), jnp.ones_like(pressure))
        # By direction so far; it is symmetric.
        return _Moduli(jnp.stack(jax.lax.optimization_barrier(stress)), coupling, softness)

    def _conjugates(
        self, h: _Components, pressure: Float[Array, " k"]
    ) -> tuple[_Components, Float[Array, " k"]]:
        """What does work on gradients [Pa m³] and pressures [m³]."""

        def energy(h, pressure):
            measures = self.material.measures(_deformation(h))
            return self.volumes @ self.element.density(*measures, self.material.lame, pressure)

        return jax.grad(energy, (0, 1))(h, pressure)


def _deformation(h: _Components) -> Tensor:
    """F = I + H."""
    one = jnp.ones((), h[0].dtype)
    a, b, c, d, e, f, g, h_, i = h
    return (a + one, b, c), (d, e + one, f), (g, h_, i + one)


def mode_points(
    body: Body,
    basis: Basis,
    numbers: Int[np.ndarray, " c"] | None = None,
    weights: Float[np.ndarray, " c"] | None = None,
) -> tuple[ModePoints, ...]:
    """Quadrature points of a body under the modes of a basis, those of each material together.

    `numbers` (c,): which, counted material by material in the order (q, e) of each; None for all. Their
    volumes are multiplied by `weights` (c,) [-]; what is stiffer than its material, see `ModePoints`.
    """
    count = body.volumes.size
    numbers = np.arange(count) if numbers is None else numbers
    weights = np.ones(len(numbers)) if weights is None else weights
    moves = _followed_by_zeros(basis.displacement, body.n)
    presses = _followed_by_zeros(basis.pressure, body.n - body.n_displacements)
    found, first = [], 0
    for region in body.regions():
        own = (numbers >= first) & (numbers < first + region.volumes.size)
        at = numbers[own] - first
        first += region.volumes.size
        factors = _factors(region, at)
        pieces = [at[k : k + _AT_ONCE] for k in range(0, max(1, len(at)), _AT_ONCE)]
        points = ModePoints.of(
            region.material,
            jnp.asarray(np.concatenate([_gradients(region, moves, each) for each in pieces], axis=1)),
            jnp.asarray(
                np.concatenate([_pressures(region, presses, body.n_displacements, each) for each in pieces])
                / factors[:, None]
            ),
            region.volumes.ravel()[at] * jnp.asarray(weights[own] * factors),
            body.element,
        )
        found.append(points)
    return tuple(found)


def _followed_by_zeros(modes: Float[np.ndarray, "r m"], rows: int) -> Float[np.ndarray, "rows_plus_1 m"]:
    """Modes with rows of zeros behind, the last of which is that of held unknowns."""
    return np.concatenate([modes, np.zeros((rows + 1 - len(modes), modes.shape[1]))])


def _factors(region: Region, at: Int[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """How many times as stiff as its material points `at` (k,) of a region are."""
    if region.factors is None:
        return np.ones(len(at))
    return np.asarray(region.factors)[at % region.volumes.shape[1]]


def _gradients(
    region: Region, moves: Float[np.ndarray, "n_plus_1 m"], at: Int[np.ndarray, " k"]
) -> Float[np.ndarray, "9 k m"]:
    """Displacement gradients (9, k, m) [1/m] of modes at points `at` (k,) of a region."""
    point, element = np.divmod(at, region.volumes.shape[1])
    each = natural_slopes(region.element).reshape(3, -1, region.element.nodes)[:, point]
    nodal = moves[np.asarray(region.displacements)[:, :, element]]
    slopes = np.einsum("nka,iakm->inkm", each, nodal, optimize=True)
    frames = np.asarray(region.frames)[:, :, point, element] / np.asarray(region.volumes)[point, element]
    return np.einsum("inkm,njk->ijkm", slopes, frames, optimize=True).reshape(9, len(at), -1)


def _pressures(
    region: Region, presses: Float[np.ndarray, "c_plus_1 b"], first: int, at: Int[np.ndarray, " k"]
) -> Float[np.ndarray, "k b"]:
    """Pressures (k, b) [Pa] of modes at points `at` (k,), unknowns counted from `first`."""
    count = region.element.pressures
    if not count:
        return np.zeros((len(at), presses.shape[1]))
    point, element = np.divmod(at, region.volumes.shape[1])
    nodal = presses[np.asarray(region.pressures)[:, element] - first]
    return float(region.pressure_unit) * np.einsum(
        "kc,ckb->kb", region.element.points[point][:, :count], nodal
    )
