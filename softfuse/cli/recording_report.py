"""What `softfuse estimate` says about a recording: numbers, tables and figures."""

import math
from collections import Counter
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Array

from softfuse.cli.recorded import sample_frames, samples_at
from softfuse.config import DeviceConfig
from softfuse.config.build_mesh import DeviceMesh
from softfuse.estimation.device import Device
from softfuse.estimation.tracker import Tracked
from softfuse.experiment import figures
from softfuse.experiment.accuracy import Samples, Spread, force_table, location_table
from softfuse.experiment.report import page, picture, spread_table, table
from softfuse.hardware.recording import Recording
from softfuse.mesh.surface import outer_surface


@dataclass(frozen=True, eq=False)
class Peak:
    """The frame of a touch in which the force [N] was largest, and the body's unknowns z (n,) then."""

    frame: int
    force_N: float
    z: Array


class Peaks:
    """Keeps the peak of each touch while the frames go by."""

    def __init__(self):
        """Nothing has touched."""
        self.kept: list[Peak] = []
        self._within_touch = False

    def see(self, frame: int, now: Tracked, z: Array) -> None:
        """Look at the next frame; without an estimated force it only ends a touch or lets it go on."""
        if not now.contacts:
            self._within_touch = False
        elif now.force_N > 0:
            if not self._within_touch:
                self.kept.append(Peak(frame, now.force_N, z))
            elif now.force_N > self.kept[-1].force_N:
                self.kept[-1] = Peak(frame, now.force_N, z)
            self._within_touch = True


@dataclass(frozen=True, eq=False)
class Estimated:
    """A recording, what was estimated from its frames, and the shape at the peak of each touch."""

    config: DeviceConfig
    device: Device
    mesh: DeviceMesh
    recording: Recording
    found: list[Tracked]
    peaks: list[Peak]

    @cached_property
    def samples(self) -> Samples | None:
        """Estimates and truth where the recording knows it; None where it never does."""
        at = sample_frames(self.recording)
        return samples_at(self.recording, self.found, at) if at.size else None


def summary(estimated: Estimated) -> dict[str, Any]:
    """The numbers of summary.json: counts, latency [ms], and with truth Tables I [mm] and II [%]."""
    found = estimated.found
    contact = [row for row in found if row.contacts]
    latency = 1e3 * np.array([row.latency_s for row in contact])
    numbers: dict[str, Any] = {
        "device": estimated.config.device.name,
        "recording": str(estimated.recording.path),
        "frames": len(found),
        "contact_frames": len(contact),
        "malformed_rows": int(estimated.recording.malformed.sum()),
        "recording_complete": estimated.recording.complete,
        "nodes": estimated.device.body.n_nodes,
        "dof": estimated.device.body.n,
        "latency_ms": {
            name: float(np.quantile(latency, q)) if latency.size else None
            for name, q in (("p50", 0.5), ("p99", 0.99), ("max", 1.0))
        },
        "statuses": dict(Counter(str(status) for row in found for status in row.statuses).most_common()),
    }
    samples = estimated.samples
    if samples is not None:
        for key, _, _, groups in _tables(samples):
            numbers[key] = {name: _json(spread) for name, spread in groups.items()}
        numbers["samples"] = len(samples.level)
        numbers["samples_without_estimate"] = int(np.sum(~np.isfinite(samples.force_N)))
    return numbers


def _tables(samples: Samples) -> list[tuple[str, str, str, dict[str, Spread]]]:
    """Key in summary.json, title in the report, unit and groups of the paper's tables."""
    return [
        (key, title, unit, {name: spread.scaled(factor) for name, spread in groups.items()})
        for key, title, unit, factor, groups in (
            ("location_error_mm", "Table I: location error", "mm", 1e3, location_table(samples)),
            ("force_error_percent", "Table II: force error", "%", 100.0, force_table(samples)),
        )
    ]


def _json(spread: Spread) -> dict[str, float | None]:
    return {name: value if math.isfinite(value) else None for name, value in asdict(spread).items()}


