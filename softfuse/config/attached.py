"""What is attached to the body: cables, gas sealed in its cavities, electrodes; and points to be watched."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Self

import jax.numpy as jnp
import numpy as np
from annotated_types import Ge, Le
from jaxtyping import Float
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from softfuse.body.base import AbstractBody
from softfuse.functional.cavity import Cavity
from softfuse.functional.chart import facing
from softfuse.io.quantity import (
    Compliance,
    Length,
    Number,
    PositiveForce,
    PositiveForceRate,
    PositivePressure,
    PositiveVelocity,
    Volume,
    wrong_value,
)
from softfuse.io.settings import Direction, NotEmpty, Settings, Vector, listed
from softfuse.mechanics.cable import PulledCable
from softfuse.mechanics.gas import SealedGas


def _apart(points: tuple[Vector, ...]) -> tuple[Vector, ...]:
    for k, (before, here) in enumerate(pairwise(points), start=1):
        if here == before:
            raise wrong_value("is the same point as the one before it: move or remove it", key=f"[{k}]")
    return points


Path3 = Annotated[tuple[Vector, ...], NotEmpty, AfterValidator(_apart)]
"""Points (g, 3) m along a line, each apart from the one before."""


class CableSettings(Settings):
    """A cable from pulled_at (3,) m through guides (g, 3) m in the body; its end holds a ball of
    anchor_radius in m around the last one: a point would sink in without limit as the mesh gets finer.

    friction [-]: μ at the guides; compliance in m/N: by how much the cable itself gets longer; max_tension in
    N; tension_rate in N/s and length_rate in m/s: how fast its tension and its length may change, None for
    any.
    """

    name: str
    guides: Path3
    pulled_at: Vector
    anchor_radius: Annotated[Length, Ge(0)] = 0.0
    friction: Annotated[Number, Ge(0)] = 0.0
    # Left out of digests where it is 0: charts made before there were such cables are still good.
    compliance: Annotated[Compliance, Ge(0)] = Field(default=0.0, exclude_if=lambda given: given == 0)
    max_tension: PositiveForce
    tension_rate: PositiveForceRate | None = None
    length_rate: PositiveVelocity | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.pulled_at == self.guides[0]:
            raise wrong_value("is the first guide: pull from a point outside the body", key="pulled_at")
        return self

    def load(self, body: AbstractBody) -> PulledCable:
        """The cable in a body at rest; raises MeshError for a guide outside it."""
        return PulledCable.through(
            body,
            np.array(self.guides),
            np.array(self.pulled_at),
            friction=self.friction,
            compliance=self.compliance,
            anchor_radius=self.anchor_radius,
        )


class GasSettings(Settings):
    """Gas sealed in all cavities: one dead volume in m³, or one for each cavity; atmosphere in Pa, absolute.

    exponent κ [-] of p V^κ: 1 isothermal, 1.4 adiabatic air.
    """

    dead_volume: Annotated[tuple[Annotated[Volume, Ge(0)], ...], NotEmpty, BeforeValidator(listed)]
    atmosphere: PositivePressure = 101325.0
    exponent: Annotated[Number, Ge(1), Le(5 / 3)] = 1.0

    def check_cavities(self, count: int) -> None:
        """Raise the error of a validator unless the gas suits so many cavities."""
        if not count:
            raise wrong_value("there is no cavity to seal: add [[cavity]], or remove [gas]", key="gas")
        if len(self.dead_volume) not in (1, count):
            raise wrong_value(
                f"{len(self.dead_volume)} values for {count} cavities: give one, or one for each",
                key="gas.dead_volume",
            )

    def load(self, body: AbstractBody, cavities: Sequence[Cavity]) -> SealedGas:
        """The gas in the cavities of a body at rest; raises MeshError as `SealedGas.of` does."""
        dead = jnp.broadcast_to(jnp.array(self.dead_volume), (len(cavities),))
        return SealedGas.of(tuple(cavities), body, dead, atmosphere=self.atmosphere, exponent=self.exponent)


class ElectrodePlace(Settings):
    """An electrode on the surface: its middle (3,) m and the direction (3,) from there into the body.

    span (3,) m: between the outermost places where a contact on it may press; 0 for its middle only.
    """

    name: str
    centre: Vector
    direction: Direction
    span: Vector = (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if any(self.span) and np.linalg.norm(self._along) < 1e-6 * np.linalg.norm(self.span):
            raise wrong_value("runs along the direction: give it along the surface", key="span")
        return self

    @property
    def arms(self) -> tuple[float, ...]:
        """How far from its middle along the span the patches are (c,) [m] whose forces stand for one anywhere
        between them.
        """
        half = 0.5 * float(np.linalg.norm(self._along))
        return (-half, half) if half else (0.0,)

    @property
    def place(self) -> Float[np.ndarray, "3 3"]:
        """The place (3, 3), its first tangent along the span."""
        place = facing(np.array(self.centre), self.direction)
        if any(self.span):
            place[1] = self._along / np.linalg.norm(self._along)
            place[2] = np.cross(place[1], self._into)
        return place

    @property
    def _into(self) -> Float[np.ndarray, "3"]:
        return np.array(self.direction) / np.linalg.norm(self.direction)

    @property
    def _along(self) -> Float[np.ndarray, "3"]:
        """The span without what is along the direction, in which patches are carried onto the surface."""
        span = np.array(self.span)
        return span - (span @ self._into) * self._into


class PointSettings(Settings):
    """A point (3,) m of the material whose position is reported."""

    name: str
    at: Vector


class CentrelineSettings(Settings):
    """Points (g, 3) m of the material from the base to the tip: the ends of the segments between them."""

    points: Path3

    @model_validator(mode="after")
    def _check(self) -> Self:
        if len(self.points) < 2:
            raise wrong_value("a line has at least two points", key="points")
        return self
