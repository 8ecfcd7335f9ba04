"""What the surface of a cavity looks like before it is scaled, turned and put in its place.

A profile is the surface {r(u) u} around the origin, star-shaped, with the radius r [-] along directions u: all
of them touch the cube |x|, |y|, |z| ≤ 1 where they are convex, so that a cavity's half-sizes are those of its
bounding box. The roundness ρ goes from 0, a box, to 1, an ellipsoid:

    rounded box        what balls of radius ρ inside the cube cover: Σ max(r |u_i| − 1 + ρ, 0)² = ρ²
    superellipsoid     Σ |r u_i|^N = 1 with N = 2/ρ
    free form          r of another profile times exp Σ c_k Y_k(u)

with real spherical harmonics Y_k of degrees 2, 3, ...; those of degree 0 and 1 are size and place. The
support function max {n · x} of a profile tells how far it reaches along n; that of a superellipsoid is the
dual norm. Sources: A. H. Barr, IEEE Comput. Graph. Appl. 1(1), 1981, DOI 10.1109/MCG.1981.1673799
(superquadrics); R. Schneider, Convex Bodies, 2nd ed., 2014, sec. 1.7 (support functions).
"""

from abc import abstractmethod

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.design.cube_sphere import cube_sphere

_NOTHING = 1e-150
"""Component of a direction below which its powers are 0, so that they have derivatives."""

_CELLS = 40
"""Along an edge of the cube through whose grid a profile that may not be convex is looked at."""


class AbstractProfile(eqx.Module):
    """A star-shaped surface with parameters (k,) [-] of given `names`."""

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Of the parameters (k,)."""

    @property
    @abstractmethod
    def lowest(self) -> tuple[float, ...]:
        """The parameters (k,) [-] must be greater."""

    @property
    @abstractmethod
    def highest(self) -> tuple[float, ...]:
        """The parameters (k,) [-] must not be greater."""

    @abstractmethod
    def radius(
        self, parameters: Float[Array, " k"], directions: Float[np.ndarray, "m 3"]
    ) -> Float[Array, " m"]:
        """Radius (m,) [-] along unit directions (m, 3) with parameters (k,); differentiable in these."""

    @abstractmethod
    def support(self, parameters: Float[Array, " k"], normals: Float[Array, "m 3"]) -> Float[Array, " m"]:
        """How far (m,) the profile reaches along vectors (m, 3), in their unit: max n · x; differentiable in
        both. Where it is not convex it is the convex hull's.
        """


class RoundedBox(AbstractProfile):
    """A cube with edges and corners rounded by a part of the half-size: one parameter, 0 to 1."""

    @property
    def names(self):
        """The roundness alone."""
        return ("roundness",)

    @property
    def lowest(self):
        """A box."""
        return (0.0,)

    @property
    def highest(self):
        """An ellipsoid."""
        return (1.0,)

    def radius(self, parameters, directions):
        """On a face, an edge or a corner, wherever the ray leaves."""
        size = np.abs(directions)
        longest = size.max(axis=1)
        v = -np.sort(-size / longest[:, None], axis=1)
        rho, core = parameters[0], 1.0 - parameters[0]
        # Outside their own cases the roots are not real: they are taken at the cases' borders.
        near, nearest = jnp.maximum(v[:, 1], core), jnp.maximum(v[:, 2], core)
        edge = _leaves(jnp.stack([v[:, 0], near], axis=1), core, rho)
        corner = _leaves(jnp.stack([v[:, 0], near, nearest], axis=1), core, rho)
        rounded = jnp.where(edge * v[:, 2] <= core, edge, corner)
        return jnp.where(v[:, 1] <= core, 1.0, rounded) / longest

    def support(self, parameters, normals):
        """That of the core plus that of the ball."""
        rho = parameters[0]
        return (1.0 - rho) * jnp.sum(jnp.abs(normals), axis=1) + rho * jnp.linalg.norm(normals, axis=1)


def _leaves(v: Float[Array, "m c"], core: Float[Array, ""], rho: Float[Array, ""]) -> Float[Array, " m"]:
    """The larger root t (m,) of Σ (t v − core)² = ρ² over components (m, c)."""
    square, along = jnp.sum(v**2, axis=1), core * jnp.sum(v, axis=1)
    return (along + jnp.sqrt(along**2 - square * (v.shape[1] * core**2 - rho**2))) / square


class Superellipsoid(AbstractProfile):
    """A superellipsoid with the same exponent 2/ρ along all axes: one parameter ρ, 0 to 1."""

    @property
    def names(self):
        """The roundness alone."""
        return ("roundness",)

    @property
    def lowest(self):
        """A box."""
        return (0.0,)

    @property
    def highest(self):
        """An ellipsoid."""
        return (1.0,)

    def radius(self, parameters, directions):
        """One over the norm of the directions."""
        return 1.0 / _norm(jnp.asarray(directions), 2.0 / parameters[0])

    def support(self, parameters, normals):
        """The dual norm, 1/N + 1/N' = 1."""
        return _norm(normals, 2.0 / (2.0 - parameters[0]))


