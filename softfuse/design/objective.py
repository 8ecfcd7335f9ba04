"""What a design is judged by: numbers of how the robot answers to presses, all differentiable.

A press with force F at a place p changes s readings, whose noise is σ, by F w. With B = ∂(F w)/∂p (k, 2) and
what else knows the place, to σ_p, the information on (F, p) is

    J = Aᵀ A + diag(0, σ_p⁻², σ_p⁻²),     A = [w, B] / σ,

and its inverse the covariance (`estimation.uncertainty`). Where electrodes know the place, their
information on it (2, 2) stands for σ_p⁻². Optimal design knows several numbers of it: the mean variance
(A-optimal), the largest (E-optimal), the volume of the ellipsoid, ln det J⁻¹ (D-optimal). Source: F.
Pukelsheim, Optimal Design of Experiments, 1993, ch. 6.

Whoever needs another one writes a class with a name, a unit and a `__call__` that says what shall be small:

    class LeastSensitivity(AbstractMeasure):
        name: ClassVar[str] = "least sensitivity, negative"
        unit: ClassVar[str] = "reading/N"

        def __call__(self, answers):
            return -jnp.min(answers.sensitivity)

and settings for it, if a plan is to name it.
"""

from abc import abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
from annotated_types import Gt
from jaxtyping import Array, Float, Int
from pydantic import BeforeValidator, Field

from softfuse.errors import ConfigError
from softfuse.io.quantity import LENGTH, PositiveForce
from softfuse.io.settings import NotEmpty, Settings

_WORST = 12
"""Exponent of the norm that stands for a maximum, so that it has derivatives where two places are worst."""


class Answers(eqx.Module):
    """How a robot answers to s presses, see `RestResponse`: by_force (s, k) [reading's SI unit/N], by_place
    (s, k, 2) [that/(N m)], softness (s,) [m/N], motion (s, m, 3) [m/N] of what is watched, closing (s,)
    [1/N]: the largest part of the distance between opposite walls of a cavity that is lost, strain (s,)
    [1/N]: the largest principal one in the material; noise (k,) [reading's SI unit] of readings; touched
    (s, 2, 2) [1/m²]: information of electrodes on the place.
    """

    by_force: Float[Array, "s k"]
    by_place: Float[Array, "s k 2"]
    softness: Float[Array, " s"]
    motion: Float[Array, "s m 3"]
    closing: Float[Array, " s"]
    strain: Float[Array, " s"]
    noise: Float[Array, " k"]
    touched: Float[Array, "s 2 2"]

    @property
    def sensitivity(self) -> Float[Array, " s"]:
        """|w| (s,) [reading's SI unit/N]."""
        return jnp.linalg.norm(self.by_force, axis=1)

    def covariance(self, force_N: float, place_sigma_m: float | None) -> Float[Array, "s 3 3"]:
        """Of force [N] and place [m] (s, 3, 3) under a force [N], places known to `place_sigma_m` otherwise,
        which may be inf; None: as electrodes tell them.
        """
        a = jnp.concatenate([self.by_force[..., None], force_N * self.by_place], axis=2)
        a = a / self.noise[:, None]
        known = self.touched if place_sigma_m is None else place_sigma_m**-2 * jnp.eye(2)
        known = jnp.zeros((a.shape[0], 3, 3)).at[:, 1:, 1:].set(known)
        return jnp.linalg.inv(jnp.swapaxes(a, 1, 2) @ a + known)


class AbstractMeasure(eqx.Module):
    """A number that a design has: its name, its SI unit ("reading" stands for the readings'), what it is."""

    name: eqx.AbstractClassVar[str]
    unit: eqx.AbstractClassVar[str]

    @abstractmethod
    def __call__(self, answers: Answers) -> Float[Array, ""]:
        """The number, in SI; differentiable."""


def measured(measures: Sequence[AbstractMeasure], answers: Answers) -> Float[Array, " m"]:
    """The numbers (m,) in SI that answers give; differentiable."""
    return jnp.stack([measure(answers) for measure in measures])


class Unevenness(AbstractMeasure):
    """Coefficient of variation of the sensitivity |w| over all presses, the paper's aim."""

    name: ClassVar[str] = "unevenness"
    unit: ClassVar[str] = "1"

    def __call__(self, answers):
        """Standard deviation over mean."""
        return jnp.std(answers.sensitivity) / jnp.mean(answers.sensitivity)


class Sensitivity(AbstractMeasure):
    """Mean of |w|."""

    name: ClassVar[str] = "sensitivity"
    unit: ClassVar[str] = "reading/N"

    def __call__(self, answers):
        """Over all presses."""
        return jnp.mean(answers.sensitivity)


