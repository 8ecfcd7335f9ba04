"""The sections of a finger's report: contacts, points, shapes, pressures, cables, forces, bending."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from softfuse.cli.finger_series import FingerSeries
from softfuse.cli.study import Estimated, Peak
from softfuse.experiment import finger_figures, shape_figures
from softfuse.report.figures import flat_triangles
from softfuse.report.page import picture, table
from softfuse.experiment.shape_accuracy import PULLED_M
from softfuse.report.shape_figures import Shape
from softfuse.mesh.surface import outer_surface


def finger_sections(
    estimated: Estimated,
    series: FingerSeries,
    shown: Sequence[Shape],
    numbers: dict[str, Any],
) -> list[tuple[str, str]]:
    """Headings and HTML, from shapes to be shown and the numbers of the summary."""
    config, n = estimated.config, len(series.frames)
    parts: list[tuple[str, str]] = []
    if "phantom_force_N" in numbers:
        parts.append(("Contacts", _contacts(numbers)))
    if not n:
        return parts
    if config.points:
        parts.append(("Points", _points(estimated, series)))
    if shown:
        parts.append(("Shape", _space(estimated, shown)))
    pressures = finger_figures.pressures_over_time(
        series.time_s, 1e-3 * series.pressure_Pa, 1e-3 * series.misfit_Pa, [c.name for c in config.cavities]
    )
    parts.append(("Pressures", picture(pressures, "Pressures of the cavities above that at rest.")))
    if config.cables:
        cables = finger_figures.cables_over_time(
            series.time_s,
            1e3 * series.measured_m,
            1e3 * series.shortening_m,
            series.tension_N,
            series.truth.tension_N,
            [cable.name for cable in config.cables],
        )
        parts.append(("Cables", picture(cables, "By how much each cable is shortened, and its tension.")))
    electrodes = _pressed(estimated, series)
    if electrodes:
        parts.append(("Forces", _forces(estimated, series, electrodes)))
    if config.centreline:
        bent = finger_figures.bending_over_time(
            series.time_s, np.rad2deg(series.turn), np.rad2deg(series.tip_turn)
        )
        parts.append(("Bending", picture(bent, "Segments of the centreline, from the base to the tip.")))
    return parts


def _contacts(numbers: dict[str, Any]) -> str:
    phantom = numbers["phantom_force_N"]
    rows = [
        (label, str(numbers[key]))
        for label, key in (
            ("true contacts at the samples", "contacts_true"),
            ("missed", "contacts_missed"),
            ("found where nothing presses", "contacts_misplaced"),
        )
        if key in numbers
    ]
    rows += [
        (f"largest force while {what} [N]", f"{phantom[key]:.3f}")
        for what, key in (("there is no tip", "without_tip"), ("no tip presses", "without_force"))
        if phantom[key] is not None
    ]
    return table(("", "value"), rows)


def _points(estimated: Estimated, series: FingerSeries) -> str:
    names = [point.name for point in estimated.config.points]
    rest = np.array([point.at for point in estimated.config.points])
    truth, samples = series.truth, series.shape_samples
    html = ""
    if samples is not None:
        at = truth.samples
        depth = truth.level if truth.depth_m is None else 1e3 * truth.depth_m
        figure = finger_figures.points_over_depth(
            samples.press,
            depth[at],
            samples.cable_m > PULLED_M,
            1e3 * (samples.position_m - rest),
            1e3 * (samples.true_position_m - rest),
            names,
            "level" if truth.depth_m is None else "depth [mm]",
        )
        html = picture(figure, "Points at the samples of each push.")
    true = None if truth.point_m is None else 1e3 * (truth.point_m - rest)
    moved = finger_figures.points_over_time(series.time_s, 1e3 * (series.point_m - rest), true, names)
    return html + picture(moved, "How far the points have moved.")


def largest_shapes(
    estimated: Estimated, series: FingerSeries, touches: Sequence[Peak], pulls: Sequence[Peak]
) -> list[Shape]:
    """The largest push without and with a pulled cable, without pushes the largest pull, of the peaks of
    touches [N] and pulls [m].
    """
    if not series.frames:
        return []
    shortening = np.max(series.shortening_m, axis=1, initial=0.0)
    pulled = [peak for peak in touches if shortening[peak.frame] > PULLED_M]
    alone = [peak for peak in touches if shortening[peak.frame] <= PULLED_M]
    groups = [group for group in (alone, pulled) if group] or ([list(pulls)] if pulls else [])
    return [_shape(estimated, series, max(group, key=lambda peak: peak.size)) for group in groups]


def _shape(estimated: Estimated, series: FingerSeries, peak: Peak) -> Shape:
    frame, body = series.frames[peak.frame], estimated.device.body
    names = [electrode.name for electrode in estimated.config.electrodes]
    touched = np.flatnonzero(frame.now.touching)
    parts = [f"{frame.now.contact_force_N[c]:.2f} N at {names[frame.electrode[c]]}" for c in touched]
    shorter = series.shortening_m[peak.frame]
    parts += [
        f"{cable.name} cable shortened by {1e3 * by:.1f} mm, {tension:.2f} N"
        for cable, by, tension in zip(estimated.config.cables, shorter, frame.now.attached, strict=False)
    ]
    true = series.truth.point_m
    return Shape(
        f"{frame.now.time_s:.2f} s: " + "; ".join(parts),
        np.asarray(body.rest + body.displacement(peak.state.z)),
        frame.posture.point_m,
        None if true is None else true[peak.frame],
        frame.place_m[touched],
        frame.force_N[touched],
    )


def _space(estimated: Estimated, shown: Sequence[Shape]) -> str:
    mesh = estimated.mesh.mesh
    figure = shape_figures.shapes(mesh.nodes, flat_triangles(outer_surface(mesh).faces), shown)
    return picture(
        figure,
        "Estimated body over its edges at rest; arrows: estimated forces. Each touch and pull: shape_NN.vtu.",
    )


def _pressed(estimated: Estimated, series: FingerSeries) -> list[int]:
    """The electrodes that are touched, or truly pressed, in some frame."""
    truth = series.truth
    pressed = {*series.electrode.ravel(), *truth.electrode[truth.force_N > 0].ravel()}
    return [e for e in range(len(estimated.config.electrodes)) if e in pressed]


def _forces(estimated: Estimated, series: FingerSeries, electrodes: Sequence[int]) -> str:
    truth = series.truth
    found = _by_electrode(electrodes, series.electrode, series.contact_N)
    true = _by_electrode(electrodes, truth.electrode, truth.force_N)
    names = [estimated.config.electrodes[e].name for e in electrodes]
    figure = finger_figures.contacts_over_time(series.time_s, found, true, names)
    return picture(figure, "Forces of the contacts.")


def _by_electrode(electrodes: Sequence[int], at: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Forces (n, e) on some electrodes from those of contacts (n, c) at electrodes `at` (n, c)."""
    per_electrode = [np.where(at == e, force, 0.0).sum(axis=1) for e in electrodes]
    there = [(at == e).any(axis=1) for e in electrodes]
    return np.where(there, per_electrode, np.nan).reshape(len(electrodes), len(at)).T
