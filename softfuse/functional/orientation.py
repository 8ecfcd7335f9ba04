"""How a small patch of the material is turned: R, the polar factor of its mean deformation gradient.

An accelerometer at rest reads gravity in the patch's frame, Rᵀ g; an inertial unit reads R itself. Means are
over a ball around the sensor, exact for deformation gradients that are cubic there. A sensor mounted at an
angle has its own axes M in the patch at rest, and reads (R M)ᵀ g.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.body.base import AbstractBody
from softfuse.functional.base import MaterialFunctional
from softfuse.functional.material_points import MaterialPoints, ball
from softfuse.functional.rotation import polar_rotation, rotation_vector


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
