"""The study of a finger: contacts at electrodes, cables, sealed pressures, points and bending, Table III."""

from typing import Any

import numpy as np

from softfuse.cli.finger_sections import finger_sections, largest_shapes
from softfuse.cli.finger_series import FingerFrame, FingerSeries
from softfuse.cli.finger_truth import finger_truth
from softfuse.cli.readout import FingerReadout
from softfuse.cli.study import AbstractStudy, ErrorTable, Estimated, Peaks, known
from softfuse.experiment.accuracy import scaled
from softfuse.experiment.contact_accuracy import contact_force_table, largest_force
from softfuse.experiment.shape_accuracy import PULLED_M, position_table
from softfuse.experiment.shape_figures import Shape


class FingerStudy(AbstractStudy):
    """Contacts, forces and shape of a recording from single electrodes, pressures and cable lengths."""

    def __init__(self, estimated: Estimated):
        """A study of frames that are yet to be found.

        Raises ConfigError for points outside the body, RecordingError for the truth about some of them only.
        """
        config, device = estimated.config, estimated.device
        self._all = estimated
        self._points = [point.name for point in config.points]
        self._frames: list[FingerFrame] = []
        electrodes = [electrode.name for electrode in config.electrodes]
        truth = finger_truth(estimated.recording, self._points, len(config.cables), electrodes)
        self._series = FingerSeries(self._frames, len(config.cables), truth)
        self._readout = FingerReadout(config, device, estimated.mesh)
        self._touches, self._pulls = Peaks(), Peaks()

    @property
    def readout(self):
        """Contacts, cables, pressures, points, bending of the centreline."""
        return self._readout

    def see(self, now, state):
        """Remember what people read, and the shape when it may be the peak of a touch or of a pull."""
        frame = self._readout.frame(now, state)
        self._frames.append(frame)
        shorter = float(np.max(frame.posture.answers[: self._series.cables], initial=0.0))
        at = len(self._frames) - 1
        self._touches.see(at, now.contacts > 0, now.force_N, state)
        # A pull goes on while something touches, but its shape is that of the cable alone.
        self._pulls.see(at, shorter > PULLED_M, 0.0 if now.contacts else shorter, state)

    def values(self, frame):
        """Read off the frame that was kept."""
        return self._readout.values(self._frames[frame])

    @property
    def peaks(self):
        """The largest force of each touch, the largest shortening of each pull while nothing touches."""
        return sorted([*self._touches.kept, *self._pulls.kept], key=lambda peak: peak.frame)

    @property
    def errors(self):
        """The paper's Table III, and the forces of contacts against those at the same electrodes."""
        shape, contacts = self._series.shape_samples, self._series.contact_samples
        tables: list[ErrorTable] = []
        if shape is not None:
            groups = scaled(position_table(shape, self._points), 1e3)
            title = "Table III: position error"
            tables.append(ErrorTable("position_error_mm", title, "position error", "mm", groups))
        if contacts is not None and contacts.true.any():
            groups = scaled(contact_force_table(contacts), 100.0)
            tables.append(ErrorTable("force_error_percent", "Force error", "force error", "%", groups))
        return tables

    def numbers(self) -> dict[str, Any]:
        """How many samples and contacts there are, and forces where truly nothing presses."""
        series, truth, numbers = self._series, self._series.truth, {}
        shape, contacts = series.shape_samples, series.contact_samples
        if shape is not None:
            numbers["samples"] = len(shape.level)
            numbers["samples_without_estimate"] = int(np.sum(~np.isfinite(shape.position_m).all(axis=(1, 2))))
        if contacts is not None:
            numbers["contacts_true"] = int(contacts.true.sum())
            numbers["contacts_missed"] = contacts.missed
            numbers["contacts_misplaced"] = contacts.misplaced
        if truth.force_N.shape[1]:
            numbers["phantom_force_N"] = {
                "without_tip": known(largest_force(series.force_N, truth.without_tip)),
                "without_force": known(largest_force(series.force_N, truth.without_force)),
            }
        return numbers

    @property
    def series(self) -> FingerSeries:
        """What was read of the frames, and the truth about them."""
        return self._series

    @property
    def shapes(self) -> list[Shape]:
        """The largest push without and with a pulled cable; without pushes the largest pull."""
        return largest_shapes(self._all, self._series, self._touches.kept, self._pulls.kept)

    def sections(self):
        """Contacts, points, shapes, pressures, cables, forces, bending."""
        return finger_sections(self._all, self._series, self.shapes, self.numbers())
