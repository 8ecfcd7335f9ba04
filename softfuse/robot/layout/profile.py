"""What the surface of a cavity looks like before it is turned and put in its place: box, ellipsoid, between.

A profile is the star-shaped surface {h ∘ r(u) u} around the origin: radius r [-] along directions u,
stretched by the half-sizes h [m]. A convex one touches the faces of the box |x_i| ≤ h_i, so that these are
the half-sizes of its bounding box:

    rounded box        Σ max(r h_i |u_i| − h_i + f, 0)² = f²: all that balls of radius f inside it cover
    superellipsoid     Σ |r u_i|^N = 1 with N = 2/ρ; the roundness ρ is near 0 for a box, 1 for an ellipsoid
    free form          r of another profile times exp Σ c_k Y_k(u)

with real spherical harmonics Y_k of degrees 2, 3, ...; those of degree 0 and 1 are size and place. The
support function max {n · x} of a profile tells how far it reaches along n; that of a superellipsoid is the
dual norm of h ∘ n. Sources: A. H. Barr, IEEE Comput. Graph. Appl. 1(1), 1981, DOI 10.1109/MCG.1981.1673799
(superquadrics); R. Schneider, Convex Bodies, 2nd ed., 2014, sec. 1.7 (support functions).
"""

from abc import abstractmethod
from math import factorial, sqrt

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.robot.layout.cube_sphere import cube_sphere

_NOTHING = 1e-150
"""Component of a direction below which its powers are 0, so that they have derivatives."""

_EDGE = 1e-5
"""ε: sine of the angle over which an edge's normals go over into a face's."""

_STEPS = 30
"""Of Newton's method for the radius: more than it takes."""

_CELLS = 40
"""Along an edge of the cube through whose grid a profile that may not be convex is looked at."""


class AbstractProfile(eqx.Module):
    """A star-shaped surface with parameters (k,) of given `names`, and half-sizes h (3,) m of its box."""

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Of the parameters (k,)."""

    @abstractmethod
    def radius(
        self,
        parameters: Float[Array, " k"],
        half: Float[Array, "3"],
        directions: Float[Array | np.ndarray, "m 3"],
    ) -> Float[Array, " m"]:
        """r (m,) [-] along unit directions (m, 3) with parameters (k,) and half-sizes (3,) m.

        Differentiable in all of them, once.
        """

    @abstractmethod
    def support(
        self, parameters: Float[Array, " k"], half: Float[Array, "3"], normals: Float[Array, "m 3"]
    ) -> Float[Array, " m"]:
        """How far (m,) [m] the surface, or its convex hull, reaches along unit vectors (m, 3): max n · x.

        Differentiable in all of them, once.
        """

    @abstractmethod
    def slack(self, parameters: Float[Array, " k"], half: Float[Array, "3"]) -> Float[Array, " s"]:
        """What must not be negative (s,) [m] for such a surface to exist."""


class RoundedBox(AbstractProfile):
    """A box whose edges and corners have a fillet: one parameter, its radius [m], more than 0."""

    @property
    def names(self):
        """The fillet's radius."""
        return ("fillet",)

    def radius(self, parameters, half, directions):
        """On a face, an edge or a corner, wherever the ray leaves."""
        fillet, along = parameters[0], half * jnp.abs(jnp.asarray(directions))
        core = half - fillet

        def beyond(r):
            """How far (m, 3) [m] a point of the ray lies outside the box between the fillets' axes."""
            return jnp.maximum(r[:, None] * along - core, 0.0)

        def newton(r):
            out = beyond(r)
            return r - (jnp.sum(out**2, axis=1) - fillet**2) / (2.0 * jnp.sum(out * along, axis=1))

        # The sum is convex in r: from the box's face, Newton's method comes down to the root from one side.
        box = jnp.min(half / jnp.maximum(along, _NOTHING), axis=1)
        root = jax.lax.fori_loop(0, _STEPS, lambda _, r: newton(r), jax.lax.stop_gradient(box))
        # At the root one more step changes nothing but has its derivatives.
        return newton(jax.lax.stop_gradient(root))

    def support(self, parameters, half, normals):
        """That of the box inside the fillets plus that of a ball.

        (√(n² + ε²) − ε) / (√(1 + ε²) − ε) stands for |n|: with a kink there, a maximum over n would not tell
        where along an edge or on a face another body is nearest. Corners reach less far by ε of the box.
        """
        fillet = parameters[0]
        soft = (jnp.sqrt(normals**2 + _EDGE**2) - _EDGE) / (np.sqrt(1.0 + _EDGE**2) - _EDGE)
        return soft @ (half - fillet) + fillet * jnp.linalg.norm(normals, axis=1)

    def slack(self, parameters, half):
        """A fillet is not larger than any half-size."""
        return half - parameters[0]


