"""What a design run looks for, as a TOML file: a robot, its cavities as drawn, what may change, and what is
wanted.
"""

from pathlib import Path
from typing import Annotated, Literal, Self

from annotated_types import Ge, Gt
from pydantic import Field, model_validator

from softfuse.design.objective import AnyMeasure
from softfuse.io.quantity import (
    ANGLE,
    LENGTH,
    Force,
    Integer,
    Number,
    PositiveInteger,
    PositiveLength,
    PositiveNumber,
    PositivePressure,
    Volume,
    wrong_value,
)
from softfuse.io.settings import ExistingFile, FileSettings, NotEmpty, Settings, Vector
from softfuse.robot.chamber_shapes import RoundedBoxSettings, SuperellipsoidSettings
from softfuse.robot.file import file_text, validated
from softfuse.robot.press_plan import AnyPlaces

AXES = ("x", "y", "z")
"""Names of the coordinates of a guide."""

Quantity = str | float
"""Of a kind that depends on the value that it changes: "2 mm", "5 deg" or 0.1."""


class DrawnRoundedBox(RoundedBoxSettings):
    """A cavity's name and its centre (3,) m, besides its shape."""

    name: str
    centre: Vector


class DrawnSuperellipsoid(SuperellipsoidSettings):
    """A cavity's name and its centre (3,) m, besides its shape."""

    name: str
    centre: Vector


DrawnCavity = Annotated[DrawnRoundedBox | DrawnSuperellipsoid, Field(discriminator="profile")]


class TieSettings(Settings):
    """Values of a cavity, see `CavityShape.names`, or "x", "y", "z" of a cable's guides, all or those
    numbered from 0, or the "pitch" of lines of electrodes, that a parameter is added to, so many times.
    """

    cavity: str | None = None
    cable: str | None = None
    electrodes: Literal["rows", "columns"] | None = None
    guides: Annotated[tuple[Annotated[Integer, Ge(0)], ...], NotEmpty] | None = None
    value: str
    times: Number = 1.0

    @model_validator(mode="after")
    def _check(self) -> Self:
        if [self.cavity, self.cable, self.electrodes].count(None) != 2:
            raise wrong_value(
                'adds to one thing: name a cavity or a cable, or electrodes, "rows" or "columns"'
            )
        if self.cable is None and self.guides is not None:
            raise wrong_value("are those of a cable: give its name", key="guides")
        if self.cable is not None and self.value not in AXES:
            raise wrong_value(f'a cable\'s guides have {", ".join(AXES)}, no "{self.value}"', key="value")
        if self.electrodes is not None and self.value != "pitch":
            raise wrong_value(f'lines of electrodes have a pitch, no "{self.value}"', key="value")
        return self


class ParameterSettings(Settings):
    """What may change: lower and upper bound of what is added to the values drawn, and by how much it is
    usually changed; lengths, angles or numbers as these values are.
    """

    name: str
    lower: Quantity
    upper: Quantity
    scale: Quantity | None = None
    adds: Annotated[tuple[TieSettings, ...], NotEmpty]

    @property
    def unit(self) -> str:
        """SI unit of the values that it adds to: "m", "rad" or "1"."""
        return _unit(self.adds[0].value)

    def quantity(self, value: Quantity, key: str) -> float:
        """A bound in SI; raises the error of a validator that names the key."""
        dimension = {"m": LENGTH, "rad": ANGLE}.get(self.unit)
        if dimension is None:
            if isinstance(value, str):
                raise wrong_value(
                    f'"{value}" should be a plain number: {self.adds[0].value} has no unit', key=key
                )
            return float(value)
        return dimension.parse(value)

    @property
    def bounds(self) -> tuple[float, float]:
        """Lower and upper, in SI."""
        return self.quantity(self.lower, "lower"), self.quantity(self.upper, "upper")

    @property
    def usual_change(self) -> float | None:
        """The scale in SI."""
        return None if self.scale is None else self.quantity(self.scale, "scale")

    @model_validator(mode="after")
    def _check(self) -> Self:
        units = {_unit(tie.value) for tie in self.adds}
        if len(units) > 1:
            raise wrong_value("adds to lengths, angles or numbers, not to several of these", key="adds")
        low, high = self.bounds
        if not low <= 0.0 <= high or low == high:
            raise wrong_value(
                "the cavities as drawn have 0, which must lie between lower and upper, and these must differ"
            )
        change = self.usual_change
        if change is not None and not change > 0.0:
            raise wrong_value("must be positive", key="scale")
        return self


def _unit(value: str) -> str:
    if value.startswith("turn "):
        return "rad"
    return "1" if value.startswith("harmonic ") or value == "roundness" else "m"


_PURE = ("unevenness", "closing", "strain")
"""Measures whose numbers say something by themselves."""


class LimitSettings(Settings):
    """What a measure must be at least and at most, in parts of that of the robot as it is [-], or by itself
    where it has no unit.
    """

    of: AnyMeasure
    at_least: PositiveNumber | None = None
    at_most: PositiveNumber | None = None
    most: PositiveNumber | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.at_least is None and self.at_most is None and self.most is None:
            raise wrong_value("give at_least or at_most, parts of the robot's own, or most")
        if self.most is not None and self.of.measure not in _PURE:
            raise wrong_value(
                f'is for {", ".join(_PURE)}: limit "{self.of.measure}" by at_most, in parts of the robot\'s '
                "own",
                key="most",
            )
        if self.at_most is not None and self.most is not None:
            raise wrong_value("is one bound: give at_most or most", key="most")
        return self


