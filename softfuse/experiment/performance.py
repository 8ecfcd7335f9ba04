"""What a virtual robot's channels say in time, and the truth: a programme for boards, or a recording.

Truth, for evaluation only; names as in `robot.names`, <slot> of each contact that may touch at once:

| column | what |
|---|---|
| `press` | number of the episode, from 0 |
| `sample` | 1, 2 ... at one row in the middle of the hold of the first, second ... force, else 0 |
| `true_x_mm`, `true_y_mm`, `true_z_mm` | place of the only contact on the body at rest; empty without one |
| `true_force_N` | its force |
| `true_<slot>_x_mm` ..., `true_<slot>_force_N` | the same of each of several |
| `true_<slot>_place` | number of the place with a name that is nearest, -1 where there is no contact |
| `true_depth_mm` | how far what presses is below the surface; negative in the air |
| `true_<point>_x_mm`, `_y_`, `_z_` | where the named points are |
| `true_<cable>_mm`, `true_<cable>_N` | shortening and tension |
| `true_<chamber>_mm3`, `true_<chamber>_Pa` | change of volume, and gauge pressure of one that is not vented |
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from softfuse.errors import ConfigError
from softfuse.experiment.episodes import Episode, episodes_of
from softfuse.experiment.equilibria import RobotSolver, kept_poses
from softfuse.experiment.recording_file import Columns, with_decimals
from softfuse.experiment.timeline import Frames, Timing, frames
from softfuse.experiment.virtual_robot import MakingErrors, VirtualRobot, virtual_robot
from softfuse.robot.names import named_places, safe_names, slot_names
from softfuse.robot.robot import require_sensors
from softfuse.robot.settings import RobotSettings
from softfuse.sensors.electronics import ChannelElectronics, equal_channels, side_by_side

_ROUNDING = 1e-6
"""Rows by which a time may be off."""

_COMMANDED_STEP = 1e-6
"""Step in which commands are told, in the units of their columns."""

_SHOWN = 4
"""Episodes of a virtual robot."""


@dataclass(frozen=True, eq=False)
class Programme:
    """What a robot's channels say, without noise, while something is done to it over and over again.

    n rows of k channels, one every `step_s`, interpolated linearly and continued periodically: the last row
    is followed by the first. Noise and converters are in `channel_electronics`.

    channels: columns of a recording, whose names end with the unit; readings (n, k) in these units. truth:
    other columns (n,) in the units of their names; those in `stepped` are counts and marks that hold until
    the next row.
    """

    step_s: float
    channels: tuple[str, ...]
    readings: Float[np.ndarray, "n k"]
    truth: Mapping[str, Float[np.ndarray, " n"]]
    stepped: frozenset[str] = frozenset()

    @property
    def period_s(self) -> float:
        """After which it begins anew [s]."""
        return self.step_s * len(self.readings)

    def at(self, time_s: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m k"]:
        """Readings (m, k) at times (m,) s, counted from the start of the first round."""
        before, after, share = self._rows(time_s)
        return (1.0 - share[:, None]) * self.readings[before] + share[:, None] * self.readings[after]

    def truth_at(self, time_s: Float[np.ndarray, " m"]) -> dict[str, Float[np.ndarray, " m"]]:
        """Truth (m,) at times (m,) s, counted from the start of the first round."""
        before, after, share = self._rows(time_s)
        last = np.floor(np.asarray(time_s) / self.step_s + _ROUNDING).astype(np.int64) % len(self.readings)
        return {
            name: values[last]
            if name in self.stepped
            else (1.0 - share) * values[before] + share * values[after]
            for name, values in self.truth.items()
        }

    def only(self, channels: Sequence[str]) -> "Programme":
        """The same with some of its channels, in the order given."""
        columns = [self.channels.index(name) for name in channels]
        return Programme(self.step_s, tuple(channels), self.readings[:, columns], self.truth, self.stepped)

    def _rows(
        self, time_s: Float[np.ndarray, " m"]
    ) -> tuple[Int[np.ndarray, " m"], Int[np.ndarray, " m"], Float[np.ndarray, " m"]]:
        row = np.asarray(time_s, float) / self.step_s
        before = np.floor(row).astype(np.int64)
        count = len(self.readings)
        return before % count, (before + 1) % count, row - before


@dataclass(frozen=True, eq=False)
class Performance:
    """A virtual robot and the rows of episodes that it goes through; `places` (e, c, 3) m: where on the body
    at rest each slot's contact presses in each episode, NaN where there is none.
    """

    robot: VirtualRobot
    places: Float[np.ndarray, "e c 3"]
    frames: Frames

    @property
    def commands(self) -> dict[str, Float[np.ndarray, " n"]]:
        """What actuators are commanded to (n,), in the units of the columns, by their names."""
        values = self.frames.values
        return {
            each.channel: values["answer" if each.of_answer else "drive"][:, each.drive] / each.factor
            for each in self.robot.made.commands
        }

    def true(self, sensor: str) -> Float[np.ndarray, "n k"]:
        """The true readings (n, k) of a sensor [SI], or what those that see contacts could see."""
        values, readings = self.frames.values, self.robot.made.addresses.readings
        return values["reading"][:, readings[sensor]] if sensor in readings else values[f"signal {sensor}"]

    def programme(self) -> Programme:
        """What nominal sensors say, and the truth; in the order of the settings' channels."""
        made, time = self.robot.made, self.frames.time_s
        said = [sensor.ideal(made.parts, time, self.true(sensor.name)) for sensor in made.settings.sensors]
        readings = np.concatenate([*said, *(each[:, None] for each in self.commands.values())], axis=1)
        step = float(time[1] - time[0])
        truth = self.truth()
        marks = {name for name in truth if name in ("press", "sample") or name.endswith("_place")}
        return Programme(step, made.settings.channels, readings, truth, frozenset(marks))

    @property
    def apart(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """The channels of sensors that see contacts, and all others; ConfigError when either are none."""
        made = self.robot.made
        sees = {sensor.name for sensor in made.suite.contact_sensors}
        seeing = tuple(name for each in made.settings.sensors if each.name in sees for name in each.columns)
        others = tuple(name for name in made.settings.channels if name not in seeing)
        if not seeing or not others:
            raise ConfigError(
                f"{made.settings.path}: sensor: for two boards, some see contacts and some do not"
            )
        return seeing, others

    def electronics(self, seed: int) -> ChannelElectronics:
        """What real sensors, drawn from a seed, make of the programme's channels."""
        made = self.robot.made
        rng = np.random.default_rng(np.random.SeedSequence([seed, 0]))
        parts = [sensor.electronics(made.parts, rng) for sensor in made.settings.sensors]
        return side_by_side([*parts, equal_channels(len(made.commands), noise=0.0, step=_COMMANDED_STEP)])

    def boards(self, count: int, seed: int) -> list[tuple[str, Programme, ChannelElectronics]]:
        """Name, programme and electronics of one board, or of two as they are `apart`."""
        programme, electronics, name = self.programme(), self.electronics(seed), self.robot.made.name
        names = [name] if count == 1 else [f"{name} contacts", f"{name} readings"]
        parts = [programme.channels] if count == 1 else self.apart
        return [
            (each, programme.only(own), electronics.taken([programme.channels.index(one) for one in own]))
            for each, own in zip(names, parts, strict=True)
        ]

    def recording(self, seed: int, noise: int, *, gain: float = 0.0) -> Columns:
        """All rows as real sensors drawn from a seed say them, with noise from another, and the truth; by the
        part `gain` changes of readings are off at most, besides what data sheets of the sensors say.
        """
        made, time = self.robot.made, self.frames.time_s
        columns = {"time_s": time}
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1,)))
        for k, sensor in enumerate(made.settings.sensors):
            true = self.true(sensor.name)
            if sensor.name in made.addresses.readings:
                true = true + rng.uniform(-gain, gain, true.shape[1]) * (true - true[0])
            raw = sensor.simulate(made.parts, time, true, (seed, k), (seed, noise, k))
            columns |= dict(zip(sensor.columns, raw.T, strict=True))
        truth = with_decimals(self.truth() | {"time_s": time})
        said = {name: (None, values) for name, values in (columns | self.commands).items()}
        return {"time_s": truth.pop("time_s")} | {k: v for k, v in said.items() if k != "time_s"} | truth

    def truth(self) -> dict[str, Float[np.ndarray, " n"]]:
        """The columns that no sensor writes (n,)."""
        found, made = self.frames, self.robot.made
        values, settings = found.values, made.settings
        columns = {"press": found.episode, "sample": found.sample}
        places, names = self.places, slot_names(settings.contacts)
        each = enumerate(contact for contact in settings.contacts for _ in range(contact.at_once))
        for c, contact in each:
            slot = "" if len(names) == 1 else f"{names[c]}_"
            at, force = 1e3 * places[found.episode, c], values["force"][:, c]
            columns |= {f"true_{slot}{axis}_mm": at[:, i] for i, axis in enumerate("xyz")}
            columns[f"true_{slot}force_N"] = force
            if named_places(settings, contact.name):
                nearest = _nearest(places[:, c], np.stack([place[0] for place in settings.places.values()]))
                columns[f"true_{names[c]}_place"] = nearest[found.episode]
                columns[f"true_{names[c]}_force_N"] = force
        if names:
            columns["true_depth_mm"] = -1e3 * values["gap"].min(axis=1)
        for name, here in zip(
            safe_names(point.name for point in settings.points).values(),
            np.moveaxis(values["point"], 1, 0),
            strict=True,
        ):
            columns |= {f"true_{name}_{axis}_mm": 1e3 * here[:, i] for i, axis in enumerate("xyz")}
        drives = made.addresses.drives
        for cable, name in safe_names(cable.name for cable in settings.cables).items():
            columns[f"true_{name}_mm"] = 1e3 * values["answer"][:, drives[cable]]
            columns[f"true_{name}_N"] = values["drive"][:, drives[cable]]
        safe = safe_names(chamber.name for chamber in settings.chambers)
        for k, chamber in enumerate(settings.chambers):
            name = safe[chamber.name]
            columns[f"true_{name}_mm3"] = 1e9 * values["volume"][:, k]
            if chamber.gas != "vented":
                pressure = "answer" if chamber.gas == "sealed" else "drive"
                columns[f"true_{name}_Pa"] = values[pressure][:, drives[chamber.name]]
        return columns


