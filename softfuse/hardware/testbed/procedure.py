"""One press at force levels, without hardware: what to do next out, what was felt in.

    lift -> travel -> tare -> approach -> (feel -> step)* -> hold -> ... next level ... -> retreat -> rest

The descent is closed over the force: with the last two heights h and forces F the stiffness is
k = (F₁ − F₀) / (h₀ − h₁), and the next step goes `SHARE` of the way (level − F) / k, since silicone stiffens,
within the finest and the longest step. Forces are positive when pressing, heights positive above the body's
top at rest. Whatever is not as it should be ends the press: no further step down, and whoever drives the
stage retreats.

Source: Navarro et al. 2020, Sec. V-A.1 (a grid of places, force levels of 5, 10 and 15 N).
"""

import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from typing import Self

from softfuse.errors import HardwareError

SHARE = 0.7
HEADROOM = 1.3
"""A force limit over the highest level, where none is given."""
WRONG_WAY = 0.3
"""A force below −WRONG_WAY times the first level says that its sign is wrong."""


@dataclass(frozen=True)
class PressSettings:
    """How to press; HardwareError for what cannot be. Forces [N], lengths [m], speeds [m/s], times [s].

    levels: of the force, ascending; force_limit, depth_limit: never beyond; clearance: height of travel;
    approach: height from which the descent is stepwise; longest_step, finest_step; tolerance: a level is
    reached when so much is missing; settle, tare, hold, rest: how long to feel after a step, to take the
    force's zero, to hold a level, and to leave the body alone after a press.
    """

    levels: tuple[float, ...] = (5.0, 10.0, 15.0)
    force_limit: float = 20.0
    depth_limit: float = 6e-3
    clearance: float = 5e-3
    approach: float = 1e-3
    longest_step: float = 2e-4
    finest_step: float = 1e-5
    tolerance: float = 0.1
    travel_speed: float = 20e-3
    press_speed: float = 2e-3
    retreat_speed: float = 5e-3
    settle: float = 0.1
    tare: float = 0.5
    hold: float = 1.0
    rest: float = 1.5

    @classmethod
    def of(
        cls,
        levels: Sequence[float],
        force_limit: float | None,
        *,
        clearance: float,
        longest_step: float,
        **others: float,
    ) -> Self:
        """With the usual levels where none are given and a force limit of `HEADROOM` times the highest one
        where there is none; approach and finest step are the usual ones, or shorter.
        """
        chosen = tuple(levels) or cls.levels
        return cls(
            levels=chosen,
            force_limit=HEADROOM * max(chosen) if force_limit is None else force_limit,
            clearance=clearance,
            approach=min(cls.approach, clearance),
            longest_step=longest_step,
            finest_step=min(cls.finest_step, longest_step),
            **others,
        )

    def __post_init__(self) -> None:
        if not self.levels or any(
            not a < b < math.inf for a, b in zip((0.0, *self.levels), self.levels, strict=False)
        ):
            listed = ", ".join(f"{level:g}" for level in self.levels)
            raise HardwareError(f"the force levels {listed} N must be above 0 and ascend")
        for name, value in vars(self).items():
            if name != "levels" and not 0.0 < value < math.inf:
                raise HardwareError(
                    f"the {name.replace('_', ' ')} of a press must be above 0 and finite, not {value:g}"
                )
        if not self.force_limit > self.levels[-1]:
            raise HardwareError(
                f"the force limit of {self.force_limit:g} N must be above the highest level, "
                f"{self.levels[-1]:g} N"
            )
        if not self.finest_step <= self.longest_step:
            raise HardwareError("the finest step must not be longer than the longest")
        if not self.tolerance < self.levels[0]:
            raise HardwareError(f"the tolerance must be below the first level, {self.levels[0]:g} N")
        if not self.approach <= self.clearance:
            raise HardwareError("the descent must begin at or below the clearance")


@dataclass(frozen=True)
class Place:
    """x, y in the body's coordinates and the height above its top at rest [m]."""

    x: float
    y: float
    height: float


@dataclass(frozen=True)
class Move:
    """Go straight to a place with a speed [m/s]."""

    to: Place
    speed: float


@dataclass(frozen=True)
class Tare:
    """Take the mean force over so long [s] as its zero."""

    seconds: float


@dataclass(frozen=True)
class Feel:
    """Measure the mean force over so long [s]."""

    seconds: float


@dataclass(frozen=True)
class Hold:
    """Stay for so long [s], measure the mean force at the end, and mark a sample of a level, from 1."""

    level: int
    seconds: float


@dataclass(frozen=True)
class Rest:
    """Stay for so long [s]."""

    seconds: float


Action = Move | Tare | Feel | Hold | Rest


@dataclass(frozen=True)
class Seen:
    """After an action: the height of the stage [m], and the pressing force [N] where one was measured."""

    height: float
    force: float = math.nan


def press(settings: PressSettings, x: float, y: float, at: Place) -> Generator[Action, Seen, None]:
    """What to do for a press at x, y [m] by a stage that stands at a place; it is sent what was seen after
    each action.

    HardwareError, which says what to do, for a force that is not as it should be, and at the depth limit.
    """
    over = Place(x, y, settings.clearance)
    if at.height < settings.clearance:
        yield Move(replace(at, height=settings.clearance), settings.retreat_speed)
    yield Move(over, settings.travel_speed)
    yield Tare(settings.tare)
    yield Move(replace(over, height=settings.approach), settings.travel_speed)
    before: Seen | None = None
    for number, level in enumerate(settings.levels, start=1):
        while True:
            seen = yield Feel(settings.settle)
            _check(settings, seen.force)
            if seen.force >= level - settings.tolerance:
                break
            room = seen.height + settings.depth_limit
            if room < settings.finest_step:
                raise HardwareError(
                    f"{seen.force:.2f} N instead of {level:g} N at the depth limit of "
                    f"{1e3 * settings.depth_limit:g} mm: check the stage's zero and the force sensor, "
                    "or allow more"
                )
            down = min(_step(settings, before, seen, level), room)
            before = seen
            yield Move(replace(over, height=seen.height - down), settings.press_speed)
        held = yield Hold(number, settings.hold)
        _check(settings, held.force)
    yield Move(over, settings.retreat_speed)
    yield Rest(settings.rest)


def _check(settings: PressSettings, force: float) -> None:
    if math.isnan(force):
        raise HardwareError("the force is not known: check the force sensor and its channel")
    if abs(force) > settings.force_limit:
        raise HardwareError(beyond(settings.force_limit, force))
    if force < -WRONG_WAY * settings.levels[0]:
        raise HardwareError(f"pressing gives {force:.2f} N: the force's sign is the other one (--force-sign)")


def beyond(limit: float, force: float) -> str:
    """What to tell of a force [N] beyond the limit [N]."""
    return (
        f"{force:.2f} N is beyond the limit of {limit:g} N: look what the stage has touched, "
        "then check its zero"
    )


def _step(settings: PressSettings, before: Seen | None, seen: Seen, level: float) -> float:
    step = settings.longest_step
    if before is not None and seen.force > settings.tolerance:
        depth, more = before.height - seen.height, seen.force - before.force
        if depth > 0.0 and more > 0.0:
            step = SHARE * (level - seen.force) * depth / more
    return min(max(step, settings.finest_step), settings.longest_step)