class Superellipsoid(AbstractProfile):
    """A superellipsoid with the same exponent 2/ρ along all axes: one parameter ρ [-], 0 to 1."""

    @property
    def names(self):
        """The roundness."""
        return ("roundness",)

    def radius(self, parameters, half, directions):
        """One over the norm of the directions."""
        del half
        return 1.0 / _norm(jnp.asarray(directions), 2.0 / parameters[0])

    def support(self, parameters, half, normals):
        """The dual norm, 1/N + 1/N' = 1, of components √(v² + ε²) in the place of |v|, as for a box; faces
        reach farther by up to 2 ε of the half-sizes.
        """
        local = half * normals
        edge = _EDGE * jnp.linalg.norm(local, axis=1, keepdims=True)
        return _norm(jnp.sqrt(local**2 + edge**2), 2.0 / (2.0 - parameters[0]))

    def slack(self, parameters, half):
        """Nothing: the bounds of ρ say it."""
        del parameters, half
        return jnp.zeros(0)


def _norm(vectors: Float[Array, "m 3"], exponent: Float[Array, ""]) -> Float[Array, " m"]:
    """(Σ |v_i|^N)^(1/N) (m,) of vectors (m, 3); a component that is 0 has no part in derivatives."""
    size = jnp.abs(vectors)
    longest = jnp.max(size, axis=1, keepdims=True)
    logarithm = jnp.log(jnp.maximum(size / longest, _NOTHING))
    return longest[:, 0] * jnp.exp(jnp.log(jnp.sum(jnp.exp(exponent * logarithm), axis=1)) / exponent)


class FreeForm(AbstractProfile):
    """Another profile, its radius times exp Σ c_k Y_k(u) with harmonics up to a `degree` of 2 or more: the
    other's parameters, then the coefficients c [-], 0 for the other itself.
    """

    base: AbstractProfile
    degree: int = eqx.field(static=True)

    @property
    def names(self):
        """The base's, then "harmonic l m"."""
        orders = [(n, m) for n in range(2, self.degree + 1) for m in range(-n, n + 1)]
        return (*self.base.names, *(f"harmonic {n} {m}" for n, m in orders))

    def radius(self, parameters, half, directions):
        """The base's, swollen or shrunk."""
        split = len(self.base.names)
        swollen = jnp.exp(harmonics(self.degree, directions) @ parameters[split:])
        return self.base.radius(parameters[:split], half, directions) * swollen

    def support(self, parameters, half, normals):
        """The farthest of some thousand points of the surface."""
        directions, _ = cube_sphere(_CELLS)
        points = half * (self.radius(parameters, half, directions)[:, None] * directions)
        farthest = jnp.argmax(jax.lax.stop_gradient(normals @ points.T), axis=1)
        return jnp.sum(normals * points[farthest], axis=1)

    def slack(self, parameters, half):
        """The base's."""
        return self.base.slack(parameters[: len(self.base.names)], half)


def harmonics(degree: int, directions: Float[Array | np.ndarray, "m 3"]) -> Float[Array, "m c"]:
    """Real spherical harmonics (m, c) of degrees 2 to `degree` along unit directions (m, 3), by degree, then
    by order from −degree; orders below 0 are the sines; of root mean square 1 over the sphere.

    Y = a Q(z) Re or Im (x + i y)^|m|, Q the |m|-th derivative of a Legendre polynomial by its recurrence in
    the degree (DLMF 14.10.3), which has no poles.
    """
    x, y, z = jnp.moveaxis(jnp.asarray(directions), -1, 0)
    columns = {}
    cosine, sine, first = jnp.ones_like(z), jnp.zeros_like(z), 1.0
    for order in range(degree + 1):
        before, here = jnp.zeros_like(z), first * jnp.ones_like(z)
        for n in range(order, degree + 1):
            size = sqrt((1 if order == 0 else 2) * (2 * n + 1) * factorial(n - order) / factorial(n + order))
            columns[n, order] = size * here * cosine
            if order > 0:
                columns[n, -order] = size * here * sine
            following = ((2 * n + 1) * z * here - (n + order) * before) / (n + 1 - order)
            before, here = here, following
        cosine, sine = x * cosine - y * sine, x * sine + y * cosine
        first *= 2 * order + 1
    chosen = [columns[n, m] for n in range(2, degree + 1) for m in range(-n, n + 1)]
    return jnp.stack(chosen, axis=1)
