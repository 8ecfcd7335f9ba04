"""Materials: `law` names the strain energy of softfuse/material, the other keys are its constants.

Laws of one modulus take Young's modulus E and Poisson's ratio ν. The others take their own constants, which
give the shear modulus μ, and for the volume either ν, λ = 2 μ ν / (1 − 2 ν), or the bulk modulus K, λ = K − 2
μ / 3. A casting silicone may be given by its name alone, `silicone = "Ecoflex 00-30"`, which stands for the
Yeoh law, constants and density of softfuse/material/silicones.py; any of them given beside it counts instead.
"""

from abc import abstractmethod
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from annotated_types import Ge
from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo, field_validator, model_validator

from softfuse.io.quantity import Density, Number, PositivePressure, Pressure, shown, wrong_value
from softfuse.io.settings import NotEmpty, Settings
from softfuse.material import (
    AbstractMaterial,
    Corotational,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    SaintVenantKirchhoff,
    Yeoh,
)
from softfuse.material.silicones import POISSON, SILICONES


def _physical(poisson: float) -> float:
    if not -1.0 < poisson < 0.5:
        raise wrong_value(
            f"{poisson} must lie between -1 and 0.5, both excluded; silicone rubber has 0.49 to 0.499"
        )
    return poisson


PoissonRatio = Annotated[Number, AfterValidator(_physical)]


class MaterialSettings(Settings):
    """Keys that every law has: density in kg/m³, 0 (weightless) where it is left out."""

    stiffness_keys: ClassVar[tuple[str, ...]] = ()
    """The keys in Pa, which a calibration scales together."""

    density: Annotated[Density, Ge(0)] = 0.0

    @abstractmethod
    def material(self) -> AbstractMaterial:
        """Its strain-energy density."""

    def stiffness_times(self, factor: float) -> dict[str, float | tuple[float, ...]]:
        """The keys in Pa that are given, with their values multiplied by a factor."""
        given = {key: getattr(self, key) for key in self.stiffness_keys}
        return {
            key: tuple(factor * v for v in value) if isinstance(value, tuple) else factor * value
            for key, value in given.items()
            if value is not None
        }


class OneModulus(MaterialSettings):
    """Young's modulus in Pa and Poisson's ratio at small strains."""

    stiffness_keys: ClassVar[tuple[str, ...]] = ("young",)
    kind: ClassVar[type[NeoHookean | SaintVenantKirchhoff | Corotational]]

    young: PositivePressure
    poisson: PoissonRatio

    @property
    def shear_modulus(self) -> float:
        """μ in Pa."""
        return 0.5 * self.young / (1.0 + self.poisson)

    @property
    def lame(self) -> float:
        """Lamé's λ in Pa."""
        return 2.0 * self.shear_modulus * self.poisson / (1.0 - 2.0 * self.poisson)

    def material(self):
        """Of its kind."""
        return self.kind.from_young(self.young, self.poisson)


class NeoHookeanSettings(OneModulus):
    """Neo-Hookean law."""

    kind: ClassVar = NeoHookean
    law: Literal["neo-hookean"]


class SaintVenantKirchhoffSettings(OneModulus):
    """Saint Venant-Kirchhoff law; it collapses in strong compression."""

    kind: ClassVar = SaintVenantKirchhoff
    law: Literal["saint-venant-kirchhoff"]


class CorotationalSettings(OneModulus):
    """Linear law in the rotated frame."""

    kind: ClassVar = Corotational
    law: Literal["corotational"]


class SeveralModuli(MaterialSettings):
    """The volumetric stiffness of laws with constants of their own: exactly one of poisson and bulk (Pa)."""

    poisson: PoissonRatio | None = None
    bulk: PositivePressure | None = None

    @property
    @abstractmethod
    def shear_modulus(self) -> float:
        """μ in Pa at small strains."""

    @property
    def lame(self) -> float:
        """Lamé's λ in Pa at small strains."""
        mu = self.shear_modulus
        if self.bulk is not None:
            return self.bulk - 2.0 * mu / 3.0
        return 2.0 * mu * (self.poisson or 0.0) / (1.0 - 2.0 * (self.poisson or 0.0))

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.poisson is None) == (self.bulk is None):
            raise wrong_value("give either poisson or bulk, the stiffness against change of volume")
        if self.shear_modulus <= 0.0:
            raise wrong_value(
                f"the constants give the shear modulus {self.shear_modulus:.4g} Pa: it must be positive"
            )
        return self


