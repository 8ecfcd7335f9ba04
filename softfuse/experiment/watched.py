"""What is watched on a robot: its named points, its centreline, the patches of its electrodes."""

import numpy as np

from softfuse.experiment.posture import Watched
from softfuse.mechanics.patch import PatchContact
from softfuse.robot.robot import Robot


def watched_of(robot: Robot) -> Watched:
    """The points, the centreline if there is one, and the electrodes of a robot.

    Raises ConfigError for a point outside the body.
    """
    patches = [contact for contact in robot.model.contacts if isinstance(contact, PatchContact)]
    return Watched.on(
        robot.model,
        robot.points(),
        robot.centreline(),
        robot.parts.faces,
        np.array(list(robot.settings.places.values())).reshape(-1, 3, 3),
        np.asarray(patches[0].offsets).tolist() if patches else (0.0,),
    )
