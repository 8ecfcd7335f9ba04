"""The sections of a recording's report, one for each part that the robot has: headings and HTML."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from softfuse.experiment.accuracy import PULLED_M
from softfuse.mesh.surface import outer_surface
from softfuse.report import figures, shape_figures
from softfuse.report.columns import Column
from softfuse.report.figures import Panel, flat_triangles, over_time
from softfuse.report.page import picture, table
from softfuse.report.shape_figures import Shape
from softfuse.report.study import Peak, Study
from softfuse.robot.robot import Robot


def sections(study: Study) -> list[tuple[str, str]]:
    """Headings and HTML of what there is to be shown."""
    if not study.found:
        return []
    parts: tuple[tuple[str, Callable[[Study], str]], ...] = (
        ("Contacts", _contacts),
        ("Force against truth", _agreement),
        ("Forces", _forces),
        ("Location", _location),
        ("Readings", _readings),
        ("Cables", _cables),
        ("Chambers", _chambers),
        ("Points", _points),
        ("Bending", _bending),
        ("Shape", _shape),
    )
    return [(title, html) for title, section in parts if (html := section(study))]


def _contacts(study: Study) -> str:
    numbers: dict[str, Any] = study.numbers()
    rows = [
        (label, str(numbers[key]))
        for label, key in (
            ("true contacts at the samples", "contacts_true"),
            ("missed", "contacts_missed"),
            ("found where nothing presses", "contacts_misplaced"),
        )
        if key in numbers
    ]
    phantom = numbers.get("phantom_force_N", {})
    rows += [
        (f"largest force while {what} [N]", f"{phantom[key]:.3f}")
        for what, key in (
            ("there is nothing near", "without_contact"),
            ("nothing presses", "without_force"),
        )
        if phantom.get(key) is not None
    ]
    return table(("", "value"), rows) if rows else ""


def _agreement(study: Study) -> str:
    samples = study.samples
    if samples is None or not np.any(np.isfinite(samples.force_N)):
        return ""
    caption = "Left: estimated over true force. Right: force error at the true locations."
    return picture(figures.force_agreement(samples), caption)


def _forces(study: Study) -> str:
    slots, truth = study.columns.slots, study.truth
    if not slots:
        return ""
    panels = [_panel(study, "force [N]", ["force_N"], ["all contacts"])]
    names = study.columns.places
    if names:
        found = np.stack([study.place(slot) for slot in range(len(slots))], axis=1)
        force = np.array([row.contact_force_N for row in study.found])
        shown = [k for k in range(len(names)) if (found == k).any() or (truth.place == k).any()]
        true = _by_place(shown, truth.place, truth.contact_N) if truth.place.shape[1] else None
        at = [names[k] for k in shown]
        panels += [Panel("on places [N]", at, _by_place(shown, found, force), true)] if shown else []
    elif len(slots) > 1:
        panels.append(_panel(study, "each [N]", [f"{slot}_force_N" for slot in slots], slots))
    return picture(over_time(study.time_s, panels), "Forces of the contacts.")


def _by_place(places: Sequence[int], at: np.ndarray, force: np.ndarray) -> Float[np.ndarray, "n e"]:
    """Forces (n, e) on some places from those of contacts (n, c) at places `at` (n, c)."""
    per_place = [np.where(at == e, force, 0.0).sum(axis=1) for e in places]
    there = [(at == e).any(axis=1) for e in places]
    return np.where(there, per_place, np.nan).reshape(len(places), len(at)).T


def _location(study: Study) -> str:
    if not study.columns.slots or any(study.columns.named):
        return ""
    drawn = figures.location_map(study.series(["x_mm", "y_mm"]), study.samples, chamber_outlines(study.robot))
    return picture(drawn, "Contacts from above, over the chambers.")


def chamber_outlines(robot: Robot) -> list[Float[np.ndarray, "4 2"]]:
    """The rectangles (4, 2) [mm] around each chamber, seen from above."""
    outlines = []
    for surface in robot.mesh.cavities:
        corners = 1e3 * robot.mesh.mesh.nodes[np.unique(surface.faces[:, :3]), :2]
        (x0, y0), (x1, y1) = corners.min(axis=0), corners.max(axis=0)
        outlines.append(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]))
    return outlines


def _readings(study: Study) -> str:
    """All readings of one unit together: measured, as the model has them, and the misfit."""
    columns = study.columns
    names = [*columns.readings.values()]
    html = ""
    for unit in dict.fromkeys(columns.units):
        shown = [name for name, each in zip(names, columns.units, strict=True) if each == unit]
        measured = study.series([unit.of(name) for name in shown])
        misfit = study.series([unit.of(f"{name}_misfit") for name in shown])
        panels = [
            Panel(f"reading [{unit.label}]", shown, measured - misfit, measured),
            Panel(f"misfit [{unit.label}]", shown, misfit),
        ]
        drawn = over_time(study.time_s, panels, "measured")
        html += picture(drawn, "Readings since rest, and by how much the model misses them.")
    return html


def _cables(study: Study) -> str:
    names = [*study.columns.cables.values()]
    if not names:
        return ""
    panels = [
        _panel(study, "shortening [mm]", [f"{name}_mm" for name in names], names),
        _panel(study, "tension [N]", [f"{name}_N" for name in names], names),
    ]
    return picture(over_time(study.time_s, panels), "By how much each cable is shortened, and its tension.")


def _chambers(study: Study) -> str:
    names = {column.name for column in study.columns.columns}
    panels = []
    for unit, label in (("Pa", "pressure [Pa]"), ("mm3", "volume change [mm³]")):
        shown = [name for name in study.columns.chambers.values() if f"{name}_{unit}" in names]
        if shown:
            panels.append(_panel(study, label, [f"{name}_{unit}" for name in shown], shown))
    return picture(over_time(study.time_s, panels), "The chambers of the model.") if panels else ""


def _points(study: Study) -> str:
    names, columns = [*study.columns.points], study.point_columns
    if not names:
        return ""
    rest = 1e3 * np.array([point.at for point in study.robot.settings.points])
    truth, samples = study.truth, study.shape_samples
    html = ""
    if samples is not None:
        at = truth.samples(columns)
        depth = truth.level if truth.depth_mm is None else truth.depth_mm
        figure = figures.points_over_depth(
            samples.press,
            depth[at],
            samples.cable_m > PULLED_M,
            1e3 * samples.position_m - rest,
            1e3 * samples.true_position_m - rest,
            names,
            "level" if truth.depth_mm is None else "depth [mm]",
        )
        html = picture(figure, "Points at the samples of each push.")
    true = truth.matrix(columns)
    moved, truly = study.series(columns) - rest.ravel(), None if true is None else true - rest.ravel()
    panels = [
        Panel(f"moved along {axis} [mm]", names, moved[:, k::3], None if truly is None else truly[:, k::3])
        for k, axis in enumerate("xyz")
    ]
    return html + picture(over_time(study.time_s, panels), "How far the points have moved.")


def _bending(study: Study) -> str:
    names = [column.name for column in study.columns.columns if column.name.startswith("bend")]
    if study.robot.settings.centreline is None:
        return ""
    labels = [f"segment {k}" for k in range(len(names))]
    panels = [Panel("bending [deg]", [*labels, "tip"], study.series([*names, "tip_bend_deg"]))]
    caption = "Segments of the centreline, from the base to the tip, and the tip against rest."
    return picture(over_time(study.time_s, panels), caption)


def _panel(study: Study, label: str, columns: Sequence[str], names: Sequence[str]) -> Panel:
    """Columns over time, with the truth where the recording knows it."""
    known = any(name in study.truth.columns for name in columns)
    true = np.stack([study.truth.get(name) for name in columns], axis=1) if known else None
    return Panel(label, names, study.series(columns), true)


def _shape(study: Study) -> str:
    shown = largest_shapes(study)
    if not shown:
        return ""
    mesh = study.robot.mesh.mesh
    largest = max(study.peaks, key=lambda peak: (peak.estimate.tracked.contacts > 0, peak.size))
    sigma = 1e3 * study.shape_sigma_m(largest).max()
    drawn = shape_figures.shapes(mesh.nodes, flat_triangles(outer_surface(mesh).faces), shown)
    html = picture(
        drawn,
        "Estimated body over its edges at rest; arrows: estimated forces; standard deviation of a node "
        f"{sigma:.3f} mm at most. Each of a touch, or without one: shape_NN.vtu.",
    )
    details = largest.estimate.tracked.details
    for sensor in study.robot.suite.contact_sensors:
        image = sensor.image(details[sensor.name])
        if image is not None:
            html += picture(figures.electrode_image(image), f"What {sensor.name} sees in that frame.")
    return html


def largest_shapes(study: Study) -> list[Shape]:
    """The largest push while no cable is pulled and while one is; without pushes the largest shape of all."""
    cables = [Column.of(name, "m").name for name in study.columns.cables.values()]
    pulled = np.max(study.series(cables), axis=1, initial=0.0) > 1e3 * PULLED_M
    touches, free = study.touches.kept, study.free.kept
    groups = [[peak for peak in touches if pulled[peak.frame] == flag] for flag in (False, True)]
    groups = [group for group in groups if group] or ([free] if free else [])
    return [_drawn(study, max(group, key=lambda peak: peak.size)) for group in groups]


def _drawn(study: Study, peak: Peak) -> Shape:
    now, columns, body = peak.estimate, study.columns, study.robot.model.body
    tracked = now.tracked
    at, force = columns.contacts(now)
    touched = np.flatnonzero(tracked.touching).tolist()
    values = dict(zip((column.name for column in columns.columns), study.values(peak.frame), strict=True))
    parts = [f"{tracked.contact_force_N[c]:.2f} N at {_where(study, peak, values, c)}" for c in touched]
    parts += [
        f"{name} shortened by {values[f'{name}_mm']:.1f} mm, {values[f'{name}_N']:.2f} N"
        for name in columns.cables.values()
    ]
    points = 1e-3 * np.array([values[name] for name in study.point_columns], float).reshape(-1, 3)
    true = study.truth.matrix(study.point_columns)
    return Shape(
        f"{tracked.time_s:.2f} s: " + "; ".join(parts),
        np.asarray(body.rest + body.displacement(now.state.z)),
        points,
        None if true is None else 1e-3 * true[peak.frame].reshape(-1, 3),
        at[touched],
        force[touched],
    )


def _where(study: Study, peak: Peak, values: dict[str, Any], contact: int) -> str:
    """The place of a contact, in words."""
    if study.columns.named[contact]:
        return str(values[f"{study.columns.slots[contact]}_place"])
    at = 1e3 * peak.estimate.tracked.location_m[contact]
    return f"({', '.join(f'{x:.1f}' for x in at)}) mm"