def _nearest(at: Float[np.ndarray, "e 3"], places: Float[np.ndarray, "p 3"]) -> Int[np.ndarray, " e"]:
    """The number of the nearest of some places (p, 3) m to each point (e, 3) m; -1 for one that is NaN."""
    apart = np.linalg.norm(at[:, None] - places, axis=-1)
    return np.where(np.isfinite(apart[:, 0]), np.argmin(np.nan_to_num(apart), axis=1), -1)


def performance(
    robot: VirtualRobot,
    episodes: Sequence[Episode],
    *,
    folder: Path | None,
    timing: Timing | None = None,
    solved: Callable[[], None] | None = None,
) -> Performance:
    """A virtual robot that goes through episodes; `folder`, `solved` and errors raised: see `kept_poses`."""
    found = kept_poses(folder, robot, episodes, solved=solved)
    return Performance(robot, places_of(robot, episodes), frames(found, timing or Timing()))


def places_of(robot: VirtualRobot, episodes: Sequence[Episode]) -> Float[np.ndarray, "e c 3"]:
    """Where each slot's contact presses in each episode (e, c, 3) m, NaN where there is none."""
    slots = robot.made.addresses.slots
    places = np.full((len(episodes), len(robot.made.workspaces), 3), np.nan)
    for here, episode in zip(places, episodes, strict=True):
        taken = {name: own.start for name, own in slots.items()}
        for touch in episode.touches:
            here[taken[touch.contact]] = touch.place[0]
            taken[touch.contact] += 1
    return places


