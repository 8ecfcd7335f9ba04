"""From settings to a virtual finger that is pushed from the left and bent by its cable."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from softfuse.errors import ConfigError
from softfuse.experiment.finger_electronics import Electronics
from softfuse.experiment.finger_motion import Timing, motion
from softfuse.experiment.finger_programme import finger_channels, finger_programme
from softfuse.experiment.finger_pushes import Pose, Push, Steps
from softfuse.experiment.kept_poses import kept_finger_poses
from softfuse.experiment.programme import Programme
from softfuse.experiment.virtual_finger import SIDES, FingerSettings, Side, electrode_index
from softfuse.mesh.finger import FingerGeometry
from softfuse.robot.body import FingerSource
from softfuse.robot.points import ElectrodePlace
from softfuse.robot.settings import RobotSettings
from softfuse.sensors.electronics import ChannelElectronics

_INTO: dict[Side, tuple[float, float, float]] = {
    "palm": (0.0, 0.0, 1.0),
    "left": (0.0, -1.0, 0.0),
    "right": (0.0, 1.0, 0.0),
}
"""Direction into the finger of the electrodes of each side."""

_PUSH, _PULL = 0.04, 0.04
"""Depth of pushes and shortening of the cable, as parts of the length; also the steps between equilibria."""

_MESH = (1 / 6, 1 / 4, 9.0)
"""Longest edge at the cavities and largest box of the grid, as parts of the length, and growth."""

_PATCH_POINTS = (7, 2)
"""Points along and across at which a tip meets the finger; the time for an equilibrium grows with them."""


@dataclass(frozen=True, eq=False)
class FingerPlan:
    """What is to be computed, and how it is read."""

    settings: FingerSettings
    pushes: tuple[Push, ...]
    steps: Steps
    parts: Electronics
    channels: tuple[str, ...]
    electrodes: tuple[str, ...]
    numbers: tuple[int, ...]

    def programme(self, folder: Path | None) -> Programme:
        """The programme of all pushes; see `build_virtual`."""
        return self._of(kept_finger_poses(folder, self.settings, self.steps, self.pushes))

    def programmes(self, folder: Path | None, *, solved: Callable[[], None] | None = None) -> list[Programme]:
        """A programme of each push; see `kept_finger_poses`."""
        found = kept_finger_poses(folder, self.settings, self.steps, self.pushes, solved=solved)
        return [self._of([passed]) for passed in found]

    def _of(self, passed: Sequence[tuple[Push, Sequence[Pose]]]) -> Programme:
        moved = motion(passed, Timing())
        radius, half = self.settings.tip_radius, self.settings.electrode_half
        return finger_programme(moved, self.parts, radius, half, self.channels, self.numbers)

    def electronics(self, seed: int) -> ChannelElectronics:
        """The programme's channels."""
        pressures = len(self.settings.drawing.cavity_centres)
        return finger_channels(self.parts, pressures, len(self.electrodes), seed)


def finger_plan(
    config: RobotSettings, source: FingerSource, shear_modulus: float, poisson: float
) -> FingerPlan:
    """The plan for a finger of a shear modulus [Pa] and Poisson's ratio [-].

    Raises ConfigError unless it has one cable that is measured, gas, an MPX5100A on each cavity without a
    column of its supply, and electrodes on palm, left and right.
    """
    sensors, gas = config.sensors, config.gas
    assert sensors is not None
    pressure, electrodes = sensors.pressure, sensors.electrodes
    if len(config.cables) != 1 or sensors.cable is None:
        raise ConfigError(f"{config.path}: sensors.cable: a virtual finger has one cable, and it is measured")
    if pressure.type != "MPX5100A" or pressure.reference_channel is not None:
        raise ConfigError(
            f"{config.path}: sensors.pressure: a virtual finger has MPX5100A, and no column of the supply"
        )
    assert gas is not None  # pressures are only read from sealed cavities
    volumes = set(gas.dead_volume)
    if len(volumes) > 1:
        raise ConfigError(f"{config.path}: gas.dead_volume: a virtual finger has one for all cavities")
    drawing = FingerGeometry(
        size=source.size,
        neck_x=source.neck_x,
        neck_length=source.neck_length,
        neck_height=source.neck_height,
        cavity_size=source.cavity_size,
        cavity_centres=tuple(cavity.centre for cavity in config.cavities),
    )
    middles = sorted({electrode.centre[0] for electrode in config.electrodes})
    length, (cable,) = source.size[0], config.cables
    wall, base, growth = _MESH
    last = len(middles) - 1
    depth, pull = _PUSH * length, _PULL * length
    return FingerPlan(
        FingerSettings(
            drawing=drawing,
            shear_modulus=shear_modulus,
            poisson=poisson,
            wall_size=wall * length,
            base_size=base * length,
            growth=growth,
            guides=cable.guides,
            pulled_at=cable.pulled_at,
            anchor_radius=cable.anchor_radius,
            dead_volume=volumes.pop(),
            segment_x=tuple(middles),
            patch_points=_PATCH_POINTS,
            points=tuple(point.at for point in config.points),
        ),
        (
            # As many tips each time: a program is compiled for each number of them.
            Push(((last, "left"),), 0.0, (depth, 2.0 * depth)),
            Push(((max(last - 1, 0), "left"),), pull, (depth,)),
        ),
        Steps(cable=pull, depth=depth),
        Electronics(
            atmosphere_Pa=gas.atmosphere,
            supply_V=pressure.reference,
            pressure_noise_V=pressure.noise,
            electrode_noise_counts=electrodes.noise_counts,
            cable_noise_m=sensors.cable.noise,
        ),
        (*pressure.channels, *electrodes.channels, *sensors.cable.channels),
        electrodes.channels,
        tuple(_number(config, k, middles, electrode) for k, electrode in enumerate(config.electrodes)),
    )


def _number(config: RobotSettings, k: int, middles: Sequence[float], electrode: ElectrodePlace) -> int:
    """Number of a config's electrode on the virtual finger."""
    direction = np.array(electrode.direction) / np.linalg.norm(electrode.direction)
    for side in SIDES:
        if np.allclose(direction, _INTO[side], atol=1e-6):
            return electrode_index(middles.index(electrode.centre[0]), side)
    raise ConfigError(
        f"{config.path}: electrode[{k}].direction: a virtual finger has electrodes on palm, left and right: "
        "[0, 0, 1], [0, -1, 0] or [0, 1, 0]"
    )
