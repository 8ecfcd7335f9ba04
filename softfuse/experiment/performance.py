"""What a virtual robot's channels say in time, and the truth: a programme for boards, or a recording.

Truth, for evaluation only, c the slot of a contact where there are several, else left out:

| column | what |
|---|---|
| `press` | number of the episode, from 0 |
| `sample` | 1, 2 ... at one row in the middle of the hold of the first, second ... force, else 0 |
| `true_x{c}_mm`, `true_y{c}_mm`, `true_z{c}_mm` | place of the contact on the body at rest; empty where there is none |
| `true_force{c}_N`, `true_depth{c}_mm` | its force, and how far it is below the surface; negative in the air |
| `true_<point>_x_mm`, `_y_`, `_z_` | where the named points are |
| `true_<cable>_mm`, `true_<cable>_N` | shortening and tension |
| `true_<chamber>_mm3`, `true_<chamber>_Pa` | change of volume, and gauge pressure of one that is not vented |
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from softfuse.experiment.episodes import Episode, episodes_of
from softfuse.experiment.equilibria import RobotSolver, kept_poses
from softfuse.experiment.programme import Programme
from softfuse.experiment.recording_file import Columns, with_decimals
from softfuse.experiment.timeline import Frames, Timing, frames
from softfuse.experiment.virtual_robot import MakingErrors, VirtualRobot, virtual_robot
from softfuse.robot.robot import require_sensors
from softfuse.robot.settings import RobotSettings
from softfuse.sensors.electronics import ChannelElectronics, equal_channels, side_by_side

_COMMANDED_STEP = 1e-6
"""Step in which commands are told, in the units of their columns."""

_SHOWN = 4
"""Episodes of a virtual device."""


@dataclass(frozen=True, eq=False)
class Performance:
    """A virtual robot, the episodes that it goes through, and the rows of these."""

    robot: VirtualRobot
    episodes: tuple[Episode, ...]
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
        return Programme(step, made.settings.channels, readings, self.truth(), frozenset({"press", "sample"}))

    def electronics(self, seed: int) -> ChannelElectronics:
        """What real sensors, drawn from a seed, make of the programme's channels."""
        made = self.robot.made
        rng = np.random.default_rng(np.random.SeedSequence([seed, 0]))
        parts = [sensor.electronics(made.parts, rng) for sensor in made.settings.sensors]
        return side_by_side([*parts, equal_channels(len(made.commands), noise=0.0, step=_COMMANDED_STEP)])

    def recording(self, seed: int) -> Columns:
        """All rows as real sensors, drawn from a seed, say them, with the truth."""
        made, time = self.robot.made, self.frames.time_s
        columns = {"time_s": time}
        for k, sensor in enumerate(made.settings.sensors):
            raw = sensor.simulate(made.parts, time, self.true(sensor.name), (seed, k))
            columns |= dict(zip(sensor.columns, raw.T, strict=True))
        truth = with_decimals(self.truth() | {"time_s": time})
        said = {name: (None, values) for name, values in (columns | self.commands).items()}
        return {"time_s": truth.pop("time_s")} | {k: v for k, v in said.items() if k != "time_s"} | truth

    def truth(self) -> dict[str, Float[np.ndarray, " n"]]:
        """The columns that no sensor writes (n,)."""
        found, made = self.frames, self.robot.made
        values, settings = found.values, made.settings
        columns = {"press": found.episode, "sample": found.sample}
        places = np.stack([self._places(episode) for episode in self.episodes])[found.episode]
        count = len(made.workspaces)
        for c in range(count):
            name = "" if count == 1 else str(c)
            columns |= {f"true_{axis}{name}_mm": 1e3 * places[:, c, i] for i, axis in enumerate("xyz")}
            columns[f"true_force{name}_N"] = values["force"][:, c]
            columns[f"true_depth{name}_mm"] = -1e3 * values["gap"][:, c]
        for j, point in enumerate(settings.points):
            here = 1e3 * values["point"][:, j]
            columns |= {f"true_{point.name}_{axis}_mm": here[:, i] for i, axis in enumerate("xyz")}
        drives = made.addresses.drives
        for cable in settings.cables:
            columns[f"true_{cable.name}_mm"] = 1e3 * values["answer"][:, drives[cable.name]]
            columns[f"true_{cable.name}_N"] = values["drive"][:, drives[cable.name]]
        for k, chamber in enumerate(settings.chambers):
            columns[f"true_{chamber.name}_mm3"] = 1e9 * values["volume"][:, k]
            if chamber.gas != "vented":
                pressure = "answer" if chamber.gas == "sealed" else "drive"
                columns[f"true_{chamber.name}_Pa"] = values[pressure][:, drives[chamber.name]]
        return columns

    def _places(self, episode: Episode) -> Float[np.ndarray, "c 3"]:
        """Where each slot's contact presses (c, 3) m, NaN where there is none."""
        places, slots = np.full((len(self.robot.made.workspaces), 3), np.nan), self.robot.made.addresses.slots
        taken = dict.fromkeys(slots, 0)
        for touch in episode.touches:
            places[slots[touch.contact].start + taken[touch.contact]] = touch.place[0]
            taken[touch.contact] += 1
        return places


def performance(
    robot: VirtualRobot,
    episodes: Sequence[Episode],
    *,
    folder: Path | None,
    timing: Timing = Timing(),
    solved: Callable[[], None] | None = None,
) -> Performance:
    """A virtual robot that goes through episodes; `folder`, `solved`: see `kept_poses`, which also says what it
    raises.
    """
    return Performance(robot, tuple(episodes), frames(kept_poses(folder, robot, episodes, solved=solved), timing))


def shown(settings: RobotSettings, *, folder: Path | None) -> Performance:
    """A few episodes of a virtual robot with sensors, always the same; ConfigError for one without."""
    require_sensors(settings)
    robot = virtual_robot(settings, MakingErrors())
    return performance(robot, random_episodes(robot, _SHOWN, seed=0), folder=folder)


def random_episodes(robot: VirtualRobot, count: int, *, seed: int) -> tuple[Episode, ...]:
    """So many episodes at random, see `episodes_of`."""
    return episodes_of(robot.made, count, reach=RobotSolver(robot).reach(), seed=seed)
