"""Force and moment with which the robot is held, by a six-axis sensor under its base.

What it reads of the body's own weight is in the zero; what moves the weight changes the moment.
"""

from typing import Annotated, ClassVar, Literal

import jax.numpy as jnp
import numpy as np
from pydantic import BeforeValidator

from softfuse.io.quantity import FORCE, MOMENT, PositiveForce, PositiveMoment
from softfuse.io.settings import Vector
from softfuse.mechanics.reaction import Reaction
from softfuse.mechanics.reading import ReactionReading
from softfuse.sensors.axes import WORLD, Axes
from softfuse.sensors.direct import Scaled, ScaledSettings

_NAMES = ("fx", "fy", "fz", "mx", "my", "mz")


class BaseWrenchSettings(ScaledSettings):
    """Six axes at `origin` (3,) m: channels of the forces from the support on the robot, in force_unit, then
    of the moments, in moment_unit.

    axes: of the sensor, unit vectors; carried: cables whose other end is on the robot's side of the sensor.
    noise, offset_sigma, drift: of forces and of their zeros in N, and of these per second; moment_noise ...:
    of moments in N m.
    """

    channels_for: ClassVar = (len(_NAMES), "three forces and three moments")

    type: Literal["base-wrench"] = "base-wrench"
    origin: Vector = (0.0, 0.0, 0.0)
    axes: Axes = WORLD
    carried: tuple[str, ...] = ()
    force_unit: Annotated[float, BeforeValidator(FORCE.parse)] = 1.0
    moment_unit: Annotated[float, BeforeValidator(MOMENT.parse)] = 1.0
    noise: PositiveForce = 5e-3
    offset_sigma: PositiveForce = 0.05
    drift: PositiveForce = 1e-4
    moment_noise: PositiveMoment = 1e-4
    moment_offset_sigma: PositiveMoment = 1e-3
    moment_drift: PositiveMoment = 2e-6

    @property
    def _errors(self):
        forces = self.noise, self.offset_sigma, self.drift
        moments = self.moment_noise, self.moment_offset_sigma, self.moment_drift
        noise, offset, drift = np.repeat([forces, moments], 3, axis=0).T
        return noise, offset, drift

    def _scaled(self, parts):
        """Raises ConfigError for a cable that there is not."""
        parts.cables_of(self.name, self.carried)
        units = np.repeat([self.force_unit, self.moment_unit], 3)
        return Scaled(_NAMES, ("N",) * 3 + ("N m",) * 3, units)

    def functional(self, parts):
        """The reaction, minus that to the weight at rest."""
        carried = tuple(cable.load for cable in parts.cables_of(self.name, self.carried))
        reaction = Reaction(jnp.array(self.origin), jnp.asarray(np.array(self.axes).T))
        return ReactionReading(reaction, carried)
