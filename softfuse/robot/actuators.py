"""Settings of what acts on a body: cables and chambers, and what each of them is commanded to."""

from contextlib import suppress
from typing import Annotated, Literal, Self

import numpy as np
from annotated_types import Ge, Le
from pydantic import model_validator

from softfuse.body.base import AbstractBody
from softfuse.io.quantity import (
    FORCE,
    LENGTH,
    PRESSURE,
    Acceleration,
    Compliance,
    Length,
    Number,
    PositiveForce,
    PositivePressure,
    Pressure,
    Volume,
    wrong_value,
)
from softfuse.io.settings import Direction, ExistingFile, Settings, Vector
from softfuse.mechanics.cable import PulledCable
from softfuse.robot.points import Path3, surface_tolerance

_COMMANDS = {"length": LENGTH, "tension": FORCE, "pressure": PRESSURE}
"""What may be commanded."""


class CommandSettings(Settings):
    """The column of a recording that holds what an actuator is commanded to, and its unit, which says of
    what: "mm" of a cable's shortening, "N" of its tension, "kPa" of a chamber's gauge pressure.
    """

    channel: str
    unit: str

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self._told:
            raise wrong_value(
                f'"{self.unit}" is no unit of a length, a tension or a pressure: give one such as "mm", "N" '
                'or "kPa"',
                key="unit",
            )
        return self

    @property
    def _told(self) -> list[tuple[str, float]]:
        """What the unit is one of, and how many SI units it has."""
        told = []
        for what, dimension in _COMMANDS.items():
            with suppress(ValueError):
                told.append((what, dimension.parse(f"1 {self.unit}")))
        return told

    @property
    def of(self) -> str:
        """What is commanded: "length", "tension" or "pressure"."""
        return self._told[0][0]

    @property
    def factor(self) -> float:
        """SI units in one of the column's."""
        return self._told[0][1]


class CableSettings(Settings):
    """A cable from pulled_at (3,) m through guides (g, 3) m in the body; its end holds a ball of
    anchor_radius in m around the last one: a point would sink in without limit as the mesh gets finer. Guides
    up to guide_tolerance in m outside the body are put onto its surface, a tenth of the mesh's mean edge
    where it is left out.

    friction [-]: μ at the guides; compliance in m/N: by how much the cable itself gets longer; max_tension in
    N; command: what it is commanded to, None where that is measured or unknown.
    """

    name: str
    guides: Path3
    pulled_at: Vector
    anchor_radius: Annotated[Length, Ge(0)] = 0.0
    friction: Annotated[Number, Ge(0)] = 0.0
    compliance: Annotated[Compliance, Ge(0)] = 0.0
    max_tension: PositiveForce
    guide_tolerance: Annotated[Length, Ge(0)] | None = None
    command: CommandSettings | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.pulled_at == self.guides[0]:
            raise wrong_value("is the first guide: pull from a point outside the body", key="pulled_at")
        if self.command is not None and self.command.of == "pressure":
            raise wrong_value("a cable is commanded to a length or a tension", key="command.unit")
        return self

    def load(self, body: AbstractBody) -> PulledCable:
        """The cable in a body at rest; raises MeshError as `PulledCable.through` does."""
        within = self.guide_tolerance
        return PulledCable.through(
            body,
            np.array(self.guides),
            np.array(self.pulled_at),
            friction=self.friction,
            compliance=self.compliance,
            anchor_radius=self.anchor_radius,
            within=surface_tolerance(body) if within is None else within,
        )


class MouthSettings(Settings):
    """Where a chamber opens: a point (3,) m in its opening, and the direction (3,) there out of the body."""

    at: Vector
    outwards: Direction


class ChamberSettings(Settings):
    """A chamber: its name, a point (3,) m in it, and its gas: "vented" to the atmosphere, "sealed" in, or
    "driven" to a gauge pressure.

    file: its walls as a closed surface (STL, OBJ, PLY, OFF) in the unit of the body's file; a body of a
    surface is hollowed by it, the void of one of a mesh has to fit it. mouth: where it opens, None where it
    is closed (softfuse/mesh/chambers.py). shift, growth (3,) m: how the chamber that was made differs from
    the one drawn, in place and in length along x, y and z. dead_volume in m³: of its tube and port; exponent
    κ [-] of p V^κ: 1 isothermal, 1.4 adiabatic air. lowest, highest in Pa: between which gauge pressures it
    is driven; command: to which, None where that is measured or unknown.
    """

    name: str
    centre: Vector
    file: ExistingFile | None = None
    mouth: MouthSettings | None = None
    gas: Literal["vented", "sealed", "driven"] = "vented"
    shift: Vector = (0.0, 0.0, 0.0)
    growth: Vector = (0.0, 0.0, 0.0)
    dead_volume: Annotated[Volume, Ge(0)] = 0.0
    exponent: Annotated[Number, Ge(1), Le(5 / 3)] = 1.0
    lowest: Annotated[Pressure, Le(0)] = 0.0
    highest: PositivePressure | None = None
    command: CommandSettings | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.mouth is not None and (any(self.shift) or any(self.growth)):
            raise wrong_value(
                "walls of an open chamber are not moved: leave out shift and growth", key="mouth"
            )
        if self.gas == "driven":
            if self.highest is None:
                raise wrong_value(
                    "missing: the highest pressure that the chamber is driven to", key="highest"
                )
            if self.command is not None and self.command.of != "pressure":
                raise wrong_value("a chamber is commanded to a pressure", key="command.unit")
        elif self.command is not None or self.highest is not None:
            raise wrong_value(
                f'only a chamber with gas = "driven" has it, this one is {self.gas}', key="command"
            )
        return self


class EnvironmentSettings(Settings):
    """What is around the robot: gravity (3,) m/s², the atmosphere in Pa, absolute."""

    gravity: tuple[Acceleration, Acceleration, Acceleration] = (0.0, 0.0, 0.0)
    atmosphere: PositivePressure = 101325.0
