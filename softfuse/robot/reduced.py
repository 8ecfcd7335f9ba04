"""Local reduced models of a robot: where each is good, and how it is trained."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.errors import ConfigError, SolveError
from softfuse.mechanics.model import Model, simulate
from softfuse.mechanics.solution import RESULTS
from softfuse.robot.digest import digest
from softfuse.robot.robot import Robot
from softfuse.robot.settings import RobotSettings
from softfuse.rom.basis import RestStiffness
from softfuse.rom.cells import AbstractRegions, Cells, Spots
from softfuse.rom.load_paths import LoadPath, load_paths
from softfuse.rom.rom_file import Atlas, AtlasFolder
from softfuse.rom.snapshots import LoadsAt
from softfuse.rom.teaching import Chart, ChartSettings, teach

_REVISION = 8
"""To be raised when other charts come of the same settings."""

_LIGHT = 1e-2
"""Of the largest force: so little that a body answers to it as at rest."""


def build_regions(config: RobotSettings) -> AbstractRegions:
    """The cells of a flat workspace, or the places that have a name.

    Raises ConfigError when there is not one contact, or one that presses neither in a workspace nor at named
    places.
    """
    contact = config.contact()
    if contact.direction is None:
        if not config.places:
            raise ConfigError(
                f"{config.path}: contact: charts are taught in a flat workspace or at places of electrodes, "
                "and this one presses anywhere on a surface: estimate without charts, or give it a direction "
                "and a workspace"
            )
        return Spots(np.array(list(config.places.values())))
    low, high = (tuple(end.tolist()) for end in contact.ranges)
    return Cells.over(low, high, config.reduction.cell, contact.direction)


def reduction_mark(config: RobotSettings) -> str:
    """What tells two reduced robots apart: a digest of all settings that have a say."""
    parts = {"body", "environment", "chambers", "cables", "contacts", "sensors", "reduction"}
    return f"{_REVISION}-{digest(config, parts)}"


def with_charts(robot: Robot, folder: Path | None) -> Model | Atlas:
    """The reduced models of a folder that were made of the robot; its own model without a folder.

    Raises ConfigError as `build_regions`, SoftfuseError when a reduced model is missing, damaged or another
    robot's.
    """
    if folder is None:
        return robot.model
    settings = robot.settings
    return Atlas(robot.model, build_regions(settings), AtlasFolder(folder, reduction_mark(settings)))


@dataclass(frozen=True, eq=False)
class Teacher:
    """Makes the charts of a robot, whose body has that stiffness at rest."""

    robot: Robot
    stiffness: RestStiffness
    regions: AbstractRegions

    @property
    def model(self) -> Model:
        """The full model."""
        return self.robot.model

    @property
    def config(self) -> RobotSettings:
        """The robot's settings."""
        return self.robot.settings

    @cached_property
    def _loads_at(self) -> LoadsAt:
        # One function for all charts: programs are compiled anew for every other one.
        return lambda body, places: replace(self.model, body=body).loads(places)

    def chart(self, number: int) -> Chart:
        """The chart of a region; raises SolveError as `teach` and `largest_force` do."""
        given = self.config.reduction
        paths, around = self._lesson(number)
        return teach(
            self.model.linear,
            self.model.body.full,
            self.stiffness,
            self._loads_at,
            paths,
            around=around,
            settings=ChartSettings(given.displacements, given.pressures, given.sampling, given.points),
        )

    def largest_force(self, number: int) -> float:
        """The largest force [N] of a contact that a region's chart is good for.

        Raises SolveError when the body has no equilibrium under a hundredth of the contact's `max_force`.
        """
        contact, travel = self.config.contact(), self.config.reduction.travel
        if travel is None:
            return contact.max_force
        place, drives = jnp.asarray(self.regions.middle(number))[None], self.model.contacts[0].drives
        force = _LIGHT * contact.max_force
        share = contact.bounds[0] >= 0  # what may be of either sign pushes aside
        drive = self.model.rest_state(place).drive.at[:drives].set(force * share / share.sum())
        found = simulate(self.model, place, drive)
        if found.result != RESULTS.converged:
            raise SolveError(f"region {number}: no equilibrium at {force:g} N: {RESULTS[found.result]}")
        shape = self.model.body.displacement(found.state.z)
        moved = float(jnp.max(jnp.linalg.norm(shape, axis=1)))
        return min(contact.max_force, travel * force / moved)

    def _lesson(self, number: int) -> tuple[list[LoadPath], list[Array]]:
        """The load paths in a region, and places (1, ...) all over it."""
        given, contact, pushes = self.config.reduction, self.config.contact(), self.model.contacts[0]
        part = self.largest_force(number) / contact.max_force
        low, high = (
            np.append(part * force, own) for force, own in zip(contact.bounds, self._drives, strict=True)
        )
        paths = load_paths(
            self.regions.parts(number, given.side),
            pushes.drives,
            low,
            high,
            levels=given.levels,
            near=given.near,
        )
        body = self.model.body
        discs = pushes.discs(body, jnp.asarray(self.regions.middle(number)))
        around = self.regions.around(number, discs, np.asarray(body.rest))
        return paths, [jnp.asarray(place)[None] for place in around]

    @property
    def _drives(self) -> tuple[Float[np.ndarray, " a"], Float[np.ndarray, " a"]]:
        """Between what the actuators are driven (a,)."""
        low, high = self.robot.ranges
        for cable in self.config.cables:
            at = self.robot.addresses.drives[cable.name]
            high[at] = min(high[at], self.config.reduction.tension or np.inf)
        return low, high
