"""The body: where its mesh comes from, what it is made of, where it is held."""

from typing import Annotated, Literal, Self

from annotated_types import Ge, Le
from pydantic import BeforeValidator, Field, model_validator

from softfuse.body.stiffness_field import TERMS
from softfuse.io.quantity import Acceleration, Number, wrong_value
from softfuse.io.settings import NotEmpty, Settings, Span, listed
from softfuse.mesh.registry import MeshedSource
from softfuse.robot.layout.layout_source import LayoutSource
from softfuse.robot.material import Material

Source = Annotated[MeshedSource | LayoutSource, Field(discriminator="type")]


class FixedSettings(Settings):
    """Nodes within these ranges (m, ends included) cannot move; an axis that is left out does not matter.

    group: a named group of the mesh's file, one of several where a list is given: what is in one of them and
    in the ranges, if there are any (softfuse/mesh/groups.py).
    """

    x: Span | None = None
    y: Span | None = None
    z: Span | None = None
    group: Annotated[tuple[str, ...], NotEmpty, BeforeValidator(listed)] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.x is None and self.y is None and self.z is None and self.group is None:
            raise wrong_value('give a range of x, y or z, such as z = ["0 mm", "0 mm"], or a group')
        return self


_Coefficient = Annotated[Number, Ge(-3), Le(3)]


class StiffnessFieldSettings(Settings):
    """Coefficients [-] of ln of how many times as stiff as its materials the body is, from place to place
    (softfuse/body/stiffness_field.py).
    """

    x: _Coefficient = 0.0
    y: _Coefficient = 0.0
    z: _Coefficient = 0.0
    xy: _Coefficient = 0.0
    xz: _Coefficient = 0.0
    yz: _Coefficient = 0.0
    xx: _Coefficient = 0.0
    yy: _Coefficient = 0.0
    zz: _Coefficient = 0.0

    @property
    def coefficients(self) -> tuple[float, ...]:
        """(9,) [-], as `with_field` takes them."""
        return tuple(getattr(self, term) for term in TERMS)

    @property
    def some(self) -> bool:
        """Whether any is not 0."""
        return any(self.coefficients)


class BodySettings(Settings):
    """Mesh, element, materials, how stiff they are from place to place, held nodes and gravity (3,) m/s².

    There is one material for each region of the mesh, in ascending order of the regions' numbers.
    """

    element: Literal["taylor-hood", "quadratic", "linear"] = "taylor-hood"
    source: Source
    materials: Annotated[tuple[Material, ...], NotEmpty] = Field(alias="material")
    # Without a field it is left out of digests, so that charts made before there were fields are still good.
    stiffness_field: StiffnessFieldSettings = Field(
        default=StiffnessFieldSettings(), exclude_if=lambda field: not field.some
    )
    fixed: FixedSettings
    gravity: tuple[Acceleration, Acceleration, Acceleration] = (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _check_pressure(self) -> Self:
        for k, material in enumerate(self.materials):
            if self.element == "taylor-hood" and material.lame <= 0.0:
                raise wrong_value(
                    f"Lamé's λ is {material.lame:.4g} Pa: a Taylor-Hood element needs a positive one; "
                    'raise poisson or bulk, or set body.element = "quadratic"',
                    key=f"material[{k}]",
                )
        return self