def _norm(vectors: Float[Array, "m 3"], exponent: Float[Array, ""]) -> Float[Array, " m"]:
    """(Σ |v_i|^N)^(1/N) (m,) of vectors (m, 3); a component that is 0 has no part in derivatives."""
    size = jnp.abs(vectors)
    longest = jnp.max(size, axis=1, keepdims=True)
    logarithm = jnp.log(jnp.maximum(size / longest, _NOTHING))
    return longest[:, 0] * jnp.exp(jnp.log(jnp.sum(jnp.exp(exponent * logarithm), axis=1)) / exponent)


class FreeForm(AbstractProfile):
    """Another profile, its radius times exp Σ c_k Y_k(u) with harmonics up to a `degree` of 2 or more: the
    other's parameters, then the coefficients c.
    """

    base: AbstractProfile
    degree: int = eqx.field(static=True)

    @property
    def names(self):
        """The base's, then "harmonic l m"."""
        return (*self.base.names, *(f"harmonic {degree} {order}" for degree, order in self._harmonics()))

    @property
    def lowest(self):
        """The base's, then −1: a harmonic changes the radius by a factor of up to exp 1."""
        return (*self.base.lowest, *(-1.0 for _ in self._harmonics()))

    @property
    def highest(self):
        """The base's, then 1."""
        return (*self.base.highest, *(1.0 for _ in self._harmonics()))

    def _harmonics(self) -> list[tuple[int, int]]:
        return [(n, m) for n in range(2, self.degree + 1) for m in range(-n, n + 1)]

    def radius(self, parameters, directions):
        """The base's, swollen or shrunk."""
        split = len(self.base.names)
        basis = np.stack([_harmonic(n, m, directions) for n, m in self._harmonics()], axis=1)
        return self.base.radius(parameters[:split], directions) * jnp.exp(basis @ parameters[split:])

    def support(self, parameters, normals):
        """The farthest of some thousand points of the surface."""
        directions, _ = cube_sphere(_CELLS)
        points = self.radius(parameters, directions)[:, None] * directions
        return jnp.max(normals @ points.T, axis=1)


def _harmonic(degree: int, order: int, directions: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, " m"]:
    """Real spherical harmonic (m,) along unit directions (m, 3), of root mean square 1; order < 0: the sines."""
    from scipy.special import sph_harm_y

    polar = np.arccos(np.clip(directions[:, 2], -1.0, 1.0))
    azimuth = np.arctan2(directions[:, 1], directions[:, 0])
    value = np.sqrt(4.0 * np.pi) * sph_harm_y(degree, abs(order), polar, azimuth)
    if order == 0:
        return value.real
    return np.sqrt(2.0) * (value.real if order > 0 else value.imag)
