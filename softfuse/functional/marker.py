"""Position of a material point in a camera's frame: g = components of Rᵀ (x(X) − o), for tags, motion capture
and stages; its conjugates are point forces [N].
"""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.body.base import AbstractBody
from softfuse.errors import MeshError
from softfuse.functional.base import MaterialFunctional
from softfuse.functional.material_points import MaterialPoints

_ORTHONORMAL = 1e-6


class Marker(MaterialFunctional):
    """One point, seen from a frame whose axes are the columns of `rotation` R (3, 3) around the `origin` o
    (3,) m; `components`: which of its three coordinates are read.
    """

    point: MaterialPoints
    rotation: Float[Array, "3 3"]
    origin: Float[Array, "3"]
    components: tuple[int, ...] = eqx.field(static=True)

    @classmethod
    def of(
        cls,
        body: AbstractBody,
        point: Float[np.ndarray, "3"],
        *,
        rotation: Float[np.ndarray, "3 3"] | None = None,
        origin: Sequence[float] = (0.0, 0.0, 0.0),
        components: Sequence[int] = (0, 1, 2),
    ) -> "Marker":
        """A marker at a point (3,) m of a body at rest; without a camera's pose, in the body's frame.

        Raises MeshError for a point outside the body, and for a `rotation` that is none.
        """
        axes = np.eye(3) if rotation is None else np.asarray(rotation, float)
        if np.abs(axes.T @ axes - np.eye(3)).max() > _ORTHONORMAL or np.linalg.det(axes) < 0:
            raise MeshError(
                f"the camera's axes {axes.T.round(4).tolist()} are no right-handed frame of unit vectors: "
                "give a rotation matrix, its columns the camera's axes"
            )
        points = MaterialPoints.embedded(body, point[None], named="marker")
        return cls(points, jnp.asarray(axes), jnp.asarray(origin, float), tuple(components))

    @property
    def count(self):
        """One to three."""
        return len(self.components)

    def __call__(self, rest, displacement):
        """Coordinates (count,) [m] in the camera's frame."""
        at = self.point.positions(rest, displacement)[0]
        return (self.rotation.T @ (at - self.origin))[jnp.array(self.components)]
