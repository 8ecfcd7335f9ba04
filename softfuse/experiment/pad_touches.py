"""Touches of a virtual pad: what its cavities and its electrodes do, at some gaps and under some forces.

Volumes are those of equilibria, capacitances those of the field of the grounded punch. Pressed in, the punch
takes the electrodes below it along; those around it lag behind and come nearer to its wall. Electrodes are
moved up and down with the body, those under the punch by the mean of their layer there, since the distance of
a millimetre that matters is less than what a coarse mesh resolves point by point. Sideways they are left in
place: the silicone under a flat punch hardly flows (not at all if incompressible and deep: Johnson, Contact
Mechanics, 1985, Sec. 3.4).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from softfuse.body.body import Body
from softfuse.equilibrium.linear_solver import AbstractLinearSolver
from softfuse.equilibrium.multifrontal import Multifrontal
from softfuse.errors import ConfigError
from softfuse.experiment.pad_field import ArrayField, CrossedLines, FieldSettings
from softfuse.experiment.virtual_finger import Carried
from softfuse.experiment.virtual_pad import PadPose, PadSettings, PadSolver, Touch, virtual_pad


@dataclass(frozen=True, eq=False)
class PadTouches:
    """t touches, each at g gaps of air and l forces, of k cavities and e lines, rows first.

    at (t, 2) m; gap (g,) m, increasing from 0; near (t, g, e) F: capacitances under the punch at these gaps;
    force (t, l) N, increasing from 0, depth (t, l) m, volume (t, l, k) m³: changes, pressed (t, l, e) F:
    capacitances, at these forces.
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
    lines: CrossedLines,
    field: FieldSettings,
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
    array = ArrayField(lines, field)
    top = np.array([0.0, 0.0, settings.drawing.size[2]])
    carried = Carried.of(pad.body, array.panels.middle + top)
    solver = PadSolver(pad, plan=plan)
    near, poses, pressed = [], [], []
    for touch in touches:
        poses.append(solver.poses(touch, solved=solved))
        near.append([array.lines(touch.at, gap) for gap in gaps])
        pressed.append(
            [near[-1][0]]
            + [
                array.lines(touch.at, -pose.depth, _under(array, field, touch, carried.at(pose.nodes) - top))
                for pose in poses[-1][1:]
            ]
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


def _under(
    array: ArrayField, field: FieldSettings, touch: Touch, now: Float[np.ndarray, "m 3"]
) -> Float[np.ndarray, "m 3"]:
    """Where the electrodes' panels (m, 3) m count as being, those under the punch at the mean of a layer."""
    rest = array.panels.middle
    under = np.hypot(*(rest[:, :2] - touch.at).T) < field.radius
    placed = np.column_stack([rest[:, :2], now[:, 2]])
    for layer in np.unique(rest[:, 2]):
        those = under & (rest[:, 2] == layer)
        placed[those, 2] = now[those, 2].mean() if those.any() else 0.0
    return placed
