"""How lines of electrodes follow the parameters of a design, and what they tell of places."""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.design.plan import DesignPlan
from softfuse.errors import ConfigError
from softfuse.functional.chart import FlatChart
from softfuse.io.quantity import millimetres
from softfuse.robot.file import Edits
from softfuse.robot.settings import RobotSettings
from softfuse.sensors.capacitive import ElectrodeLinesSettings

_KINDS = ("columns", "rows")
"""In the order of the coordinates that they are at."""


class ElectrodePitch(eqx.Module):
    """Columns and rows of electrodes, drawn (c,) and (r,) m, and what each parameter (p,) adds to their pitch
    (2, p) m; parameters are 0 as drawn.
    """

    drawn: tuple[Float[np.ndarray, " c"], Float[np.ndarray, " r"]]
    ties: Float[np.ndarray, "2 p"]

    @classmethod
    def of(cls, plan: DesignPlan, config: RobotSettings) -> "ElectrodePitch":
        """Of a plan; raises ConfigError when it changes lines of a robot that has none, or bounds let them
        leave the body or cross each other.
        """
        lines = _lines(config)
        ties = np.zeros((2, len(plan.parameters)))
        for j, parameter in enumerate(plan.parameters):
            for i, tie in enumerate(parameter.adds):
                if tie.electrodes is None:
                    continue
                if lines is None:
                    raise ConfigError(
                        f"{plan.path}: parameter[{j}].adds[{i}].electrodes: {config.path} has no rows and "
                        "columns of electrodes"
                    )
                ties[_KINDS.index(tie.electrodes), j] += tie.times
        if lines is None:
            return cls((np.zeros(0), np.zeros(0)), ties)
        pitch = cls((np.array(lines.column_x), np.array(lines.row_y)), ties)
        pitch._check(plan, config, lines)
        return pitch

    def lines(self, theta: Float[Array, " p"]) -> tuple[Float[Array, " c"], Float[Array, " r"]]:
        """Columns (c,) and rows (r,) m with parameters (p,), stretched about their middle; differentiable."""
        added = self.ties @ theta
        columns, rows = (
            jnp.asarray(drawn) + by * (np.arange(len(drawn)) - 0.5 * (len(drawn) - 1))
            for drawn, by in zip(self.drawn, added, strict=True)
        )
        return columns, rows

    def edits(self, config: RobotSettings, theta: Float[np.ndarray, " p"]) -> Edits:
        """The edits of a config that give it the lines of parameters (p,); none where these do not change."""
        if not self.ties.any():
            return {}
        lines = _lines(config)
        assert lines is not None  # as there are ties
        key = config.sensors.index(lines)
        columns, rows = (np.asarray(each).tolist() for each in self.lines(jnp.asarray(theta)))
        edits: dict[tuple[str | int, ...], list[str]] = {
            ("sensor", key, "column_x"): [millimetres(x) for x in columns],
            ("sensor", key, "row_y"): [millimetres(y) for y in rows],
        }
        return edits

    def _check(self, plan: DesignPlan, config: RobotSettings, lines: ElectrodeLinesSettings) -> None:
        bounds = np.array([parameter.bounds for parameter in plan.parameters])
        for axis, (kind, drawn) in enumerate(zip(_KINDS, self.drawn, strict=True)):
            ties = self.ties[axis]
            if not ties.any():
                continue
            least, most = (np.sum(pick(ties[:, None] * bounds, axis=1)) for pick in (np.min, np.max))
            if not np.min(np.diff(drawn)) + least > 0:
                raise ConfigError(
                    f"{plan.path}: parameter: {kind} of electrodes could cross: raise a lower bound of their "
                    "pitch"
                )
            into = config.contact(lines.contact).direction
            if into is None:
                continue  # on no flat face, which is told when the sensor is made
            block = config.body.source.outside()
            ends = np.stack([block.low, block.high]) * np.asarray(FlatChart.along(into).axes)[axis]
            middle, reach = np.mean(drawn[[0, -1]]), 0.5 * (np.ptp(drawn) + (len(drawn) - 1) * most)
            if middle - reach < ends.min(axis=0).sum() or middle + reach > ends.max(axis=0).sum():
                raise ConfigError(
                    f"{plan.path}: parameter: {kind} of electrodes could leave the body: reduce an upper "
                    "bound of their pitch"
                )


def touched(
    plan: DesignPlan, config: RobotSettings, pitch: ElectrodePitch, places: Float[Array, "s 3 3"]
) -> Callable[[Array], Float[Array, "s 2 2"]]:
    """Information (s, 2, 2) 1/m² of the electrodes with parameters (p,) on places (s, 3, 3) of contacts.

    Raises ConfigError when the robot has no rows and columns of electrodes.
    """
    lines = _lines(config)
    if lines is None:
        raise ConfigError(
            f"{plan.path}: {config.path} has no rows and columns of electrodes that tell places: give "
            "place_sigma as a length"
        )
    told = lines.place_information(config.contact(lines.contact).radius)
    return lambda theta: told(*pitch.lines(theta), places[:, 0, :2])


def _lines(config: RobotSettings) -> ElectrodeLinesSettings | None:
    """The first sensor with rows and columns of electrodes."""
    return next(iter(config.sensors_of(ElectrodeLinesSettings)), None)
