"""The evaluation of Navarro et al. 2020: the robot of a test bed, and what is done to it.

The robot is made as the config draws it, but not as the estimator's model is (`virtual_robot`): its own mesh,
finer than that of configs/pad.toml and configs/finger.toml. A pad is pressed by a punch with a skin on a grid
of places at three forces (Tables I and II); a finger by rigid round tips from the left, with the cable and
without (Table III).
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from softfuse.errors import ConfigError
from softfuse.experiment.episodes import Episode, Touch, place_of
from softfuse.experiment.equilibria import arrays_of, kept_poses
from softfuse.experiment.paper.pushes import TABLE_III, Push, PushSolver, Steps, equilibria
from softfuse.experiment.paper.tips import Tips
from softfuse.experiment.performance import Performance, places_of
from softfuse.experiment.pose_cache import Arrays, kept, settings_digest
from softfuse.experiment.timeline import Timing, frames
from softfuse.experiment.virtual_robot import MakingErrors, VirtualRobot, virtual_robot
from softfuse.functional.workspace import FlatWorkspace
from softfuse.mesh.body_source import BlockSource
from softfuse.mesh.finger import FingerSource
from softfuse.robot.digest import digest
from softfuse.robot.settings import RobotSettings

_REACH = 28 / 30
"""How far the grid reaches from the middle of the workspace to its ends: 28 mm of 30 mm."""

_FITTED_TO = ((0.0, 0.0), (-0.6, -0.6), (-0.6, 0.6), (0.6, -0.6), (0.6, 0.6))
"""Where a pad is pressed to be calibrated, from the middle of the workspace to its ends (±1)."""

_LEVELS = (0.2, 0.4, 0.6)
"""Forces, as parts of the largest that the contact is made for."""

_PAD_MESH = (0.125, 0.15, 0.5)
"""Longest edge at the top and largest box of the grid under it, as parts of the pad's length, and growth."""

_FINGER_MESH = (0.05, 0.075, 2.0)
"""Longest edge at the cavities and largest box of the grid, as parts of the finger's length, and growth."""

_NECK = 0.2e-3
"""Bound of the error of the necks' height [m]."""

_LENGTH_M, _SEGMENTS = 0.12, 4
"""Length of the paper's finger, to which the depths of its pushes belong, and its segments."""

_FINGER_TIMING = Timing(rest_s=5.0, press_s=1.0, release_s=1.0)


@dataclass(frozen=True, eq=False)
class Bed:
    """A test bed: its robot, and each thing done to it, with a name; the first `fitted_to` of them are for
    calibration. `equilibria`: how many have to be found; `seed`: of everything that is drawn; `pushes`:
    whether rigid tips push; `played`: all of it, each thing by itself, its equilibria kept in a folder.
    """

    robot: VirtualRobot
    names: tuple[str, ...]
    fitted_to: int
    equilibria: int
    seed: int
    pushes: bool
    played: Callable[[Path | None, Callable[[], None] | None], list[Performance]]


def build_bed(settings: RobotSettings, *, grid: int, seed: int) -> Bed:
    """A block's presses on a grid of `grid` times `grid` places at three forces, or a finger's pushes.

    Raises ConfigError when the body is neither, or nothing may press on it.
    """
    source = settings.body.source
    if source.type == "finger":
        return finger_bed(settings, source, TABLE_III, seed=seed)
    if source.type == "pad" or source.type == "layout":
        return _pad_bed(settings, source, grid, seed)
    raise ConfigError(
        f'{settings.path}: body.source.type: the paper has pads and a finger: "pad", "layout", "finger"'
    )


def _pad_bed(settings: RobotSettings, source: BlockSource, grid: int, seed: int) -> Bed:
    surface, base, growth = _PAD_MESH
    length = max(source.size[:2])
    mesh = {"surface_size": surface * length, "base_size": base * length, "growth": growth, "fine_depth": 0.0}
    robot = virtual_robot(settings.meshed(mesh), MakingErrors(nodes=0, seed=seed))
    contact = settings.contact()
    workspace = robot.made.workspaces[0]
    if not isinstance(workspace, FlatWorkspace):
        raise ConfigError(f"{settings.path}: contact: a pad is pressed by a disc")
    along = _REACH * np.linspace(-1.0, 1.0, grid)
    middle, half = 0.5 * (workspace.low + workspace.high), 0.5 * (workspace.high - workspace.low)
    at = middle + half * np.array([*_FITTED_TO, *product(along, along)])
    forces = tuple(level * contact.max_force for level in _LEVELS)
    episodes = [
        Episode((Touch(contact.name, place_of(place), forces),))
        for place in np.asarray(workspace.chart.place(jnp.asarray(at)))
    ]
    names = [f"calibration_{k}" for k in range(len(_FITTED_TO))]
    names += [f"press_{k:03d}" for k in range(grid**2)]

    def played(folder: Path | None, solved: Callable[[], None] | None) -> list[Performance]:
        found = kept_poses(folder, robot, episodes, solved=solved)
        return [
            Performance(robot, places_of(robot, [episode]), frames([poses]))
            for episode, poses in zip(episodes, found, strict=True)
        ]

    return Bed(robot, tuple(names), len(_FITTED_TO), len(episodes) * len(forces), seed, False, played)


def finger_bed(settings: RobotSettings, source: FingerSource, pushes: tuple[Push, ...], *, seed: int) -> Bed:
    """Pushes on the last segments of a finger, as deep for its length as they are for the paper's.

    Raises ConfigError for a finger without one cable, or without electrodes to say where its segments are.
    """
    length, rng = source.size[0], np.random.default_rng((seed, 1))
    wall, base, growth = _FINGER_MESH
    neck = source.neck_height + rng.uniform(-_NECK, _NECK)
    mesh = {"wall_size": wall * length, "base_size": base * length, "growth": growth, "neck_height": neck}
    robot = virtual_robot(settings.meshed(mesh), MakingErrors(nodes=0, stiffness=0.0, seed=seed))
    middles = sorted({round(float(place[0, 0]), 9) for place in settings.places.values()})
    if not middles:
        raise ConfigError(f"{settings.path}: sensor: a finger is pushed where it has electrodes")
    tips, steps = Tips(source.size, tuple(middles)), Steps()
    scale, last = length / _LENGTH_M, len(middles) - _SEGMENTS
    moved = tuple(
        Push(
            tuple((max(last + segment, 0), side) for segment, side in push.contacts),
            scale * push.cable,
            tuple(scale * depth for depth in push.depths),
        )
        for push in pushes
    )
    names = tuple(f"push_{k}" for k in range(len(moved)))

    def played(folder: Path | None, solved: Callable[[], None] | None) -> list[Performance]:
        solver = PushSolver(robot, tips, steps)
        files = [
            f"push-{settings_digest(digest(robot.drawn), robot.errors, tips, steps, push)}" for push in moved
        ]

        def start() -> Callable[[int], Arrays]:
            return lambda k: solver.poses(moved[k], solved=solved)

        found = kept(folder, files, arrays_of(robot), start)
        return [
            Performance(robot, solver.places(push)[None], frames([poses], _FINGER_TIMING))
            for push, poses in zip(moved, found, strict=True)
        ]

    return Bed(robot, names, 0, sum(equilibria(push, steps) for push in moved), seed, True, played)
