"""What is told about each case of a sweep, column by column: in mm, N, mm³, Pa."""

import math
from dataclasses import dataclass
from typing import Literal

from softfuse.experiment.sweep import Outcome
from softfuse.robot.press_series import Series
from softfuse.robot.settings import RobotSettings

Value = float | int | str | None
"""None: not known, or not of this case."""


@dataclass(frozen=True)
class SweepColumn:
    """One column: its name, which ends with the unit, what it holds and what that is in words."""

    name: str
    kind: Literal["integer", "number", "text"]
    about: str


class SweepTable:
    """The rows of the sweep of a device, with up to so many contacts at once."""

    def __init__(self, config: RobotSettings, contacts: int, shortened: tuple[bool, ...]):
        """shortened: of each cable, whether its shortening is given; its tension is otherwise."""
        self._contacts, self._shortened = contacts, shortened
        self._discs = config.contact().within is not None
        self._readings = [*self._answers(config), *_volumes(config), *_pressures(config)]
        self.columns: tuple[SweepColumn, ...] = (
            SweepColumn("case", "integer", "number of the case, from 0"),
            SweepColumn("modulus_factor", "number", "factor of all moduli"),
            *self._driven(config),
            SweepColumn("contacts", "integer", "contacts at once"),
            *(column for k in range(contacts) for column in self._contact(k)),
            SweepColumn("force_N", "number", "sum of the forces"),
            *(column for column, _ in self._readings),
            SweepColumn("largest_displacement_mm", "number", "of a node"),
            SweepColumn("result", "text", "how the search ended"),
            SweepColumn("load_steps", "integer", "accepted ones, from the case before at the same place"),
            SweepColumn("newton_iterations", "integer", "from the case before at the same place"),
            SweepColumn("residual_N", "number", "largest unbalanced force on a node"),
            SweepColumn("wall_time_s", "number", "with compiling, where that was needed"),
        )

    def row(self, series: Series, k: int, outcome: Outcome, wall_time: float) -> list[Value]:
        """The values of the columns for case number k of a series; wall_time [s]."""
        force = series.forces[k]
        given = zip(self._shortened, series.cables, strict=True)
        each: list[Value] = []
        for place in series.places:
            each += [place] if isinstance(place, str) else [1e3 * x for x in place]
            each.append(force)
        width = len(self._contact(0))
        each += [None] * (width * (self._contacts - len(series.places)))
        readings = zip(self._readings, outcome.reading, strict=True)
        return [
            series.number + k,
            series.modulus_factor,
            *(1e3 * drive if by_length else drive for by_length, drive in given),
            len(series.places),
            *each,
            force * len(series.places),
            *(_known(scale * float(value)) for (_, scale), value in readings),
            _known(1e3 * outcome.largest_displacement),
            outcome.result,
            outcome.load_steps,
            outcome.newton_iterations,
            _known(outcome.residual),
            wall_time,
        ]

    def _contact(self, k: int) -> list[SweepColumn]:
        place = (
            [SweepColumn(f"contact{k}_{axis}_mm", "number", "middle of the disc") for axis in "xy"]
            if self._discs
            else [SweepColumn(f"contact{k}_electrode", "text", "the electrode that is pressed")]
        )
        return [*place, SweepColumn(f"contact{k}_force_N", "number", "its total force")]

    def _driven(self, config: RobotSettings) -> list[SweepColumn]:
        return [
            SweepColumn(f"cable{k}_mm", "number", f'given shortening of "{cable.name}"')
            if by_length
            else SweepColumn(f"cable{k}_N", "number", f'given tension of "{cable.name}"')
            for k, (cable, by_length) in enumerate(zip(config.cables, self._shortened, strict=True))
        ]

    def _answers(self, config: RobotSettings) -> list[tuple[SweepColumn, float]]:
        return [
            (SweepColumn(f"cable{k}_N", "number", f'tension of "{cable.name}"'), 1.0)
            if by_length
            else (SweepColumn(f"cable{k}_mm", "number", f'shortening of "{cable.name}"'), 1e3)
            for k, (cable, by_length) in enumerate(zip(config.cables, self._shortened, strict=True))
        ]


def _volumes(config: RobotSettings) -> list[tuple[SweepColumn, float]]:
    return [
        (SweepColumn(f"dV{k}_mm3", "number", f'volume change of "{chamber.name}"'), 1e9)
        for k, chamber in enumerate(config.chambers)
    ]


def _pressures(config: RobotSettings) -> list[tuple[SweepColumn, float]]:
    return [
        (SweepColumn(f"pressure{k}_Pa", "number", f'gauge pressure in "{chamber.name}"'), 1.0)
        for k, chamber in enumerate(config.chambers)
        if chamber.gas == "sealed"
    ]


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
