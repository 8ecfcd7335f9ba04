"""A marker on a point of the material, seen by a camera or told by a stage: one to three of its coordinates.

Where the camera stands is known, so that no zero is taken unless asked for. A marker that is lost is not
valid.
"""

from typing import Annotated, Literal

import jax.numpy as jnp
import numpy as np
from pydantic import Field, model_validator

from softfuse.functional.marker import Marker
from softfuse.io.quantity import LengthUnit, PositiveLength, wrong_value
from softfuse.io.settings import Settings, Vector
from softfuse.mechanics.reading import ShapeReading
from softfuse.sensors.axes import WORLD, Rows
from softfuse.sensors.direct import Scaled, ScaledSettings
from softfuse.sensors.electronics import equal_channels
from softfuse.sensors.parts import Parts

_AXES = ("x", "y", "z")
_STEP = 1e-6
"""Of virtual coordinates [m]."""


class CameraSettings(Settings):
    """A frame: where its origin is (3,) m, and its axes x, y and z, unit vectors at right angles."""

    origin: Vector = (0.0, 0.0, 0.0)
    axes: Rows = WORLD


class MarkerSettings(ScaledSettings):
    """Coordinates of a [[point]] in a camera's frame, one channel for each of `components`, in `unit`.

    noise: standard deviation of a coordinate in m; offset_sigma: by how much the camera's place may be wrong,
    in m.
    """

    type: Literal["marker"] = "marker"
    point: str
    components: Annotated[tuple[Literal["x", "y", "z"], ...], Field(min_length=1)] = _AXES
    camera: CameraSettings = CameraSettings()
    unit: LengthUnit = 1e-3
    noise: PositiveLength = 0.1e-3
    offset_sigma: PositiveLength = 0.2e-3
    tared: bool = False

    @model_validator(mode="after")
    def _check(self):
        if len(set(self.components)) != len(self.components):
            raise wrong_value("a component is named twice", key="components")
        self._count(len(self.components), f"{len(self.components)} components")
        return self

    def _marker(self, parts: Parts) -> Marker:
        return Marker.of(
            parts.body,
            parts.point_of(self.name, self.point),
            rotation=np.array(self.camera.axes).T,
            origin=self.camera.origin,
            components=[_AXES.index(name) for name in self.components],
        )

    @property
    def _errors(self):
        return self.noise, self.offset_sigma, 0.0

    def _scaled(self, parts):
        """Raises ConfigError for a point that there is not, MeshError for one outside the body."""
        rest = parts.body.rest
        at = np.asarray(self._marker(parts)(rest, jnp.zeros_like(rest)))
        return Scaled(self.components, ("m",), self.unit, at)

    def functional(self, parts):
        """How far the point has moved."""
        return ShapeReading(self._marker(parts))

    def electronics(self, parts, rng):
        """A camera that is somewhat off its place."""
        del parts
        count = len(self.channels)
        return equal_channels(
            count,
            zero=rng.normal(0.0, self.offset_sigma, count) / self.unit,
            noise=self.noise / self.unit,
            step=_STEP / self.unit,
        )
