"""How a small patch of the material is turned: R, the polar factor of its mean deformation gradient.

An accelerometer at rest reads gravity in the patch's frame, Rᵀ g; an inertial unit reads R itself. Means are
over a ball around the sensor, exact for deformation gradients that are cubic there. A sensor mounted at an
angle has its own axes M in the patch at rest, and reads (R M)ᵀ g.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.body.base import AbstractBody
from softfuse.functional.base import MaterialFunctional
from softfuse.functional.material_points import MaterialPoints, ball

_STEPS = 8
"""Of Newton's iteration; for principal stretches from 0.1 to 10, six reach rounding."""


@jax.custom_jvp
def polar_rotation(f: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    """R (3, 3) of a deformation gradient F = R U (3, 3) with U = Uᵀ > 0 and det F > 0.

    Newton's iteration R ← (γ R + (γ R)⁻ᵀ)/2 finds R from F without singular values, whose derivatives would
    not exist where two of them are equal, as they are at rest. From F = R U follows dR = R [w]× with (tr U ·
    I − U) w = axial(Rᵀ dF − dFᵀ R), which is regular. Source: Higham, SIAM J. Sci. Stat. Comput. 7(4), 1986,
    for the iteration with its factors γ.
    """

    def improved(_, r: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
        turned = jnp.stack([jnp.cross(r[1], r[2]), jnp.cross(r[2], r[0]), jnp.cross(r[0], r[1])])
        inverse = turned / jnp.dot(r[0], turned[0])  # R⁻ᵀ
        factor = jnp.sqrt(jnp.linalg.norm(inverse) / jnp.linalg.norm(r))
        return 0.5 * (factor * r + inverse / factor)

    return jax.lax.fori_loop(0, _STEPS, improved, f)


@polar_rotation.defjvp
def _polar_rotation_jvp(primals, tangents):
    (f,), (df,) = primals, tangents
    r = polar_rotation(f)
    stretch = 0.5 * (r.T @ f + f.T @ r)
    half = r.T @ df
    w = jnp.linalg.solve(jnp.trace(stretch) * jnp.eye(3) - stretch, _axial(half - half.T))
    return r, r @ cross_matrix(w)


def cross_matrix(w: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """[w]×, whose product with a vector v is w × v."""
    return jnp.cross(w, jnp.eye(3)).T


def _axial(a: Float[Array, "3 3"]) -> Float[Array, "3"]:
    """w (3,) of an antisymmetric [w]×."""
    return jnp.stack([a[2, 1], a[0, 2], a[1, 0]])


def quaternion(r: Float[Array, "3 3"]) -> Float[Array, "4"]:
    """(w, x, y, z) with w ≥ 0 of a rotation (3, 3); differentiable up to half a turn.

    The largest of the four is found from the diagonal, so that none is divided by little. Source:
    Shepperd, J. Guidance and Control 1(3), 1978.
    """
    # q qᵀ times four.
    trace = jnp.trace(r)
    across = _axial(r - r.T)
    lower = r + r.T + (1 - trace) * jnp.eye(3)
    square = jnp.block([[(1 + trace)[None, None], across[None]], [across[:, None], lower]])
    row = square[jnp.argmax(jnp.diagonal(square))]
    q = row / jnp.linalg.norm(row)
    return jnp.where(q[0] < 0, -q, q)


def rotation_vector(r: Float[Array, "3 3"]) -> Float[Array, "3"]:
    """Axis times angle [rad], below π, of a rotation (3, 3)."""
    q = quaternion(r)
    squared = jnp.sum(q[1:] ** 2)
    small = squared < 1e-16
    sine = jnp.sqrt(jnp.where(small, 1.0, squared))
    return q[1:] * jnp.where(small, 2.0, 2 * jnp.arctan2(sine, q[0]) / sine)


def patch(body: AbstractBody, centre: Float[np.ndarray, "3"], radius: float) -> MaterialPoints:
    """The points that stand for a ball of `radius` [m] around `centre` (3,) m in a body at rest.

    Raises MeshError where one of them lies outside it.
    """
    return MaterialPoints.embedded(body, ball(np.asarray(centre, float), radius), named="point of the patch")


def patch_rotation(
    points: MaterialPoints, rest: Float[Array, "k 3"], displacement: Float[Array, "k 3"]
) -> Float[Array, "3 3"]:
    """R (3, 3) of a patch's points when nodes at `rest` (k, 3) m have moved by (k, 3) m."""
    return polar_rotation(jnp.mean(points.deformation(rest, displacement), axis=0))


class DirectionInPatch(MaterialFunctional):
    """A vector fixed in the world, `direction` (3,) in its own unit, in the frame of a sensor whose axes at
    rest are the columns of `mounting` M (3, 3): gravity as an accelerometer reads it.
    """

    points: MaterialPoints
    direction: Float[Array, "3"]
    mounting: Float[Array, "3 3"]

    @classmethod
    def of(
        cls,
        body: AbstractBody,
        centre: Float[np.ndarray, "3"],
        radius: float,
        direction: Float[np.ndarray, "3"],
        *,
        mounting: Float[np.ndarray, "3 3"] | None = None,
    ) -> "DirectionInPatch":
        """Of a ball of `radius` [m] around `centre` (3,) m; raises MeshError as `patch` does."""
        axes = np.eye(3) if mounting is None else mounting
        return cls(patch(body, centre, radius), *(jnp.asarray(each, float) for each in (direction, axes)))

    @property
    def count(self):
        """Three components."""
        return 3

    def __call__(self, rest, displacement):
        """(R M)ᵀ g (3,)."""
        return self.mounting.T @ (patch_rotation(self.points, rest, displacement).T @ self.direction)


class PatchRotation(MaterialFunctional):
    """The rotation vector (3,) [rad] from a `reference` attitude (3, 3) to a patch's, log(R_refᵀ R M), in the
    axes of the reference.

    With the attitude that a sensor reads as reference it is how far the model is off, without wrapping.
    """

    points: MaterialPoints
    reference: Float[Array, "3 3"]
    mounting: Float[Array, "3 3"]

    @classmethod
    def of(
        cls,
        body: AbstractBody,
        centre: Float[np.ndarray, "3"],
        radius: float,
        *,
        mounting: Float[np.ndarray, "3 3"] | None = None,
    ) -> "PatchRotation":
        """Of a ball of `radius` [m] around `centre` (3,) m, relative to rest; MeshError as of `patch`."""
        axes = jnp.eye(3) if mounting is None else jnp.asarray(mounting, float)
        return cls(patch(body, centre, radius), axes, axes)

    @property
    def count(self):
        """Three components."""
        return 3

    def attitude(self, rest: Float[Array, "k 3"], displacement: Float[Array, "k 3"]) -> Float[Array, "3 3"]:
        """R M (3, 3): the sensor's axes in the world."""
        return patch_rotation(self.points, rest, displacement) @ self.mounting

    def __call__(self, rest, displacement):
        """log(R_refᵀ R M) (3,) [rad]."""
        return rotation_vector(self.reference.T @ self.attitude(rest, displacement))
