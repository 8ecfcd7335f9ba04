"""Recordings of a virtual finger that is pushed sideways: material for Table III of Navarro et al. 2020.

The finger (`virtual_finger`) is not the estimator's model; the tips are rigid and round, the contact has no
friction. Columns, k the cavity in the order of the drawing, e the electrode (segment 0 palm, left, right,
segment 1 ...), j the point, c = 0, 1 the tip:

| column | what |
|---|---|
| `time_s` | 100 Hz |
| `pressure{k}_V` | MPX5100A on a 12-bit converter of 5 V |
| `electrode{e}` | counts |
| `cable0_mm` | measured shortening of the cable |
| `press` | number of the push, from 0 |
| `sample` | 1, 2 ... where the first, second ... depth is held; in a push without tips 1 where the cable is |
| `true_p{j}_x_mm`, `_y_`, `_z_` | where the points are that rest at `FingerSettings.points` |
| `true_force{c}_N` | magnitude of a tip's force, 0 where there is none |
| `true_contact{c}_x_mm`, `_y_`, `_z_` | its centre of pressure; without force the middle of the patch |
| `true_contact{c}_electrode` | electrode that the tip faces, -1 where there is no tip |
| `true_depth_mm` | of the tips beyond first contact; negative before |
| `true_cable_mm`, `true_cable_N` | shortening and tension of the cable |
| `true_pressure{k}_Pa` | gauge pressure |

`true_` columns are for evaluation only.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float

from softfuse.body.body import Body
from softfuse.experiment.finger_electronics import Electronics, Readings, readings
from softfuse.experiment.finger_motion import Motion, Timing, motion
from softfuse.experiment.finger_pushes import FingerSolver, Push, Steps, equilibria
from softfuse.experiment.recording_file import Columns, write_recording
from softfuse.experiment.virtual_finger import FingerSettings, virtual_finger
from softfuse.mechanics.linear_solver import AbstractLinearSolver
from softfuse.mechanics.multifrontal import Multifrontal

_DEPTHS_M = (5e-3, 10e-3, 15e-3, 20e-3)
_DEPTHS_OF_TWO_M = (2e-3, 4e-3, 6e-3, 8e-3)

TABLE_III = tuple(
    Push(contacts=((segment, "left"),), cable=cable, depths=_DEPTHS_M)
    for segment in (3, 2)
    for cable in (0.0, 10e-3)
)
"""The tip segment (the paper's p0), then the third (p3), each without and with the cable."""

TWO_CONTACTS = (
    Push(((1, "left"), (3, "right")), 0.0, _DEPTHS_OF_TWO_M),
    # Bent by the cable, the finger finds no equilibrium between these tips beyond.
    Push(((1, "left"), (3, "right")), 10e-3, _DEPTHS_OF_TWO_M[:3]),
    Push(((2, "left"), (3, "palm")), 0.0, _DEPTHS_OF_TWO_M),
    Push(((1, "left"), (3, "palm")), 10e-3, _DEPTHS_OF_TWO_M[:3]),
)
"""Two tips at once on different segments."""

CABLE_ALONE = tuple(Push(cable=cable) for cable in (2.5e-3, 5e-3, 7.5e-3, 10e-3))
"""Nothing touches."""


@dataclass(frozen=True)
class BedSettings:
    """The finger, what is done to it, how fast, and what reads it."""

    pushes: tuple[Push, ...] = TABLE_III
    finger: FingerSettings = field(default_factory=FingerSettings)
    steps: Steps = field(default_factory=Steps)
    timing: Timing = field(default_factory=Timing)
    electronics: Electronics = field(default_factory=Electronics)

    @property
    def equilibria(self) -> int:
        """How many equilibria a recording takes."""
        return sum(equilibria(push, self.steps) for push in self.pushes)


def write_finger_recording(
    path: str | Path,
    settings: BedSettings,
    *,
    plan: Callable[[Body], AbstractLinearSolver] = Multifrontal.plan,
    solved: Callable[[], None] | None = None,
) -> None:
    """Push on a virtual finger and write the recording to path, compressed when that ends in .gz.

    plan: of the linear solver; `solved` is called after each of `settings.equilibria`. Raises ConfigError,
    MeshError or SolveError for a finger or a push that cannot be, RecordingError when the file cannot be
    written.
    """
    finger = virtual_finger(settings.finger)
    solver = FingerSolver(finger, settings.steps, plan=plan)
    passed = [(push, solver.poses(push, solved=solved)) for push in settings.pushes]
    moved = motion(passed, settings.timing)
    radius, half = settings.finger.tip_radius, settings.finger.electrode_half
    read = readings(settings.electronics, moved.time, moved.poses, radius, half)
    write_recording(path, recording_columns(moved, read))


def recording_columns(moved: Motion, read: Readings) -> Columns:
    """The columns of n frames and their readings, in the units that the names say."""
    columns: dict[str, tuple[int, np.ndarray]] = {"time_s": (3, moved.time)}
    for k, volts in enumerate(read.pressure_V.T):
        columns[f"pressure{k}_V"] = (5, volts)
    for e, counts in enumerate(read.electrode.T):
        columns[f"electrode{e}"] = (0, counts)
    columns["cable0_mm"] = (3, 1e3 * read.cable)
    return columns | truth_columns(moved)


def truth_columns(moved: Motion) -> Columns:
    """The same of the columns that no sensor writes."""
    poses = moved.poses
    columns: dict[str, tuple[int, np.ndarray]] = {"press": (0, moved.press), "sample": (0, moved.sample)}
    for j in range(poses.points.shape[1]):
        columns |= _place(f"true_p{j}", poses.points[:, j])
    for c in range(poses.force.shape[1]):
        columns[f"true_force{c}_N"] = (5, poses.force[:, c])
    for c in range(poses.force.shape[1]):
        columns |= _place(f"true_contact{c}", poses.contact[:, c])
        columns[f"true_contact{c}_electrode"] = (0, moved.electrode[:, c])
    columns["true_depth_mm"] = (4, 1e3 * poses.depth)
    columns["true_cable_mm"] = (4, 1e3 * poses.cable)
    columns["true_cable_N"] = (5, poses.tension)
    for k, pressure in enumerate(poses.gauge.T):
        columns[f"true_pressure{k}_Pa"] = (2, pressure)
    return columns


def _place(name: str, position: Float[np.ndarray, "n 3"]) -> dict[str, tuple[int, np.ndarray]]:
    return {f"{name}_{axis}_mm": (4, 1e3 * position[:, i]) for i, axis in enumerate("xyz")}