class MooneyRivlinSettings(SeveralModuli):
    """Mooney-Rivlin law of C10 and C01 in Pa; μ = 2 (C10 + C01)."""

    stiffness_keys: ClassVar[tuple[str, ...]] = ("c10", "c01", "bulk")

    law: Literal["mooney-rivlin"]
    c10: Pressure
    c01: Pressure

    @property
    def shear_modulus(self) -> float:
        """μ in Pa at small strains."""
        return 2.0 * (self.c10 + self.c01)

    def material(self):
        """The law."""
        return MooneyRivlin(self.c10, self.c01, self.lame)


class YeohSettings(SeveralModuli):
    """Yeoh law of C1, C2, C3 in Pa; μ = 2 C1."""

    stiffness_keys: ClassVar[tuple[str, ...]] = ("c1", "c2", "c3", "bulk")

    law: Literal["yeoh"]
    c1: PositivePressure
    c2: Pressure
    c3: Pressure

    @property
    def shear_modulus(self) -> float:
        """μ in Pa at small strains."""
        return 2.0 * self.c1

    def material(self):
        """The law."""
        return Yeoh(self.c1, self.c2, self.c3, self.lame)


def _named(given: Any) -> Any:
    """A table with a silicone's name as the table of its law."""
    if not isinstance(given, Mapping) or "silicone" not in given:
        return given
    name, rest = given["silicone"], {key: value for key, value in given.items() if key != "silicone"}
    if rest.get("law", "yeoh") != "yeoh":
        raise wrong_value(f'names a Yeoh law: remove law = "{rest["law"]}" or the name', key="silicone")
    known = SILICONES.get(name.lower()) if isinstance(name, str) else None
    if known is None:
        names = ", ".join(each.name for each in SILICONES.values())
        raise wrong_value(
            f"{shown(name)} is not in the table: it has {names}; or give law and constants",
            key="silicone",
        )
    stiffness = {} if rest.keys() & {"poisson", "bulk"} else {"poisson": POISSON}
    constants = {f"c{k + 1}": f"{constant:.6g} Pa" for k, constant in enumerate(known.yeoh)}
    return {"law": "yeoh", **constants, **stiffness, "density": f"{known.density:g} kg/m^3", **rest}


class OgdenSettings(SeveralModuli):
    """Ogden law of any number of terms μ_p in Pa, α_p; μ = Σ μ_p α_p / 2."""

    stiffness_keys: ClassVar[tuple[str, ...]] = ("mu", "bulk")

    law: Literal["ogden"]
    mu: Annotated[tuple[Pressure, ...], NotEmpty]
    alpha: Annotated[tuple[Number, ...], NotEmpty]

    @property
    def shear_modulus(self) -> float:
        """μ in Pa at small strains."""
        return 0.5 * sum(m * a for m, a in zip(self.mu, self.alpha, strict=True))

    @field_validator("alpha")
    @classmethod
    def _check_alpha(cls, alpha: tuple[float, ...], info: ValidationInfo) -> tuple[float, ...]:
        terms = len(info.data.get("mu", alpha))
        if len(alpha) != terms:
            raise wrong_value(f"{len(alpha)} exponents for {terms} values of mu: give one of each per term")
        if 0.0 in alpha:
            raise wrong_value("an exponent of 0 has no energy: remove the term")
        return alpha

    def material(self):
        """The law."""
        return Ogden(np.array(self.mu), np.array(self.alpha), self.lame)


Material = Annotated[
    NeoHookeanSettings
    | SaintVenantKirchhoffSettings
    | CorotationalSettings
    | MooneyRivlinSettings
    | YeohSettings
    | OgdenSettings,
    Field(discriminator="law"),
    BeforeValidator(_named),
]
