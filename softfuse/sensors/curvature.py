"""How a fibre with several cores is bent at stations, by the wavelengths of its Bragg gratings.

A grating's wavelength shifts by Δλ/λ = (1 − p_e) ε_i + α ΔT (Hill and Meltz, J. Lightwave Technol. 15 (1997)
1263; p_e = 0.22; α = 6.7e-6/K, that of the glass and of the index together, 5.2e-6 to 6.7e-6 by fibre); a
core at distance d and angle θ_i from the section's first axis is strained by
ε_i = ε − d (κ₁ cos θ_i + κ₂ sin θ_i), see `functional.curvature`. Three cores or more tell κ and what they
have in common, ε + α ΔT/(1 − p_e); least squares. Without a channel of the temperature, that common part
tells of neither and is left out; with one, ε is read as well.
"""

from typing import Annotated, Literal, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from annotated_types import Gt, Lt
from jaxtyping import Array, Float
from pydantic import BeforeValidator, Field, model_validator

from softfuse.functional.base import MaterialFunctional
from softfuse.functional.curvature import Curvature
from softfuse.io.quantity import (
    Angle,
    Length,
    LengthUnit,
    Number,
    PositiveLength,
    PositiveNumber,
    Temperature,
    wrong_value,
)
from softfuse.io.settings import Direction, NotEmpty, Vector, listed
from softfuse.mechanics.reading import ShapeReading
from softfuse.sensors.base import Names
from softfuse.sensors.direct import AbstractConvert, DirectSettings
from softfuse.sensors.electronics import equal_channels
from softfuse.sensors.parameters import parameters

_CELSIUS = 273.15


class StationBending(MaterialFunctional):
    """κ₁, κ₂ of stations, or ε, κ₁, κ₂ with `axial`."""

    curve: Curvature
    axial: bool = eqx.field(static=True)

    @property
    def count(self):
        """Two or three for each station."""
        return self.curve.count if self.axial else self.curve.count // 3 * 2

    def __call__(self, rest, displacement):
        """Station by station."""
        every = self.curve(rest, displacement).reshape(-1, 3)
        return (every if self.axial else every[:, 1:]).ravel()


class Bending(AbstractConvert):
    """κ₁, κ₂, or ε, κ₁, κ₂ where the last channel is the temperature [°C], of wavelengths (s c,) in any unit.

    `at_rest` (s, c): wavelengths of a straight fibre at `temperature` [K]; `solving` (3, c): from strains of
    the cores to ε, κ₁, κ₂; `strain_optic` 1 − p_e [-]; `thermal` α [1/K].
    """

    at_rest: Float[Array, "s c"]
    solving: Float[Array, "3 c"]
    strain_optic: Float[Array, ""]
    thermal: Float[Array, ""]
    temperature: Float[Array, ""]
    axial: bool = eqx.field(static=True)

    def __call__(self, raw):
        """Station by station; NaN where a grating of it is missing."""
        s, c = self.at_rest.shape
        shift = raw[: s * c].reshape(s, c) / self.at_rest - 1.0
        if self.axial:
            shift = shift - self.thermal * (raw[s * c] + _CELSIUS - self.temperature)
        told = (shift / self.strain_optic) @ self.solving.T
        return (told if self.axial else told[:, 1:]).ravel()


