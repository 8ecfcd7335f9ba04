"""A robot fitted to presses of known place and force, written as settings with what it is sure of."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from softfuse.calibration.electrode_edits import with_gains
from softfuse.calibration.fit import fit
from softfuse.calibration.next_press import gain
from softfuse.calibration.of_robot import (
    Fitted,
    adjustments_of_presses,
    build_adjustments,
    calibrated_edits,
)
from softfuse.calibration.presses import Adjustable
from softfuse.errors import SoftfuseError
from softfuse.hardware.recording import Recording
from softfuse.report.calibration import Calibrated, Further, write_report
from softfuse.report.certainty import certainty, further, places_mm, sharpened
from softfuse.report.presses import felt_presses, press_at
from softfuse.robot.file import save_edited
from softfuse.robot.robot import Robot, build_robot

Seen = Callable[[str], Callable[[], None]]
"""Of some work by name, what is called after each part of it."""


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
    beyond = further(fitted, known.applied)
    answer = adjustable.answer(found.value, beyond, seen=seen("looking at further presses"))
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
