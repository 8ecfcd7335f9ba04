"""From settings to what is watched on a device: named points, the centreline, the patches of electrodes."""

import numpy as np

from softfuse.config.build_attached import build_centreline, build_points
from softfuse.config.build_mesh import DeviceMesh
from softfuse.config.device import DeviceConfig
from softfuse.estimation.device import Device
from softfuse.experiment.posture import Watched
from softfuse.mesh.surface import outer_surface


def build_watched(config: DeviceConfig, device: Device, mesh: DeviceMesh) -> Watched:
    """The points, the centreline if there is one, and the electrodes of a config, on its device and mesh.

    Raises ConfigError for a point outside the body.
    """
    return Watched.on(
        device,
        build_points(config, device.body),
        build_centreline(config, device.body) if config.centreline else None,
        outer_surface(mesh.mesh).faces,
        np.array([electrode.middles for electrode in config.electrodes]),
        np.array([electrode.direction for electrode in config.electrodes]),
    )
