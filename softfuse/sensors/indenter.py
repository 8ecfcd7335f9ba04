"""A known indenter: a stage or a robot that says where it presses, and a force sensor that says whether.

It is a sensor that sees a contact: the place is as sure as the stage, the touch as the force sensor or the
height says.
"""

from typing import ClassVar, Literal, Self

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from pydantic import model_validator

from softfuse.functional.chart import AbstractChart
from softfuse.io.quantity import FORCE, LengthUnit, PositiveForce, PositiveLength, wrong_value
from softfuse.sensors.base import AbstractContactSensor, ContactSettings, Evidence, Touch
from softfuse.sensors.contact_places import chart_place
from softfuse.sensors.electronics import equal_channels
from softfuse.sensors.parameters import parameters


class Indenter(AbstractContactSensor):
    """x, y in `unit_m`, and the force, in the chart of a contact; `on_N`, `off_N`: forces that begin and end
    a touch; `sigma_m`: of a place; `low_m`, `high_m` (2,) where middles may be [m].
    """

    misses = False  # nothing else presses there
    chart: AbstractChart
    unit_m: Float[Array, ""]
    on_N: Float[Array, ""]
    off_N: Float[Array, ""]
    sigma_m: Float[Array, ""]
    low_m: Float[Array, "2"]
    high_m: Float[Array, "2"]

    def init(self):
        """Nothing touches: touching, and the last reading (3,)."""
        return jnp.asarray(False), jnp.full(3, jnp.nan, float)

    def touch(self, state, frame, raw, hint):
        """By the force; what is not read stays as it was."""
        del frame, hint
        touching, _ = state
        read: Bool[Array, ""] = jnp.isfinite(raw[2])
        now = jnp.where(touching, raw[2] > self.off_N, raw[2] > self.on_N)
        touching = jnp.where(read, now, touching)
        return (touching, raw), Touch(touching, touching[None], ~touching, jnp.asarray(False))

    def locate(self, state, frame, context, squeezed_m3):
        """Where the stage is."""
        del frame, context, squeezed_m3
        touching, raw = state
        at = raw[:2] * self.unit_m
        known = jnp.all(jnp.isfinite(at))
        at = jnp.where(known, at, 0.5 * (self.low_m + self.high_m))
        place, covariance = chart_place(self.chart, at, self.sigma_m**2 * jnp.eye(2))
        inside = jnp.all((at >= self.low_m) & (at <= self.high_m))
        located = touching & known
        flags = {f"{self.name} missing": ~jnp.all(jnp.isfinite(raw))}
        return state, Evidence(
            touching[None], located[None], (located & inside)[None], place[None], covariance[None], flags
        )


class IndenterSettings(ContactSettings):
    """A stage at x, y of a [[contact]]'s chart, in `unit`, and its force in N: three channels.

    on, off: forces at which a touch begins and ends; sigma in m: of a place; noise in N: of the force.
    """

    channels_for: ClassVar = (3, "x, y and force")

    type: Literal["indenter"] = "indenter"
    unit: LengthUnit = 1e-3
    on: PositiveForce = 0.1
    off: PositiveForce = 0.05
    sigma: PositiveLength = 0.05e-3
    noise: PositiveForce = 0.01

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.off > self.on:
            raise wrong_value(f"must not exceed on = {self.on:g} {FORCE.unit}", key="off")
        return self

    def sensor(self, parts):
        """Raises ConfigError for a contact that there is not, or that presses on no flat face."""
        part = parts.contact_of(self.name, self.contact)
        chart = self._chart(parts)
        return parameters(Indenter, self, slots=1, chart=chart, low_m=part.low, high_m=part.high)

    def signal(self, parts, contacts, moved):
        """x, y [m] and force [N] of the contact, (3,)."""
        del moved
        chart = self._chart(parts)
        if len(contacts) != 1:
            raise self._wrong(f"a stage has one indenter, not {len(contacts)}")
        (contact,) = contacts
        at = chart.coordinates(contact.place)
        return np.array([*at, contact.force])

    def ideal(self, parts, time_s, values):
        """Of places and forces (m, 3) m, m, N."""
        del parts, time_s
        return np.asarray(values) / np.array([self.unit, self.unit, 1.0])

    def electronics(self, parts, rng):
        """Noise of place and force."""
        del parts, rng
        noise = np.array([self.sigma / self.unit, self.sigma / self.unit, self.noise])
        return equal_channels(3, noise=noise)
