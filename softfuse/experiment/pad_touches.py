"""Touches of a virtual pad: what its cavities and its electrodes do, at some gaps and under some forces.

Volumes are those of equilibria, and electrodes say what `pad_electrodes` make of these and of the punch.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from softfuse.body.body import Body
from softfuse.equilibrium.linear_solver import AbstractLinearSolver
from softfuse.equilibrium.multifrontal import Multifrontal
from softfuse.errors import ConfigError
from softfuse.experiment.pad_electrodes import AbstractPadElectrodes
from softfuse.experiment.virtual_finger import Carried
from softfuse.experiment.virtual_pad import PadPose, PadSettings, PadSolver, Touch, virtual_pad


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


def pad_touches(
    settings: PadSettings,
    electrodes: AbstractPadElectrodes,
    touches: Sequence[Touch],
    gaps: Sequence[float],
    *,
    plan: Callable[[Body], AbstractLinearSolver] = Multifrontal.plan,
    solved: Callable[[], None] | None = None,
) -> PadTouches:
    """Touch a virtual pad, with the punch at increasing gaps in m, the first of them 0, and under all forces.

    plan: of the linear solver; `solved` is called after each equilibrium. Raises ConfigError or MeshError for
    a pad or touches that cannot be, SolveError when an equilibrium is not found.
    """
    counts = {len(touch.forces) for touch in touches}
    if len(counts) != 1:
        raise ConfigError(
            f"touches with {sorted(counts)} forces: give one or more touches, with as many each"
        )
    pad = virtual_pad(settings)
    top = np.array([0.0, 0.0, settings.drawing.size[2]])
    carried = Carried.of(pad.body, electrodes.points + top)
    solver = PadSolver(pad, plan=plan)
    near, poses, pressed = [], [], []
    for touch in touches:
        poses.append(solver.poses(touch, solved=solved))
        near.append([electrodes.near(touch.at, gap) for gap in gaps])
        pressed.append(
            [near[-1][0]]
            + [electrodes.pressed(touch.at, pose, carried.at(pose.nodes) - top) for pose in poses[-1][1:]]
        )

    def gathered(value: Callable[[PadPose], float | np.ndarray]) -> np.ndarray:
        return np.array([[value(pose) for pose in each] for each in poses])

    return PadTouches(
        at=np.array([touch.at for touch in touches]),
        gap=np.array(gaps),
        near=np.array(near),
        force=gathered(lambda pose: pose.force),
        depth=gathered(lambda pose: pose.depth),
        volume=gathered(lambda pose: pose.volume),
        pressed=np.array(pressed),
    )