class BraggSettings(DirectSettings):
    """A fibre along `path` (p, 3) m with gratings at `stations` in m from its beginning, in cores at `angles`
    rad.

    channels: wavelengths of the first station's cores, then of the next, in nm. wavelengths: of each when the
    fibre is straight at `temperature`, one value, one for each core, or one for each. distance: of the cores
    from the middle in m; across (3,): from the middle towards angle 0; gauge: length of a grating in m.
    temperature_channel in °C. noise, offset_sigma: of a wavelength and of it at rest, drift of that per
    second, relative to it.
    """

    type: Literal["bragg-gratings"] = "bragg-gratings"
    path: Annotated[tuple[Vector, ...], NotEmpty]
    stations: Annotated[tuple[Length, ...], NotEmpty]
    angles: Annotated[tuple[Angle, ...], Field(min_length=3)]
    distance: PositiveLength
    across: Direction
    gauge: PositiveLength = 2e-3
    wavelengths: Annotated[tuple[PositiveLength, ...], NotEmpty, BeforeValidator(listed)]
    unit: LengthUnit = 1e-9
    photoelastic: Annotated[Number, Gt(0), Lt(1)] = 0.22
    thermal: PositiveNumber = 6.7e-6
    temperature: Temperature = 293.15
    temperature_channel: str | None = None
    noise: PositiveNumber = 1e-6
    offset_sigma: PositiveNumber = 2e-5
    drift: PositiveNumber = 1e-9

    @model_validator(mode="after")
    def _check(self) -> Self:
        gratings = len(self.stations) * len(self.angles)
        if len(self.channels) != gratings:
            raise wrong_value(
                f"{len(self.channels)} for {gratings} gratings: {len(self.stations)} stations of "
                f"{len(self.angles)} cores",
                key="channels",
            )
        if len(self.wavelengths) not in (1, len(self.angles), gratings):
            raise wrong_value("give one, one for each core, or one for each grating", key="wavelengths")
        if np.linalg.matrix_rank(self._cores, tol=1e-6 * self.distance) < 3:
            raise wrong_value("cores at these angles do not tell how the fibre bends", key="angles")
        return self

    @property
    def columns(self) -> Names:
        """Those of the gratings, then that of the temperature."""
        return (*self.channels, *(() if self.temperature_channel is None else (self.temperature_channel,)))

    @property
    def _cores(self) -> Float[np.ndarray, "c 3"]:
        """Strains of the cores by ε, κ₁, κ₂."""
        angle = np.array(self.angles)
        bent = -self.distance * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return np.concatenate([np.ones((len(angle), 1)), bent], axis=1)

    @property
    def _at_rest(self) -> Float[np.ndarray, "s c"]:
        """Wavelengths in their unit."""
        shape = len(self.stations), len(self.angles)
        given = np.array(self.wavelengths) / self.unit
        return given.reshape(shape) if given.size == shape[0] * shape[1] else np.broadcast_to(given, shape)

    @property
    def axial(self) -> bool:
        """Whether ε is read."""
        return self.temperature_channel is not None

    def sensor(self, parts):
        """The filter; `functional` tells whether the fibre is in the body."""
        del parts
        solving, kept = np.linalg.pinv(self._cores), slice(0 if self.axial else 1, None)
        strain = np.linalg.norm(solving, axis=1)[kept] / (1 - self.photoelastic)
        size = np.tile(strain, len(self.stations))
        names = ("strain", "bending 1", "bending 2")[kept]
        return self._direct(
            tuple(f"{name} at {k}" for k in range(len(self.stations)) for name in names),
            parameters(
                Bending,
                self,
                at_rest=jnp.asarray(self._at_rest),
                solving=jnp.asarray(solving),
                strain_optic=1 - self.photoelastic,
                axial=self.axial,
            ),
            0.0,
            units=("", "1/m", "1/m")[kept] * len(self.stations),
            size=size,
        )

    def functional(self, parts):
        """Changes of curvature, and of strain. Raises MeshError for a fibre that leaves the body."""
        path, stations, across = (np.array(each) for each in (self.path, self.stations, self.across))
        return ShapeReading(
            StationBending(Curvature.of(parts.body, path, stations, self.gauge, across), self.axial)
        )

    def ideal(self, parts, time_s, values):
        """Of changes of curvature and strain (m, k), at the temperature of the surroundings."""
        s, warm = len(self.stations), parts.temperature - self.temperature
        told = np.asarray(values).reshape(len(time_s), s, -1)
        if not self.axial:
            told = np.concatenate([np.zeros((*told.shape[:2], 1)), told], axis=2)
        shift = (1 - self.photoelastic) * told @ self._cores.T + self.thermal * warm
        raw = (self._at_rest * (1.0 + shift)).reshape(len(time_s), -1)
        if not self.axial:
            return raw
        return np.concatenate([raw, np.full((len(time_s), 1), parts.temperature - _CELSIUS)], axis=1)

    def electronics(self, parts, rng):
        """Gratings that are off at rest, and drift."""
        del parts
        at_rest = self._at_rest.ravel()
        size = np.concatenate([at_rest, np.zeros(int(self.axial))])
        return equal_channels(
            len(size),
            nothing=size,
            gain=np.where(size > 0, self._gains(rng, len(size)), 1.0),
            zero=rng.normal(0.0, self.offset_sigma, len(size)) * size,
            drift=self.drift * size,
            noise=self.noise * size,
        )