class WallSettings(Settings):
    """Least thickness in m of all walls, and of those whose names begin as given, such as "(-,-), high z"."""

    thickness: PositiveLength
    special: dict[str, PositiveLength] = {}


class NoiseSettings(Settings):
    """Standard deviations of readings: of volumes in m³ where cavities are vented, else of pressures in Pa
    and of a cable's shortening in m.
    """

    volume: Annotated[Volume, Gt(0)] = 0.6e-9
    pressure: PositivePressure = 20.0
    shortening: PositiveLength = 0.1e-3


class LookSettings(Settings):
    """How the search goes: on a mesh whose `edges`, such as {"surface_size": 0.009} m, may be other ones than
    the robot's; random starts besides the cavities as drawn, of which so many are followed; see
    `SearchSettings`.
    """

    edges: dict[str, PositiveLength] = {}
    starts: Annotated[Integer, Ge(0)] = 0
    followed: PositiveInteger = 1
    seed: Annotated[Integer, Ge(0)] = 0
    legs: PositiveInteger = 6
    iterations: PositiveInteger = 15
    move: PositiveNumber = 3.0
    improvement: PositiveNumber = 0.01


class FrontSettings(Settings):
    """A Pareto front: the objective at several limits [-] of a measure, at least or at most that many parts
    of the robot's own.
    """

    of: AnyMeasure
    at_least: tuple[PositiveNumber, ...] = ()
    at_most: tuple[PositiveNumber, ...] = ()

    @model_validator(mode="after")
    def _check(self) -> Self:
        if bool(self.at_least) == bool(self.at_most):
            raise wrong_value("give either at_least or at_most, a list of parts of the robot's own")
        return self

    @property
    def unlimited(self) -> LimitSettings:
        """The measure without limits."""
        return LimitSettings.model_construct(of=self.of, at_least=None, at_most=None, most=None)

    def limit(self, part: float) -> LimitSettings:
        """The limit at one of its values."""
        return LimitSettings.model_construct(
            of=self.of,
            at_least=part if self.at_least else None,
            at_most=part if self.at_most else None,
            most=None,
        )


class VerifySettings(Settings):
    """How what was found is looked at again: under a force [N], on a mesh whose edges are `finer` times as
    short.
    """

    force: Annotated[Force, Gt(0)] = 10.0
    finer: PositiveNumber = 1.5


class MouldSettings(Settings):
    """Lengths in m of the casting and its mould, see `softfuse.design.mould.MouldShape`: radius of the ports,
    thickness of the mould, radius, length and room of its pins, and how near flat facets are to surfaces.
    """

    port_radius: PositiveLength = 1e-3
    thickness: PositiveLength = 6e-3
    pin_radius: PositiveLength = 1.8e-3
    pin_length: PositiveLength = 4e-3
    room: PositiveLength = 0.1e-3
    facets: PositiveLength = 20e-6


class DesignPlan(FileSettings):
    """A validated design task, in SI.

    robot: configuration of the robot whose cavities are designed; its body is a block with cavities.
    places: presses by which a layout is judged. cavities as drawn, as many as shall be, and the parameters
    that change them.
    """

    robot: ExistingFile
    places: AnyPlaces
    noise: NoiseSettings = NoiseSettings()
    objective: AnyMeasure
    limits: tuple[LimitSettings, ...] = Field(default=(), alias="limit")
    walls: WallSettings
    cavities: Annotated[tuple[DrawnCavity, ...], NotEmpty] = Field(alias="cavity")
    parameters: Annotated[tuple[ParameterSettings, ...], NotEmpty] = Field(alias="parameter")
    search: LookSettings = LookSettings()
    front: FrontSettings | None = None
    verify: VerifySettings = VerifySettings()
    mould: MouldSettings = MouldSettings()

    @model_validator(mode="after")
    def _check_names(self) -> Self:
        cavities = {cavity.name: cavity for cavity in self.cavities}
        if len(cavities) < len(self.cavities):
            raise wrong_value("two cavities have the same name", key="cavity")
        names = [parameter.name for parameter in self.parameters]
        if len(set(names)) < len(names):
            raise wrong_value("two parameters have the same name", key="parameter")
        for k, parameter in enumerate(self.parameters):
            for j, tie in enumerate(parameter.adds):
                key = f"parameter[{k}].adds[{j}]"
                if tie.cavity is None:
                    continue
                if tie.cavity not in cavities:
                    raise wrong_value(
                        f'there is no cavity "{tie.cavity}": there are {", ".join(cavities)}',
                        key=f"{key}.cavity",
                    )
                known = cavities[tie.cavity].shape.names
                if tie.value not in known:
                    raise wrong_value(
                        f'cavity "{tie.cavity}" has no "{tie.value}": it has {", ".join(known)}',
                        key=f"{key}.value",
                    )
        return self


def load_design(path: str | Path) -> DesignPlan:
    """The design task in a TOML file.

    Raises ConfigError, one line for each mistake with the file and the key's path.
    """
    return validated(file_text(Path(path)), Path(path), DesignPlan)