class Softness(AbstractMeasure):
    """How far a contact sinks in per newton, on average."""

    name: ClassVar[str] = "softness"
    unit: ClassVar[str] = "m/N"

    def __call__(self, answers):
        """Over all presses."""
        return jnp.mean(answers.softness)


class Closing(AbstractMeasure):
    """The largest part of the distance between opposite walls of a cavity that presses with a force [N] take,
    as far as answers grow with the force: walls touch at 1.
    """

    name: ClassVar[str] = "closing of cavities"
    unit: ClassVar[str] = "1"
    force_N: float

    def __call__(self, answers):
        """At the worst press."""
        return self.force_N * jnp.max(answers.closing)


class Strain(AbstractMeasure):
    """The largest principal strain of the material under presses with a force [N], as far as answers grow
    with the force.
    """

    name: ClassVar[str] = "strain"
    unit: ClassVar[str] = "1"
    force_N: float

    def __call__(self, answers):
        """At the worst press."""
        return self.force_N * jnp.max(answers.strain)


class ForceError(AbstractMeasure):
    """Root mean square of the force's standard deviation: A-optimality. force_N [N]: of the presses;
    place_sigma_m [m]: how well their places are known otherwise, None: as electrodes tell them.
    """

    name: ClassVar[str] = "force error"
    unit: ClassVar[str] = "N"
    force_N: float
    place_sigma_m: float | None

    def __call__(self, answers):
        """Over all presses."""
        return jnp.sqrt(jnp.mean(answers.covariance(self.force_N, self.place_sigma_m)[:, 0, 0]))


class WorstForceError(AbstractMeasure):
    """Largest standard deviation of a force, as a norm of high order; fields: see `ForceError`."""

    name: ClassVar[str] = "worst force error"
    unit: ClassVar[str] = "N"
    force_N: float
    place_sigma_m: float | None

    def __call__(self, answers):
        """(Σ σ^n / s)^(1/n): at most the largest, at least s^(−1/n) times it."""
        sigma = jnp.sqrt(answers.covariance(self.force_N, self.place_sigma_m)[:, 0, 0])
        most = jax.lax.stop_gradient(jnp.max(sigma))
        return most * jnp.mean((sigma / most) ** _WORST) ** (1.0 / _WORST)


class Ignorance(AbstractMeasure):
    """Mean of ½ ln det of the covariance of force [N] and place [mm]: D-optimality; fields: see
    `ForceError`.
    """

    name: ClassVar[str] = "ignorance"
    unit: ClassVar[str] = "1"
    force_N: float
    place_sigma_m: float | None

    def __call__(self, answers):
        """Over all presses."""
        covariance = answers.covariance(self.force_N, self.place_sigma_m)
        per_mm = jnp.diag(jnp.array([1.0, 1e3, 1e3]))
        return jnp.mean(0.5 * jnp.linalg.slogdet(per_mm @ covariance @ per_mm)[1])


class PlaceError(AbstractMeasure):
    """Median-like size of the place's standard deviation by these readings alone, under a force [N]: the
    geometric mean over presses, as some places are hardly told at all.
    """

    name: ClassVar[str] = "place error"
    unit: ClassVar[str] = "m"
    force_N: float

    def __call__(self, answers):
        """exp of the mean of ln √(σ_x² + σ_y²)."""
        covariance = answers.covariance(self.force_N, float("inf"))
        return jnp.exp(jnp.mean(0.5 * jnp.log(covariance[:, 1, 1] + covariance[:, 2, 2])))


class ElectrodeError(AbstractMeasure):
    """Root mean square of the place's standard deviation by electrodes alone."""

    name: ClassVar[str] = "place error of electrodes"
    unit: ClassVar[str] = "m"

    def __call__(self, answers):
        """√ of the mean of σ_x² + σ_y², over all presses."""
        covariance = jnp.linalg.inv(answers.touched)
        return jnp.sqrt(jnp.mean(jnp.trace(covariance, axis1=1, axis2=2)))


class PairError(AbstractMeasure):
    """How badly the two forces of presses that act at once are told apart: pairs (n, 2) of presses by number,
    such as one that bends the body sideways and one that bends it to the front.
    """

    name: ClassVar[str] = "error of pairs"
    unit: ClassVar[str] = "N"
    pairs: Int[Array, "n 2"]

    def __call__(self, answers):
        """Root mean square of the standard deviations of both, over all pairs."""
        a = jnp.swapaxes((answers.by_force / answers.noise)[self.pairs], 1, 2)
        covariance = jnp.linalg.inv(jnp.swapaxes(a, 1, 2) @ a)
        return jnp.sqrt(jnp.mean(jnp.trace(covariance, axis1=1, axis2=2)) / 2.0)