def write_report(path: Path, estimated: Estimated, numbers: dict[str, Any]) -> None:
    """Write report.html."""
    samples = estimated.samples
    sections = [("Recording", _overview(numbers))]
    if samples is not None:
        sections += [(title, spread_table(unit, groups)) for _, title, unit, groups in _tables(samples)]
        if np.any(np.isfinite(samples.force_N)):
            caption = "Left: estimated over true force. Right: force error at the true locations."
            sections.append(("Force against truth", picture(figures.force_agreement(samples), caption)))
    sections.append(("Over time", _over_time(estimated)))
    sections.append(("Location", _places(estimated, samples)))
    if estimated.peaks:
        sections.append(("Shape at the largest force", _shape(estimated)))
    if numbers["contact_frames"]:
        latency = np.array([1e3 * row.latency_s for row in estimated.found if row.contacts])
        sections.append(("Latency", picture(figures.latencies(latency), "Frames with contact.")))
    path.write_text(page(f"{numbers['device']}: {estimated.recording.path.name}", sections), encoding="utf-8")


def _overview(numbers: dict[str, Any]) -> str:
    rows = [
        ("frames", str(numbers["frames"])),
        ("frames with contact", str(numbers["contact_frames"])),
        ("rows that could not be read in full", str(numbers["malformed_rows"])),
        ("nodes of the model", str(numbers["nodes"])),
        ("unknowns of the model", str(numbers["dof"])),
    ]
    if numbers["latency_ms"]["p50"] is not None:
        rows += [(f"latency {name} [ms]", f"{v:.1f}") for name, v in numbers["latency_ms"].items()]
    if "samples" in numbers:
        rows.append(("samples with truth", str(numbers["samples"])))
        rows.append(("samples without an estimate", str(numbers["samples_without_estimate"])))
    statuses = [(name, str(count)) for name, count in numbers["statuses"].items()]
    return table(("", "value"), rows) + table(("status", "frames"), statuses)


def _over_time(estimated: Estimated) -> str:
    found = estimated.found
    time = np.array([row.time_s for row in found])
    force = np.array([row.force_N for row in found])
    true = estimated.recording.columns.get("true_force_N")
    measured = 1e9 * np.array([row.reading for row in found])
    misfit = 1e9 * np.array([row.misfit for row in found])
    names = [cavity.name for cavity in estimated.config.cavities]
    return picture(figures.force_over_time(time, force, true), "Normal force.") + picture(
        figures.volumes_over_time(
            time, measured.reshape(-1, len(names)), misfit.reshape(-1, len(names)), names
        ),
        "Volume changes of the cavities.",
    )


def _places(estimated: Estimated, samples: Samples | None) -> str:
    outlines = []
    for surface in estimated.mesh.cavities:
        corners = 1e3 * estimated.mesh.mesh.nodes[np.unique(surface.faces[:, :3]), :2]
        (x0, y0), (x1, y1) = corners.min(axis=0), corners.max(axis=0)
        outlines.append(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]))
    places = 1e3 * np.array([row.centre_m[:2] for row in estimated.found]).reshape(-1, 2)
    return picture(figures.location_map(places, samples, outlines), "Contacts from above, over the cavities.")


def _shape(estimated: Estimated) -> str:
    assert estimated.config.sensors is not None  # a recording was estimated
    peak = max(estimated.peaks, key=lambda peak: peak.force_N)
    row = estimated.found[peak.frame]
    mesh = estimated.mesh.mesh
    displacement = np.asarray(estimated.device.body.displacement(peak.z))
    faces = outer_surface(mesh).faces
    flat = faces[:, :3] if faces.shape[1] == 3 else _split(faces)
    x, y = 1e3 * row.centre_m[:2]
    array = estimated.config.sensors.capacitive
    lines = (1e3 * np.array(array.column_x), 1e3 * np.array(array.row_y))
    image = figures.electrode_image(row.details.image, *lines)
    caption = f"{row.force_N:.2f} N at ({x:.1f}, {y:.1f}) mm, {row.time_s:.2f} s. Each touch: shape_NN.vtu."
    return picture(figures.deformed_shape(mesh.nodes, displacement, flat), caption) + picture(
        image, "Image of the electrodes in that frame."
    )


def _split(faces: np.ndarray) -> np.ndarray:
    """Four flat triangles for each quadratic face."""
    a, b, c, ab, bc, ca = faces.T
    return np.concatenate(
        [np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    )
