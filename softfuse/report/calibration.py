"""What `softfuse calibrate` tells: parameters with intervals, what presses cannot tell, what would help."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float

from softfuse.calibration.adjustment import Measure
from softfuse.calibration.array_pose import PoseFit
from softfuse.calibration.electrode_edits import Untouched, with_gains
from softfuse.calibration.electrode_gains import GainFit
from softfuse.calibration.fit import AbstractPosterior, Fit, fit, gain
from softfuse.calibration.of_robot import (
    Fitted,
    adjustments_of_presses,
    build_adjustments,
    calibrated_edits,
)
from softfuse.calibration.presses import Adjustable
from softfuse.errors import SoftfuseError
from softfuse.experiment.accuracy import NINETY
from softfuse.hardware.recording import Recording
from softfuse.report.certainty import Electrodes, certainty, further, places_mm, sharpened
from softfuse.report.columns import Unit, unit_of
from softfuse.report.figures import misfits, usefulness
from softfuse.report.page import page, picture, table
from softfuse.report.presses import Felt, felt_presses, press_at
from softfuse.robot.file import save_edited
from softfuse.robot.robot import Robot, build_robot
from softfuse.robot.settings import RobotSettings
from softfuse.sensors.crossed.settings import CrossedSettings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TOLD = 0.5
"""A parameter of whose variance the presses took less than this is called not told."""

_ALIKE = 0.9
"""Parameters that are correlated by more cannot be told apart."""

_WRITTEN: dict[Measure, Callable[[float, float], tuple[str, str]]] = {
    Measure.factor: lambda value, width: (f"× {np.exp(value):.4f}", f"{np.exp(value) * width:.4f}"),
    Measure.ratio: lambda value, width: (f"{value:+.3f}", f"{width:.3f}"),
    Measure.angle: lambda value, width: (f"{np.rad2deg(value):+.3f}°", f"{np.rad2deg(width):.3f}"),
    Measure.length: lambda value, width: (f"{1e3 * value:+.3f} mm", f"{1e3 * width:.3f}"),
}
"""A parameter and half of its interval, as people read them."""

_OFF = 0.2
"""Readings of a press that count less than this part of what they would if they fitted are told."""

Seen = Callable[[str], Callable[[], None]]
"""Of some work by name, what is called after each part of it."""


@dataclass(frozen=True, eq=False)
class Further:
    """Further presses: places (s, 2) mm if there is a map, what each (s,) is called, its gain (s,) [nat]."""

    place_mm: Float[np.ndarray, "s 2"] | None
    called: Sequence[str]
    gain: Float[np.ndarray, " s"]

    @property
    def best(self) -> int:
        """The one that would tell most."""
        return int(np.argmax(self.gain))


@dataclass(frozen=True, eq=False)
class Calibrated:
    """The fitted robot, its presses, the fit, what was found of crossed electrodes, what to press next."""

    fitted: Fitted
    felt: Felt
    fit: Fit
    electrodes: Electrodes
    further: Further

    @property
    def sensors(self) -> list[tuple[str, Unit, Bool[np.ndarray, " k"]]]:
        """Of each sensor that was fitted its name, the unit of its readings and which (k,) they are."""
        names, units = list(self.fitted.robot.addresses.readings), self.fitted.robot.suite.units
        return [
            (names[kind], unit_of(units[self.fitted.readings[own][0]]), own)
            for kind in np.unique(self.fitted.kind)
            for own in [self.fitted.kind == kind]
        ]

    def off(self, on: Bool[np.ndarray, "s k"]) -> list[str]:
        """By how much readings (s, k) are off before and after the fit, of each sensor."""
        said = []
        for name, unit, own in self.sensors:
            which = on & own
            if which.any():
                before, after = (
                    unit.factor * _rms(each[which]) for each in (self.fit.before, self.fit.after)
                )
                said.append(f"{name} off by {before:.3g} {unit.label} before, {after:.3g} after")
        return said

    @property
    def rows(self) -> list[tuple[str, str, str, str]]:
        """All parameters: see `_rows`."""
        found = (self.fit, self.electrodes.pose, self.electrodes.gains)
        return [row for each in found for row in _rows(each)]


def tell(calibrated: Calibrated) -> Iterator[str]:
    """The lines that people read at once."""
    fit, presses = calibrated.fit, calibrated.felt.presses
    off = "; ".join(calibrated.off(presses.told))
    yield f"{len(presses.reading)} samples of {len(calibrated.felt.called)} presses: {off}"
    parts, floors = (
        calibrated.fitted.by_sensor(each) for each in (fit.discrepancy.part, fit.discrepancy.floor)
    )
    for name, part in parts.items():
        wrong = f"{100 * part:.1f} % of a reading, and {100 * part * floors[name]:.2g} % of the largest"
        yield f"the model may be wrong by {wrong}" + (f", of {name}" if len(parts) > 1 else "")
    for name, value, width, told in calibrated.rows:
        yield f"{name}: {value} ± {width} (90 %), {told}"
    electrodes = calibrated.electrodes
    if electrodes.pose is not None:
        yield _spreading(electrodes.pose)
    if electrodes.gains is not None:
        yield _relative(electrodes.gains)
    if electrodes.untouched is not None:
        yield _at_rest(electrodes.untouched)
    for a, b, correlation in _inseparable(fit):
        yield f"{a} and {b} cannot be told apart (correlated {correlation:+.2f})"
    for k, press, weight in _doubtful(calibrated):
        yield f"{k} in press {press} is not explained and counts {100 * weight:.0f} % only"
    yield _next(calibrated.further)


def write_report(path: Path, calibrated: Calibrated) -> None:
    """Write the report, one HTML file."""
    fit, presses = calibrated.fit, calibrated.felt.presses
    pairs = [(a, b, f"{correlation:+.2f}") for a, b, correlation in _inseparable(fit)]
    by_press = []
    for number, called in calibrated.felt.called.items():
        on = (presses.applied.press == number)[:, None] & presses.told
        by_press.append((called, calibrated.felt.at[number], "; ".join(calibrated.off(on))))
    doubtful = [(press, k, f"{weight:.2f}") for k, press, weight in _doubtful(calibrated)]
    head = ("parameter", "fitted", "± 90 %", "what the presses tell")
    sections = [
        (
            "Parameters",
            table(head, calibrated.rows)
            + _paragraph(
                "Stiffness: factor on all moduli. Stiffness field: factor on them, over what is configured, "
                "at the far end of the body along x, y or z, where both axes end for products such as xy, at "
                "both ends of an axis for squares such as xx. Stiffening: Yeoh's c2 over c1 that is added. "
                "Layer: compliance between disc and body, over the configured one or, where none is, over "
                "that of a hundredth of the disc's radius per shear modulus. Compliance of a cable: over the "
                "configured one or, where none is, over that which lets it stretch by a thousandth under its "
                "largest tension. Place: where along an electrode a contact of a press acts."
            ),
        ),
        (
            "What cannot be told apart",
            table(("parameter", "and", "correlation"), pairs)
            if pairs
            else _paragraph(f"No two parameters are correlated by more than {_ALIKE}."),
        ),
        (
            "Misfits",
            table(("press", "at", "readings"), by_press)
            + "".join(
                picture(
                    _misfits(calibrated, sensor),
                    f"{sensor[0]}: measured minus modelled readings over measured ones, before and after the "
                    "fit; before: as configured, but for layers and cables of typical compliance "
                    "where none is configured.",
                )
                for sensor in calibrated.sensors
            ),
        ),
    ]
    electrodes = calibrated.electrodes
    if electrodes.pose is not None:
        sections.append(("Locations", _paragraph(_spreading(electrodes.pose))))
    if electrodes.gains is not None:
        sections.append(("Gains of electrodes", _paragraph(_relative(electrodes.gains))))
    if electrodes.untouched is not None:
        sections.append(
            ("Electrodes untouched", _untouched(calibrated.fitted.robot.settings, electrodes.untouched))
        )
    if doubtful:
        sections.append(("Readings that nothing explains", table(("press", "reading", "weight"), doubtful)))
    most = calibrated.further
    sections.append(
        (
            "The next press",
            _paragraph(_next(most)) + _map(most),
        )
    )
    path.write_text(page(f"{calibrated.fitted.robot.name}: calibration", sections), encoding="utf-8")


def _misfits(calibrated: Calibrated, sensor: tuple[str, Unit, Bool[np.ndarray, " k"]]) -> "Figure":
    fit, (_, unit, own) = calibrated.fit, sensor
    names = [name for name, on in zip(calibrated.fitted.names, own, strict=True) if on]
    reading, before, after = (
        unit.factor * each[:, own] for each in (calibrated.felt.presses.reading, fit.before, fit.after)
    )
    return misfits(reading, before, after, names, unit.label)


def _map(further: Further) -> str:
    if further.place_mm is None:
        rows = sorted(zip(further.called, further.gain, strict=True), key=lambda row: -row[1])
        return table(("press", "tells [nat]"), [(called, f"{gain:.2f}") for called, gain in rows])
    return picture(usefulness(further.place_mm, further.gain), "What one more press would tell [nat].")


def _paragraph(text: str) -> str:
    return f"<p>{escape(text)}</p>"


def _spreading(pose: PoseFit) -> str:
    before, after = (1e3 * _rms(np.linalg.norm(each, axis=1)) for each in (pose.before_m, pose.after_m))
    return (
        f"locations off by {before:.3f} mm before, {after:.3f} after; they spread {pose.factor:.2f} times as "
        f"wide as their fits promise, and by {100 * pose.dent_part:.2g} % of the depth of the dent besides"
    )


def _relative(gains: GainFit) -> str:
    width = 100 * NINETY * np.median(gains.relative_sigma)
    return (
        "a gain that all rows, or all columns, have in common cannot be told from a touch's strength; over "
        f"their mean gains are known to ± {width:.2f} % (90 %, median)"
    )


def _at_rest(found: Untouched) -> str:
    return (
        f"electrodes untouched: {found.counts.min():.0f} to {found.counts.max():.0f} counts, standard "
        f"deviation of a reading {np.median(found.sigma):.1f} (median), by noise and drift while recorded"
    )


def _untouched(config: RobotSettings, found: Untouched) -> str:
    lines = config.sensors_of(CrossedSettings)[0].channels
    rows = [
        (line, f"{counts:.1f}", f"{sigma:.1f}")
        for line, counts, sigma in zip(lines, found.counts, found.sigma, strict=True)
    ]
    head = ("electrode", "reads [counts]", "standard deviation of a reading")
    return table(head, rows) + _paragraph(_at_rest(found))


def _rows(fit: AbstractPosterior | None) -> list[tuple[str, str, str, str]]:
    """Name, fitted value, half of its 90 % interval, and whether the presses tell it; none without a fit."""
    if fit is None:
        return []
    rows = []
    told_of = zip(fit.names, fit.measures, fit.value, NINETY * fit.sigma, fit.told, strict=True)
    for name, measure, value, width, told in told_of:
        said = f"{100 * told:.0f} % told" if told >= _TOLD else f"not told ({100 * told:.0f} %)"
        rows.append((name, *_WRITTEN[measure](value, width), said))
    return rows


def _inseparable(fit: Fit) -> list[tuple[str, str, float]]:
    first, second = np.triu_indices(len(fit.names), 1)
    return [
        (fit.names[a], fit.names[b], float(fit.correlation[a, b]))
        for a, b in zip(first, second, strict=True)
        if abs(fit.correlation[a, b]) > _ALIKE
    ]


def _doubtful(calibrated: Calibrated) -> list[tuple[str, str, float]]:
    """Reading, press and weight of those that count little."""
    fit, presses = calibrated.fit, calibrated.felt.presses
    full = np.max(fit.weight)
    found = []
    for number, called in calibrated.felt.called.items():
        on = presses.applied.press == number
        weight = np.max(fit.weight[on], axis=0) / full
        told = np.any(presses.told[on], axis=0)
        for k in np.flatnonzero(told & (weight < _OFF)):
            found.append((calibrated.fitted.names[k], called, float(weight[k])))
    return found


def _next(further: Further) -> str:
    best = further.best
    return (
        f"one more press would tell most at {further.called[best]}: "
        f"{further.gain[best]:.2f} nat, {np.median(further.gain):.2f} elsewhere"
    )


def _rms(values: Float[np.ndarray, " n"]) -> float:
    return float(np.sqrt(np.mean(values**2)))


def calibrated_robot(
    robot: Robot, recordings: Sequence[Recording], out: Path, *, presses: str | None = None, seen: Seen
) -> Calibrated:
    """A robot fitted to presses in recordings, all or those in a list such as "0-4"; written to `out`, last
    the report beside it.

    Raises ConfigError for a robot that cannot be fitted, RecordingError for a recording without such presses,
    SoftfuseError when presses cannot be explained.
    """
    fitted = Fitted.of(robot)
    may_differ = build_adjustments(fitted)
    felt = felt_presses(fitted, recordings, presses, seen=seen("sensing"))
    gains = sharpened(felt, robot.settings, robot.suite.contact_sensors)
    if gains is not None:
        robot = build_robot(with_gains(robot.settings, gains), robot.mesh)
        fitted = Fitted.of(robot)
        felt = felt_presses(fitted, recordings, presses, seen=seen("sensing"))
    known = felt.presses
    adjustments = adjustments_of_presses(fitted, may_differ, known.applied, felt.called)
    adjustable = Adjustable(fitted.model, adjustments)
    found = fit(adjustable, known, seen=seen("fitting"))
    beyond, near = further(fitted, known.applied, found.states)
    answer = adjustable.answer(
        found.value,
        beyond,
        near=near,
        # A grid has all of its places.
        needed=robot.settings.contacts[0].within is not None,
        seen=seen("looking at further presses"),
    )
    beyond = beyond.only(answer.sample)
    sure, electrodes = certainty(fitted, felt, found, answer, beyond, gains, out)
    edits = calibrated_edits(fitted, adjustments, found.value)
    save_edited(robot.settings.path, out, {**edits, **sure})
    told = np.where(known.told, known.sigma, np.nan)
    noise = np.nan_to_num(np.nanmedian(told, axis=0), nan=np.inf)
    called = [
        f"{press_at(fitted, beyond, press)}, {force:.3g} N"
        for press, force in zip(beyond.press, beyond.force_N[:, 0], strict=True)
    ]
    tells = gain(found, answer, noise, known.kind)
    more = Further(places_mm(robot.settings, beyond), called, tells)
    calibrated = Calibrated(fitted, felt, found, electrodes, more)
    write_report(out.with_suffix(".html"), calibrated)
    return calibrated


def check_out(out: Path) -> None:
    """Raise SoftfuseError unless a calibrated robot can be written to a file."""
    if out.suffix != ".toml":
        raise SoftfuseError(f"--out {out}: give a file that ends with .toml")
    if not out.parent.is_dir():
        raise SoftfuseError(f"--out {out}: there is no folder {out.parent}")