class ShapeError(AbstractMeasure):
    """Root mean square of the error of what is watched, as far as it comes from the force's: σ_F |v|; fields:
    see `ForceError`.
    """

    name: ClassVar[str] = "shape error"
    unit: ClassVar[str] = "m"
    force_N: float
    place_sigma_m: float | None

    def __call__(self, answers):
        """Over all presses and watched points."""
        variance = answers.covariance(self.force_N, self.place_sigma_m)[:, 0, 0]
        moved = jnp.mean(jnp.sum(answers.motion**2, axis=2), axis=1)
        return jnp.sqrt(jnp.mean(variance * moved))


KnownPlace = Annotated[
    Annotated[float, Gt(0)] | None,
    BeforeValidator(lambda value: None if value == "electrodes" else LENGTH.parse(value)),
]
"""How well a place is known otherwise: a length, or "electrodes"."""

_PLAIN = {
    "unevenness": Unevenness,
    "sensitivity": Sensitivity,
    "softness": Softness,
    "electrode-error": ElectrodeError,
}
_PRESS = {
    "force-error": ForceError,
    "worst-force-error": WorstForceError,
    "ignorance": Ignorance,
    "shape-error": ShapeError,
}
_SUFFERED = {"closing": Closing, "strain": Strain}


class MeasureSettings(Settings):
    """What a plan says of a measure."""

    by_place: ClassVar[bool] = False
    """Whether it counts how readings change with the place."""

    @property
    def by_electrodes(self) -> bool:
        """Whether it asks what electrodes tell of places."""
        return False

    @abstractmethod
    def build(self, path: Path, names: Sequence[str]) -> AbstractMeasure:
        """The measure of a plan's file, of presses on electrodes of such names, or at places of a surface.

        Raises ConfigError when it needs what these presses do not have.
        """


class PlainMeasureSettings(MeasureSettings):
    """A measure without settings."""

    measure: Literal["unevenness", "sensitivity", "softness", "electrode-error"]

    @property
    def by_electrodes(self):
        """One asks for nothing else."""
        return self.measure == "electrode-error"

    def build(self, path, names):
        """Of any presses."""
        return _PLAIN[self.measure]()


class PressMeasureSettings(MeasureSettings):
    """A measure of presses with a force [N], whose places are known otherwise to place_sigma m; None, in the
    file "electrodes": as well as the robot's electrodes tell them.
    """

    by_place: ClassVar[bool] = True

    measure: Literal["force-error", "worst-force-error", "ignorance", "shape-error"]
    force: PositiveForce
    place_sigma: KnownPlace

    @property
    def by_electrodes(self):
        """If it says so."""
        return self.place_sigma is None

    def build(self, path, names):
        """Of any presses."""
        return _PRESS[self.measure](self.force, self.place_sigma)


class SufferedSettings(MeasureSettings):
    """What cavities and material suffer from presses with a force [N]."""

    measure: Literal["closing", "strain"]
    force: PositiveForce

    def build(self, path, names):
        """Of any presses."""
        return _SUFFERED[self.measure](self.force)


class PlaceErrorSettings(MeasureSettings):
    """How well readings alone tell the place of a force [N]."""

    by_place: ClassVar[bool] = True

    measure: Literal["place-error"]
    force: PositiveForce

    def build(self, path, names):
        """Raises ConfigError for presses on electrodes."""
        if names:
            raise ConfigError(
                f"{path}: {self.measure}: electrodes are pressed as a whole, so that readings do not "
                'change with the place: take "force-error" or "pair-error"'
            )
        return PlaceError(self.force)


class PairErrorSettings(MeasureSettings):
    """How well the forces on two electrodes that are pressed at once are told apart, for pairs of names."""

    measure: Literal["pair-error"]
    pairs: Annotated[tuple[tuple[str, str], ...], NotEmpty]

    def build(self, path, names):
        """Raises ConfigError when an electrode is not pressed."""
        for pair in self.pairs:
            for name in pair:
                if name not in names:
                    raise ConfigError(
                        f'{path}: pairs: no press on an electrode "{name}": there are '
                        f"{', '.join(names) or 'none'}"
                    )
        return PairError(jnp.array([[names.index(name) for name in pair] for pair in self.pairs]))


AnyMeasure = Annotated[
    PlainMeasureSettings | PressMeasureSettings | SufferedSettings | PlaceErrorSettings | PairErrorSettings,
    Field(discriminator="measure"),
]
