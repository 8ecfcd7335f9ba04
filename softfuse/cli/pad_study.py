"""The study of a pad: one contact seen from above, volume changes of cavities, Tables I and II."""

from typing import Any

import numpy as np
from jaxtyping import Float

from softfuse.cli.readout import PadReadout, Value
from softfuse.cli.recorded import sample_frames, samples_at
from softfuse.cli.study import AbstractStudy, ErrorTable, Estimated, Peaks
from softfuse.config.contact import DiscSettings
from softfuse.report import figures
from softfuse.experiment.accuracy import Samples, force_table, location_table, scaled
from softfuse.report.mutual_figures import signed_image
from softfuse.report.page import picture
from softfuse.mesh.surface import outer_surface
from softfuse.robot.file import RobotSettings
from softfuse.robot.mesh import RobotMesh


class PadStudy(AbstractStudy):
    """Location, force and volumes of a recording from crossed electrodes and flow sensors."""

    def __init__(self, estimated: Estimated):
        """A study of frames that are yet to be found."""
        self._all = estimated
        self._touches = Peaks()
        self._readout, self._values = PadReadout(estimated.config), list[list[Value]]()

    @property
    def readout(self):
        """Where and how hard, and the measured volume change of each cavity."""
        return self._readout

    def see(self, now, state):
        """Remember what people read, and the shape when it may be the peak of a touch."""
        self._values.append(self._readout.read(now, state))
        self._touches.see(len(self._all.found) - 1, now.contacts > 0, now.force_N, state)

    def values(self, frame):
        """Kept with what was found."""
        return self._values[frame]

    @property
    def peaks(self):
        """The largest force of each touch."""
        return self._touches.kept

    @property
    def samples(self) -> Samples | None:
        """Estimates and truth where the recording knows it; None where it never does."""
        at = sample_frames(self._all.recording)
        return samples_at(self._all.recording, self._all.found, at) if at.size else None

    @property
    def errors(self):
        """The paper's Tables I and II."""
        samples = self.samples
        if samples is None:
            return []
        location = scaled(location_table(samples), 1e3)
        force = scaled(force_table(samples), 100.0)
        return [
            ErrorTable("location_error_mm", "Table I: location error", "location error", "mm", location),
            ErrorTable("force_error_percent", "Table II: force error", "force error", "%", force),
        ]

    def joined_errors(self, joined):
        """Table II of the frames up to each, and of all frames of its touch."""
        samples = self.samples
        if samples is None:
            return []
        of = joined.samples(samples, sample_frames(self._all.recording))
        return [
            ErrorTable(
                f"{name}_force_error_percent",
                f"Table II of {name} frames: force error",
                f"force error, {name} frames",
                "%",
                scaled(force_table(each), 100.0),
            )
            for name, each in of.items()
        ]

    def numbers(self) -> dict[str, Any]:
        """How many samples there are, if any."""
        samples = self.samples
        if samples is None:
            return {}
        return {
            "samples": len(samples.level),
            "samples_without_estimate": int(np.sum(~np.isfinite(samples.force_N))),
        }

    def sections(self):
        """Force against truth, force and volumes over time, locations, shape."""
        samples, parts = self.samples, []
        if samples is not None and np.any(np.isfinite(samples.force_N)):
            caption = "Left: estimated over true force. Right: force error at the true locations."
            agreement = figures.force_agreement(samples, workspace_mm(self._all.config))
            parts.append(("Force against truth", picture(agreement, caption)))
        parts.append(("Over time", self._over_time()))
        parts.append(("Location", self._places(samples)))
        if self.peaks:
            parts.append(("Shape at the largest force", self._shape()))
        return parts

    def _over_time(self) -> str:
        found = self._all.found
        time = np.array([row.time_s for row in found])
        force = np.array([row.force_N for row in found])
        true = self._all.recording.columns.get("true_force_N")
        measured = 1e9 * np.array([row.reading for row in found])
        misfit = 1e9 * np.array([row.misfit for row in found])
        names = [cavity.name for cavity in self._all.config.cavities]
        return picture(figures.force_over_time(time, force, true), "Normal force.") + picture(
            figures.volumes_over_time(
                time, measured.reshape(-1, len(names)), misfit.reshape(-1, len(names)), names
            ),
            "Volume changes of the cavities.",
        )

    def _places(self, samples: Samples | None) -> str:
        places = 1e3 * np.array([row.centre_m[:2] for row in self._all.found]).reshape(-1, 2)
        outlines = cavity_outlines_mm(self._all.mesh)
        return picture(
            figures.location_map(places, samples, outlines), "Contacts from above, over the cavities."
        )

    def _shape(self) -> str:
        assert self._all.config.sensors is not None  # a recording was estimated
        peak = max(self.peaks, key=lambda peak: peak.size)
        row = self._all.found[peak.frame]
        mesh = self._all.mesh.mesh
        displacement = np.asarray(self._all.device.body.displacement(peak.state.z))
        flat = figures.flat_triangles(outer_surface(mesh).faces)
        x, y = 1e3 * row.centre_m[:2]
        sensors = self._all.config.sensors
        array = sensors.grid or sensors.capacitive
        lines = (1e3 * np.array(array.column_x), 1e3 * np.array(array.row_y))
        draw = signed_image if sensors.grid else figures.electrode_image
        image = draw(row.details.image, *lines)
        sigma = 1e3 * self._all.shape_sigma_m(peak).max()
        caption = (
            f"{row.force_N:.2f} N at ({x:.1f}, {y:.1f}) mm, {row.time_s:.2f} s; standard deviation of a node "
            f"{sigma:.3f} mm at most. Each touch: shape_NN.vtu."
        )
        return picture(figures.deformed_shape(mesh.nodes, displacement, flat), caption) + picture(
            image, "Image of the electrodes in that frame."
        )


def workspace_mm(config: RobotSettings) -> Float[np.ndarray, "2 2"]:
    """Low and high ends of x and y between which contacts on a pad may be (2, 2) [mm]."""
    contact = config.contact
    assert isinstance(contact, DiscSettings)  # no other goes with the electrodes of a pad
    return 1e3 * np.stack([np.array(contact.workspace.x), np.array(contact.workspace.y)], axis=1)


def cavity_outlines_mm(mesh: RobotMesh) -> list[Float[np.ndarray, "4 2"]]:
    """The rectangles (4, 2) [mm] around the cavities, from above."""
    outlines = []
    for surface in mesh.cavities:
        corners = 1e3 * mesh.mesh.nodes[np.unique(surface.faces[:, :3]), :2]
        (x0, y0), (x1, y1) = corners.min(axis=0), corners.max(axis=0)
        outlines.append(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]))
    return outlines
