"""Touches of a virtual pad: what its cavities and its electrodes do, at some gaps and under some forces.

Volumes are those of equilibria, and electrodes say what `pad_electrodes` make of these and of the punch.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float

from softfuse.body.body import Body
from softfuse.errors import ConfigError
from softfuse.experiment.pad_electrodes import AbstractPadElectrodes
from softfuse.experiment.virtual_finger import Carried
from softfuse.experiment.virtual_pad import PadPose, PadSettings, PadSolver, Touch, virtual_pad
from softfuse.mechanics.linear_solver import AbstractLinearSolver
from softfuse.mechanics.multifrontal import Multifrontal


@dataclass(frozen=True, eq=False)
class PadTouches:
    """t touches, each at g gaps of air and l forces, of k cavities and e electrodes.

    at (t, 2) m; gap (g,) m, increasing from 0; near (t, g, e): what the electrodes say, in their unit, under
    the punch at these gaps; force (t, l) N, increasing from 0, depth (t, l) m, volume (t, l, k) m³: changes,
    pressed (t, l, e): what the electrodes say, at these forces.
    """

    at: Float[np.ndarray, "t 2"]
    gap: Float[np.ndarray, " g"]
    near: Float[np.ndarray, "t g e"]
    force: Float[np.ndarray, "t l"]
    depth: Float[np.ndarray, "t l"]
    volume: Float[np.ndarray, "t l k"]
    pressed: Float[np.ndarray, "t l e"]


class PadBed:
    """A virtual pad under a punch; one program is compiled for all touches, from any thread."""

    def __init__(
        self,
        settings: PadSettings,
        electrodes: AbstractPadElectrodes,
        gaps: Sequence[float],
        *,
        plan: Callable[[Body], AbstractLinearSolver] = Multifrontal.plan,
    ) -> None:
        """gaps: increasing, in m, the first of them 0; plan: of the linear solver.

        Raises ConfigError or MeshError for a pad that cannot be.
        """
        pad = virtual_pad(settings)
        self._electrodes, self._gaps = electrodes, tuple(gaps)
        self._top = np.array([0.0, 0.0, settings.drawing.size[2]])
        self._carried = Carried.of(pad.body, electrodes.points + self._top)
        self._solver = PadSolver(pad, plan=plan)

    def touched(self, touch: Touch, *, solved: Callable[[], None] | None = None) -> PadTouches:
        """One touch, at all gaps and under all its forces; `solved` is called after each equilibrium.

        Raises ConfigError for a punch that overhangs, SolveError when an equilibrium is not found.
        """
        poses = self._solver.poses(touch, solved=solved)
        near = [self._electrodes.near(touch.at, gap) for gap in self._gaps]
        pressed = [near[0]] + [
            self._electrodes.pressed(touch.at, pose, self._carried.at(pose.nodes) - self._top)
            for pose in poses[1:]
        ]

        def of_poses(value: Callable[[PadPose], float | np.ndarray]) -> np.ndarray:
            return np.array([[value(pose) for pose in poses]])

        return PadTouches(
            at=np.array([touch.at]),
            gap=np.array(self._gaps),
            near=np.array([near]),
            force=of_poses(lambda pose: pose.force),
            depth=of_poses(lambda pose: pose.depth),
            volume=of_poses(lambda pose: pose.volume),
            pressed=np.array([pressed]),
        )


def pad_touches(bed: PadBed, touches: Sequence[Touch]) -> PadTouches:
    """All touches, which must have as many forces each; raises what `PadBed.touched` raises."""
    check_forces(touches)
    return one_after_the_other([bed.touched(touch) for touch in touches])


def check_forces(touches: Sequence[Touch]) -> None:
    """Raises ConfigError unless all touches have as many forces."""
    counts = {len(touch.forces) for touch in touches}
    if len(counts) != 1:
        raise ConfigError(
            f"touches with {sorted(counts)} forces: give one or more touches, with as many each"
        )


def one_after_the_other(parts: Sequence[PadTouches]) -> PadTouches:
    """The touches of all parts, which have the same gaps and as many forces."""
    arrays = {
        each.name: np.concatenate([getattr(part, each.name) for part in parts])
        for each in fields(PadTouches)
        if each.name != "gap"
    }
    return PadTouches(gap=parts[0].gap, **arrays)
