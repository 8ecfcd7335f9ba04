"""softfuse calibrate: fit a device to presses of known place and force, with what it is sure of."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from softfuse.calibration.fit import fit
from softfuse.calibration.next_press import gain
from softfuse.calibration.presses import Adjustable
from softfuse.cli.calibration_report import Calibrated, Further, tell, write_report
from softfuse.cli.device_calibration import AbstractCalibration
from softfuse.cli.felt_presses import chosen_frames, felt_presses
from softfuse.cli.finger_calibration import FingerCalibration
from softfuse.cli.pad_calibration import PadCalibration
from softfuse.cli.recorded import sensor_columns
from softfuse.cli.terminal import Quiet, busy, counted, out_file, stdout
from softfuse.config import DeviceConfig, load, save_edited
from softfuse.config.build_calibration import (
    adjustments_of_presses,
    build_adjustments,
    calibrated_edits,
    fitted_device,
)
from softfuse.config.build_device import build_device
from softfuse.config.build_mesh import build_mesh
from softfuse.errors import SoftfuseError
from softfuse.hardware.recording import Recording, read_recording


def calibrate(
    config: Annotated[Path, typer.Argument(help="Configuration of the device (TOML).")],
    recordings: Annotated[
        list[Path], typer.Argument(help="Recordings with truth columns (.csv or .csv.gz).")
    ],
    out: Annotated[
        Path,
        out_file(help="Configuration to write; beside it go a report, .html, and how sure a pad is, .npz."),
    ],
    presses: Annotated[
        str | None, typer.Option(help="Values of the column `press` to use, such as 0-4; default: all.")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Fit stiffness, contact, cavities and sensors to presses of known place and force."""
    settings = load(config)
    _check_out(out)
    read = [read_recording(path, sensor_columns(settings)) for path in recordings]
    calibrated = calibrated_device(settings, read, out, presses=presses, quiet=quiet)
    if not quiet:
        lines = [*tell(calibrated), f"written to {out}; report: {out.with_suffix('.html')}"]
        stdout.print("\n".join(lines), markup=False, highlight=False, soft_wrap=True)


def calibrated_device(
    settings: DeviceConfig,
    recordings: Sequence[Recording],
    out: Path,
    *,
    presses: str | None = None,
    quiet: bool,
) -> Calibrated:
    """The device of a configuration fitted to presses in recordings, all or those in a list such as "0-4";
    written to `out`, last the report.

    Raises ConfigError for a device that cannot be fitted, RecordingError for a recording without such
    presses, SoftfuseError when presses cannot be explained.
    """
    sealed = settings.sensors is not None and settings.sensors.sealed is not None
    kind: AbstractCalibration = FingerCalibration(settings) if sealed else PadCalibration(settings)
    chosen = [chosen_frames(kind, recording, presses) for recording in recordings]
    with busy("meshing", quiet=quiet):
        mesh = build_mesh(settings)
        device = fitted_device(settings, build_device(settings, mesh))
        may_differ = build_adjustments(settings, device, mesh)
    felt = felt_presses(kind, recordings, chosen, quiet=quiet)
    sharper = kind.sharpened(felt)
    if sharper is not None:
        kind, felt = sharper, felt_presses(sharper, recordings, chosen, quiet=quiet)
    known = felt.presses
    adjustments = adjustments_of_presses(settings, may_differ, known.applied, felt.called)
    adjustable = Adjustable(device, adjustments)
    with counted("fitting", "presses simulated", quiet=quiet) as simulated:
        found = fit(adjustable, known, seen=simulated)
    further = kind.further(known.applied)
    with counted("looking over the workspace", "presses simulated", quiet=quiet) as simulated:
        answer = adjustable.answer(found.value, further, seen=simulated)
    certainty = kind.certainty(felt, found, further, answer, out)
    edits = calibrated_edits(settings, device, adjustments, found.value)
    save_edited(settings.path, out, {**edits, **certainty.edits})
    noise = float(np.median(known.sigma[known.told]))
    next_presses = Further(
        kind.places_mm(further),
        [
            f"{kind.at(further, press)}, {force:.3g} N"
            for press, force in zip(further.press, further.force_N[:, 0], strict=True)
        ],
        gain(found, answer, noise),
    )
    calibrated = Calibrated(settings, kind.quantity, felt, found, certainty.electrodes, next_presses)
    write_report(out.with_suffix(".html"), calibrated)
    return calibrated


def _check_out(out: Path) -> None:
    # Before minutes of work, not after them.
    if out.suffix != ".toml":
        raise SoftfuseError(f"--out {out}: give a file that ends with .toml")
