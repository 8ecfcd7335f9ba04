"""What `softfuse calibrate` tells: parameters with intervals, what presses cannot tell, what would help."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np
from jaxtyping import Float

from softfuse.calibration.adjustment import Measure
from softfuse.calibration.array_pose import PoseFit
from softfuse.calibration.fit import Fit
from softfuse.calibration.posterior import AbstractPosterior
from softfuse.calibration.presses import Presses
from softfuse.config import DeviceConfig
from softfuse.experiment.accuracy import NINETY
from softfuse.experiment.calibration_figures import misfits, usefulness
from softfuse.experiment.report import page, picture, table

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


@dataclass(frozen=True, eq=False)
class Further:
    """Further presses at places (s, 3) m with forces (s,) N, and what each would tell (s,) [nat]."""

    place_m: Float[np.ndarray, "s 3"]
    force_N: Float[np.ndarray, " s"]
    gain: Float[np.ndarray, " s"]

    @property
    def best(self) -> int:
        """The one that would tell most."""
        return int(np.argmax(self.gain))


@dataclass(frozen=True, eq=False)
class Calibrated:
    """A configuration, the presses it was fitted to with what people call them, the fit, the pose of its
    electrodes if it has such, and what may be pressed next.
    """

    config: DeviceConfig
    presses: Presses
    called: dict[int, str]
    fit: Fit
    pose: PoseFit | None
    further: Further


def tell(calibrated: Calibrated) -> Iterator[str]:
    """The lines that people read at once."""
    fit, presses = calibrated.fit, calibrated.presses
    before, after = (1e9 * _rms(each[presses.told]) for each in (fit.before, fit.after))
    count = len(np.unique(presses.press))
    off = f"volumes off by {before:.1f} mm³ before, {after:.1f} after"
    yield f"{len(presses.force_N)} samples of {count} presses: {off}"
    yield f"the model may be wrong by {100 * fit.discrepancy.part:.1f} % of a volume"
    for name, value, width, told in [*_rows(fit), *_rows(calibrated.pose)]:
        yield f"{name}: {value} ± {width} (90 %), {told}"
    if calibrated.pose is not None:
        yield _spreading(calibrated.pose)
    for a, b, correlation in _inseparable(fit):
        yield f"{a} and {b} cannot be told apart (correlated {correlation:+.2f})"
    for k, press, weight in _doubtful(calibrated):
        yield f"cavity {k} in press {press} is not explained and counts {100 * weight:.0f} % only"
    yield _next(calibrated.further)


def write_report(path: Path, calibrated: Calibrated) -> None:
    """Write the report, one HTML file."""
    fit, presses = calibrated.fit, calibrated.presses
    names = [cavity.name for cavity in calibrated.config.cavities]
    pairs = [(a, b, f"{correlation:+.2f}") for a, b, correlation in _inseparable(fit)]
    by_press = []
    for number in np.unique(presses.press):
        on = (presses.press == number)[:, None] & presses.told
        place = 1e3 * presses.place_m[presses.press == number][0]
        rms = [f"{1e9 * _rms(each[on]):.1f}" for each in (fit.before, fit.after)]
        by_press.append((calibrated.called[number], f"({place[0]:.1f}, {place[1]:.1f})", *rms))
    doubtful = [(press, k, f"{weight:.2f}") for k, press, weight in _doubtful(calibrated)]
    head = ("parameter", "fitted", "± 90 %", "what the presses tell")
    sections = [
        (
            "Parameters",
            table(head, [*_rows(fit), *_rows(calibrated.pose)])
            + _paragraph(
                "Stiffness: factor on all moduli. Stiffness field: factor on them, over what is configured, "
                "at the far end of the body along x, y or z, where both axes end for products such as xy, at "
                "both ends of an axis for squares such as xx. Stiffening: Yeoh's c2 over c1 that is added. "
                "Layer: compliance between disc and body, over the configured one or, where none is, over "
                "that of a hundredth of the disc's radius per shear modulus."
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
            table(("press", "at [mm]", "before [mm³]", "after [mm³]"), by_press)
            + picture(
                misfits(1e9 * presses.reading, 1e9 * fit.before, 1e9 * fit.after, names),
                "Measured minus modelled volume changes over measured ones, before and after the fit; "
                "before: as configured, but for a layer of such a compliance where none is configured.",
            ),
        ),
    ]
    if calibrated.pose is not None:
        sections.append(("Locations", _paragraph(_spreading(calibrated.pose))))
    if doubtful:
        sections.append(("Readings that nothing explains", table(("press", "cavity", "weight"), doubtful)))
    most = calibrated.further
    sections.append(
        (
            "The next press",
            _paragraph(_next(most))
            + picture(
                usefulness(1e3 * most.place_m[:, :2], most.gain), "What one more press would tell [nat]."
            ),
        )
    )
    path.write_text(page(f"{calibrated.config.device.name}: calibration", sections), encoding="utf-8")


def _paragraph(text: str) -> str:
    return f"<p>{escape(text)}</p>"


def _spreading(pose: PoseFit) -> str:
    before, after = (1e3 * _rms(np.linalg.norm(each, axis=1)) for each in (pose.before_m, pose.after_m))
    return (
        f"locations off by {before:.3f} mm before, {after:.3f} after; they spread {pose.factor:.2f} times as "
        "wide as their fits promise"
    )


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
    """Cavity, press and weight of the readings that count little."""
    fit, presses = calibrated.fit, calibrated.presses
    full = np.max(fit.weight)
    found = []
    for number in np.unique(presses.press):
        weight = np.max(fit.weight[presses.press == number], axis=0) / full
        told = np.any(presses.told[presses.press == number], axis=0)
        for k in np.flatnonzero(told & (weight < _OFF)):
            found.append((calibrated.config.cavities[k].name, calibrated.called[number], float(weight[k])))
    return found


def _next(further: Further) -> str:
    best = further.best
    x, y = 1e3 * further.place_m[best, :2]
    return (
        f"one more press would tell most at ({x:.0f}, {y:.0f}) mm with {further.force_N[best]:.1f} N: "
        f"{further.gain[best]:.2f} nat, {np.median(further.gain):.2f} elsewhere"
    )


def _rms(values: Float[np.ndarray, " n"]) -> float:
    return float(np.sqrt(np.mean(values**2)))
