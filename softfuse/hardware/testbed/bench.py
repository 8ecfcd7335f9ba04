"""A stage and a force sensor that press one place after the other, with somebody who watches the force.

While the stage may touch the body a thread looks at the newest force every `WATCH_S` and stops the stage at
once, whatever it is doing, when the force is beyond the limit or is not known any more. What has stopped it,
an interruption by people included, is followed by a retreat straight up, and by no further press.
"""

import threading
from collections.abc import Generator, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from softfuse.errors import HardwareError
from softfuse.hardware.stage.gcode import GcodeStage, Workspace
from softfuse.hardware.testbed.gathering import Gathering
from softfuse.hardware.testbed.places import Point
from softfuse.hardware.testbed.procedure import (
    Action,
    Feel,
    Hold,
    Move,
    Place,
    PressSettings,
    Rest,
    Seen,
    Tare,
    press,
)

WATCH_S = 0.005
AVERAGE_S = 0.2
"""The force of a sample is the mean over the last so long of its hold [s], half of the hold at most."""

Origin = tuple[float, float, float]
"""Where the middle of the body's top is, in the stage's coordinates [m]."""


@dataclass(frozen=True)
class Pressed:
    """A press that was done: its number, its place [m], and force [N] and depth [m] of each sample."""

    press: int
    at: Point
    samples: tuple[tuple[float, float], ...]

    def __str__(self) -> str:
        x, y = self.at
        samples = ", ".join(f"{force:.2f} N {1e3 * depth:.2f} mm deep" for force, depth in self.samples)
        return f"press {self.press} at ({1e3 * x:.2f}, {1e3 * y:.2f}) mm: {samples}"


def workspace_of(settings: PressSettings, places: Sequence[Point], origin: Origin) -> Workspace:
    """Where the stage [m] may go for these presses, and how fast."""
    x, y = ([origin[k] + at[k] for at in places] for k in range(2))
    return Workspace(
        (min(x), min(y), origin[2] - settings.depth_limit),
        (max(x), max(y), origin[2] + settings.clearance),
        max(settings.travel_speed, settings.press_speed, settings.retreat_speed),
    )


class Bench:
    """Presses with a stage that is connected and a gathering that has started."""

    def __init__(
        self, stage: GcodeStage, gathering: Gathering, settings: PressSettings, origin: Origin
    ) -> None:
        """`origin`: of the body's coordinates in those of the stage [m]."""
        self._stage, self._gathering, self._settings = stage, gathering, settings
        self._origin = np.array(origin)
        self._samples: list[tuple[float, float]] = []

    def press(self, places: Sequence[Point], first: int) -> Iterator[Pressed]:
        """Press the places [m] in order, numbered from `first`; each when it is done.

        HardwareError for whatever is not as it should be, after the retreat.
        """
        # Good enough to notice that the way to the first place is blocked.
        self._gathering.relabel(zero=self._gathering.reading(self._settings.tare))
        for number, at in enumerate(places, start=first):
            self._samples = []
            self._gathering.relabel(press=number, at=at)
            self._press(at)
            yield Pressed(number, at, tuple(self._samples))

    def _press(self, at: Point) -> None:
        actions = press(self._settings, *at, self._here())
        watch = _Watch(self._stage, self._gathering, self._settings.force_limit)
        watch.start()
        try:
            self._carry_out(actions, at, watch)
        except KeyboardInterrupt:
            # The stage may still be moving.
            watch.end()
            self._stage.stop()
            self._retreat(self._here())
            raise
        finally:
            watch.end()

    def _carry_out(self, actions: Generator[Action, Seen, None], at: Point, watch: "_Watch") -> None:
        """Do all actions of the press at a place; HardwareError after a retreat where something is wrong."""
        try:
            with suppress(StopIteration):
                action = next(actions)
                while True:
                    seen = self._done(action, watch)
                    watch.check()
                    action = actions.send(seen)
        except HardwareError as error:
            # The force may still be too large, and that must not stop the retreat.
            watch.end()
            trouble = watch.trouble or str(error)
            self._give_up(trouble)
            raise HardwareError(f"press at ({1e3 * at[0]:g}, {1e3 * at[1]:g}) mm: {trouble}") from error

    def _give_up(self, trouble: str) -> None:
        try:
            here = self._here()
        except HardwareError as error:
            raise HardwareError(
                f"{trouble}; and where the stage is is not known, lift it by hand: {error}"
            ) from error
        try:
            self._retreat(here)
        except HardwareError as error:
            raise HardwareError(
                f"{trouble}; and the retreat failed, lift the stage by hand: {error}"
            ) from error

    def _done(self, action: Action, watch: "_Watch") -> Seen:
        """Do an action."""
        gathering, force = self._gathering, np.nan
        match action:
            case Move(to, speed):
                self._go(to, speed)
            case Tare(seconds):
                watch.armed = False
                gathering.relabel(zero=gathering.reading(seconds))
                watch.armed = True
            case Feel(seconds):
                force = gathering.force(seconds)
            case Rest(seconds):
                gathering.reading(seconds)
            case Hold(level, seconds):
                average = min(AVERAGE_S, 0.5 * seconds)
                gathering.reading(seconds - average)
                force = gathering.force(average)
                watch.check()
                gathering.mark(level, force)
                depth = -self._stood().height
                self._samples.append((force, depth))
                gathering.remark(
                    f"press {gathering.label.press}, level {level}: {force:.2f} N, {1e3 * depth:.2f} mm deep"
                )
        return Seen(self._stood().height, force)

    def _go(self, to: Place, speed: float) -> None:
        target = self._origin + (to.x, to.y, to.height)
        there = self._stage.move_to(*target.tolist(), speed=speed)
        self._gathering.relabel(stage=there)

    def _here(self) -> Place:
        """Where the stage says that it is."""
        self._gathering.relabel(stage=self._stage.position())
        return self._stood()

    def _stood(self) -> Place:
        """Where it last said that it was."""
        return Place(*(np.array(self._gathering.label.stage) - self._origin).tolist())

    def _retreat(self, here: Place) -> None:
        """Straight up from there, if that is low."""
        if here.height < self._settings.clearance:
            self._go(Place(here.x, here.y, self._settings.clearance), self._settings.retreat_speed)


class _Watch(threading.Thread):
    """Stops the stage when the force is wrong."""

    def __init__(self, stage: GcodeStage, gathering: Gathering, force_limit: float) -> None:
        super().__init__(name="softfuse watch", daemon=True)
        self._stage, self._gathering, self._limit = stage, gathering, force_limit
        self._ended = threading.Event()
        self.armed = True
        self.trouble: str | None = None

    def run(self) -> None:
        while not self._ended.wait(WATCH_S):
            if not self.armed:
                continue
            trouble = self._gathering.trouble(self._limit)
            if trouble is not None:
                self.trouble = trouble
                try:
                    self._stage.stop()
                except HardwareError as error:
                    self.trouble = f"{trouble}; and the stage did not stop as it should: {error}"
                return

    def check(self) -> None:
        """HardwareError where the stage was stopped."""
        if self.trouble is not None:
            # The stop may still be under way.
            self.join()
            raise HardwareError(self.trouble)

    def end(self) -> None:
        """Watch no longer; back when a stop under way is over."""
        self._ended.set()
        if self.ident is not None:
            self.join()
