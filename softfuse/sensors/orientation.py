"""How a patch of the material is turned: an accelerometer that reads gravity in its frame, or an attitude.

An accelerometer at rest reads the specific force −(R M)ᵀ g, 9.81 m/s² upwards, M its axes in the patch at
rest: two angles, nothing about gravity. A unit that fuses its sensors tells R M as a quaternion (w, x, y, z);
what is read of it is log((M)ᵀ R M) (3,) [rad], without wrapping up to half a turn. A slow robot:
accelerations are small against gravity.
"""

from typing import ClassVar, Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.functional.orientation import DirectionInPatch, PatchRotation, rotation_vector
from softfuse.io.quantity import PositiveAcceleration, PositiveAngle, PositiveLength
from softfuse.mechanics.reading import ShapeReading
from softfuse.sensors.axes import WORLD, Axes
from softfuse.sensors.direct import AbstractConvert, DirectSettings, Scaled, ScaledSettings
from softfuse.sensors.electronics import equal_channels


class Attitude(AbstractConvert):
    """The rotation vector (3,) [rad] of a quaternion (w, x, y, z) from the attitude `reference` (3, 3)."""

    reference: Float[Array, "3 3"]

    def __call__(self, raw):
        """Of a quaternion of any length."""
        known = jnp.all(jnp.isfinite(raw)) & jnp.any(raw != 0)
        w, x, y, z = jnp.where(known, raw, jnp.array([1.0, 0.0, 0.0, 0.0]))
        s = 2.0 / (w**2 + x**2 + y**2 + z**2)
        turned = jnp.array(
            [
                [1 - s * (y**2 + z**2), s * (x * y - w * z), s * (x * z + w * y)],
                [s * (x * y + w * z), 1 - s * (x**2 + z**2), s * (y * z - w * x)],
                [s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x**2 + y**2)],
            ]
        )
        return jnp.where(known, rotation_vector(self.reference.T @ turned), jnp.nan)

    def beside_zero(self, change, offset_sigma):
        """Whether a zero turns before or after the body makes half of the product of both turns."""
        return 0.5 * offset_sigma * jnp.sqrt(jnp.sum(change**2) + jnp.finfo(float).tiny)


class _OrientationSettings(DirectSettings):
    """At a [[point]], over a ball of `radius` in m; axes: those of the sensor in the body at rest, unit
    vectors.
    """

    point: str
    radius: PositiveLength = 2e-3
    axes: Axes = WORLD

    @property
    def mounting(self) -> Float[np.ndarray, "3 3"]:
        """M, its columns the axes."""
        return np.array(self.axes).T


class AccelerometerSettings(_OrientationSettings, ScaledSettings):
    """An accelerometer: channels of its three axes, in `unit`.

    noise, offset_sigma: of a reading and its bias, drift of the bias per second, in m/s².
    """

    channels_for: ClassVar = (3, "three axes")

    type: Literal["accelerometer"] = "accelerometer"
    unit: PositiveAcceleration = 1.0
    noise: PositiveAcceleration = 0.03
    offset_sigma: PositiveAcceleration = 0.3
    drift: PositiveAcceleration = 1e-4

    def _scaled(self, parts):
        """Raises ConfigError for a point that there is not, or where nothing weighs."""
        if not np.any(parts.gravity):
            raise self._wrong("without gravity an accelerometer tells nothing")
        parts.point_of(self.name, self.point)
        # Gravity in the sensor's frame; all of it is off by the gain.
        rest = self.mounting.T @ np.array(parts.gravity)
        return Scaled(("x", "y", "z"), ("m/s^2",), -self.unit, rest, drift=self.drift)

    def functional(self, parts):
        """How gravity has turned in the patch."""
        at, gravity = parts.point_of(self.name, self.point), np.array(parts.gravity)
        return ShapeReading(DirectionInPatch.of(parts.body, at, self.radius, gravity, mounting=self.mounting))


class AttitudeSettings(_OrientationSettings):
    """An inertial unit that tells its attitude in the world: channels w, x, y, z of a quaternion.

    noise, offset_sigma: of the attitude and its zero, drift of the zero per second, in rad.
    """

    channels_for: ClassVar = (4, "the four numbers of a quaternion")

    type: Literal["attitude"] = "attitude"
    noise: PositiveAngle = 2e-3
    offset_sigma: PositiveAngle = 0.03
    drift: PositiveAngle = 1e-4

    def sensor(self, parts):
        """Raises ConfigError for a point that there is not."""
        parts.point_of(self.name, self.point)
        return self._direct(
            ("x", "y", "z"),
            Attitude(jnp.asarray(self.mounting)),
            0.0,
            units=("rad",),
        )

    def functional(self, parts):
        """The rotation vector from rest."""
        at = parts.point_of(self.name, self.point)
        return ShapeReading(PatchRotation.of(parts.body, at, self.radius, mounting=self.mounting))

    def ideal(self, parts, time_s, values):
        """Of rotation vectors (m, 3) rad."""
        from scipy.spatial.transform import Rotation

        del parts, time_s
        turned = Rotation.from_matrix(self.mounting) * Rotation.from_rotvec(np.asarray(values))
        return turned.as_quat(scalar_first=True)

    def electronics(self, parts, rng):
        """Half angles are off by half."""
        del parts
        return equal_channels(
            4,
            zero=rng.normal(0.0, 0.5 * self.offset_sigma, 4),
            drift=0.5 * self.drift,
            noise=0.5 * self.noise,
        )
