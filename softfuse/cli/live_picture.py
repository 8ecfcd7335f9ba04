"""From estimates to the pictures of the live view, at a rate that eyes can follow."""

import numpy as np

from softfuse.cli.joined_readout import joined_words
from softfuse.cli.readout import AbstractReadout
from softfuse.estimation.tracker import Tracker
from softfuse.report.figures import flat_triangles
from softfuse.report.shape_figures import sharp_edges
from softfuse.hardware.live.rerun_view import Picture, RerunView, Scene
from softfuse.hardware.live.session import Published
from softfuse.mechanics.model import Model
from softfuse.mesh.surface import outer_surface
from softfuse.robot.file import RobotSettings
from softfuse.robot.mesh import RobotMesh

PICTURES_A_SECOND = 20.0


def scene_of(config: RobotSettings, mesh: RobotMesh) -> Scene:
    """The body of a device, and its cavities."""
    faces = outer_surface(mesh.mesh).faces
    return Scene(
        config.device.name,
        mesh.mesh.nodes,
        flat_triangles(faces),
        sharp_edges(mesh.mesh.nodes, faces),
        tuple(flat_triangles(cavity.faces) for cavity in mesh.cavities),
        tuple(cavity.name for cavity in config.cavities),
    )


class Pictures:
    """Shows estimates in a view."""

    def __init__(self, view: RerunView, device: Model, tracker: Tracker, readout: AbstractReadout):
        """`tracker`: the one whose estimates are published; its state is read when one is."""
        self._view, self._device, self._tracker, self._readout = view, device, tracker, readout
        self._shown_s = -np.inf

    def publish(self, now: Published) -> None:
        """Show an estimate, unless one was shown just before."""
        if now.host_s - self._shown_s < 1.0 / PICTURES_A_SECOND:
            return
        self._shown_s = now.host_s
        tracked, state = now.tracked, self._tracker.state
        at, force = self._readout.forces(tracked, state)
        numbers = {name: value for name, value in now.fields.items() if isinstance(value, float)}
        forces = {f"force/{name}": value for name, value in numbers.items() if name.endswith("_N")}
        others = {f"model/{name}": value for name, value in numbers.items() if not name.endswith("_N")}
        channels = {f"channels/{name}": float(value) for name, value in now.channels.items()}
        took = {
            "latency/estimate_ms": 1e3 * tracked.latency_s,
            "latency/from_last_byte_ms": 1e3 * now.end_to_end_s,
        }
        self._view.show(
            Picture(
                now.host_s,
                np.asarray(self._device.body.displacement(state.z)),
                self._readout.cavities(tracked),
                at,
                force,
                {**forces, **others, **channels, **took},
                self._readout.image(tracked),
                _in_words(now),
            )
        )


def _in_words(now: Published) -> str:
    """An estimate's statuses, and what frames say together."""
    lines = ["; ".join(str(status) for status in now.tracked.statuses)]
    if now.joined is not None:
        touching = np.flatnonzero(now.tracked.touching)
        lines += [f"contact {c}, joined: {joined_words(now.joined, c)}" for c in touching.tolist()]
    return "\n".join(lines)
