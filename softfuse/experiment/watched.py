"""From settings to what is watched on a device: named points, the centreline, the patches of electrodes."""

from softfuse.config.build_attached import build_centreline, build_points
from softfuse.config.build_device import electrode_places
from softfuse.experiment.posture import Watched
from softfuse.mechanics.model import Model
from softfuse.mesh.surface import outer_surface
from softfuse.robot.mesh import RobotMesh
from softfuse.robot.settings import RobotSettings


def build_watched(config: RobotSettings, device: Model, mesh: RobotMesh) -> Watched:
    """The points, the centreline if there is one, and the electrodes of a config, on its device and mesh.

    Raises ConfigError for a point outside the body.
    """
    return Watched.on(
        device,
        build_points(config, device.body),
        build_centreline(config, device.body) if config.centreline else None,
        outer_surface(mesh.mesh).faces,
        electrode_places(config),
        config.electrodes[0].arms if config.electrodes else (),
    )