def shown(settings: RobotSettings, *, folder: Path | None) -> Performance:
    """A few episodes of a virtual robot with sensors, always the same; ConfigError for one without."""
    require_sensors(settings)
    robot = virtual_robot(settings, MakingErrors())
    return performance(robot, random_episodes(robot, _SHOWN, seed=0), folder=folder)


def random_episodes(robot: VirtualRobot, count: int, *, seed: int) -> tuple[Episode, ...]:
    """So many episodes at random, see `episodes_of`."""
    return episodes_of(robot.made, count, reach=RobotSolver(robot).reach(), seed=seed)


def in_turn(parts: Sequence[Performance]) -> Performance:
    """What one robot has gone through, one after the other."""
    first, step = parts[0], float(np.diff(parts[0].frames.time_s[:2])[0])
    each = [part.frames for part in parts]
    starts = np.cumsum([0, *(len(part.places) for part in parts[:-1])])
    values = {name: np.concatenate([one.values[name] for one in each]) for name in each[0].values}
    episode = np.concatenate([one.episode + start for one, start in zip(each, starts, strict=True)])
    sample = np.concatenate([one.sample for one in each])
    rows = Frames(step * np.arange(len(sample)), episode, sample, values)
    return Performance(first.robot, np.concatenate([part.places for part in parts]), rows)
