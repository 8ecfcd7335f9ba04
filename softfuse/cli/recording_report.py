"""What `softfuse estimate` says about a recording: numbers, tables and figures."""

import math
from collections import Counter
from dataclasses import asdict, dataclass
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
class Estimated:
    """A recording, what was estimated from its frames, and the shape at the peak of each touch."""

    config: DeviceConfig
    device: Device
    mesh: DeviceMesh
    recording: Recording
    found: list[Tracked]
    shapes: list[tuple[int, Array]]


def _samples(estimated: Estimated) -> Samples | None:
    at = sample_frames(estimated.recording)
    return samples_at(estimated.recording, estimated.found, at) if at.size else None


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
    samples = _samples(estimated)
    if samples is not None:
        numbers["location_error_mm"] = _scaled(location_table(samples), 1e3)
        numbers["force_error_percent"] = _scaled(force_table(samples), 100.0)
        numbers["samples"] = len(samples.level)
        numbers["samples_without_estimate"] = int(np.sum(~np.isfinite(samples.force_N)))
    return numbers


def _scaled(groups: dict[str, Spread], factor: float) -> dict[str, dict[str, float | None]]:
    def number(value: float) -> float | None:
        return factor * value if math.isfinite(value) else None

    return {name: asdict(s) | {"mean": number(s.mean), "std": number(s.std)} for name, s in groups.items()}


def write_report(path: Path, estimated: Estimated, numbers: dict[str, Any]) -> None:
    """Write report.html."""
    samples = _samples(estimated)
    sections = [("Recording", _overview(numbers))]
    if samples is not None:
        tables = (("location_error_mm", "mm"), ("force_error_percent", "%"))
        for title, (key, unit) in zip(
            ("Table I: location error", "Table II: force error"), tables, strict=True
        ):
            groups = {
                name: Spread(_or_nan(s["mean"]), _or_nan(s["std"]), s["n"])
                for name, s in numbers[key].items()
            }
            sections.append((title, spread_table(unit, groups)))
        if np.any(np.isfinite(samples.force_N)):
            caption = "Left: estimated over true force. Right: force error at the true locations."
            sections.append(("Force against truth", picture(figures.force_agreement(samples), caption)))
    sections.append(("Over time", _over_time(estimated)))
    sections.append(("Location", _places(estimated, samples)))
    if estimated.shapes:
        sections.append(("Shape at the largest force", _shape(estimated)))
    if numbers["contact_frames"]:
        latency = np.array([1e3 * row.latency_s for row in estimated.found if row.contacts])
        sections.append(("Latency", picture(figures.latencies(latency), "Frames with contact.")))
    path.write_text(page(f"{numbers['device']}: {estimated.recording.path.name}", sections), encoding="utf-8")


def _or_nan(value: float | None) -> float:
    return float("nan") if value is None else value


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
    measured = 1e9 * np.array([row.volume_change_m3 for row in found])
    misfit = 1e9 * np.array([row.misfit_m3 for row in found])
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
    places = 1e3 * np.array([row.location_m for row in estimated.found]).reshape(-1, 2)
    return picture(figures.location_map(places, samples, outlines), "Contacts from above, over the cavities.")


def _shape(estimated: Estimated) -> str:
    assert estimated.config.sensors is not None  # a recording was estimated
    peak = max(estimated.shapes, key=lambda shape: estimated.found[shape[0]].force_N)
    row = estimated.found[peak[0]]
    mesh = estimated.mesh.mesh
    displacement = np.asarray(estimated.device.body.displacement(peak[1]))
    faces = outer_surface(mesh).faces
    flat = faces[:, :3] if faces.shape[1] == 3 else _split(faces)
    x, y = 1e3 * row.location_m
    array = estimated.config.sensors.capacitive
    lines = (1e3 * np.array(array.column_x), 1e3 * np.array(array.row_y))
    image = figures.electrode_image(row.image, *lines)
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
