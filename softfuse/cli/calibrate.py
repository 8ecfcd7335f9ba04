"""softfuse calibrate: fit the stiffness of a device to presses of known force."""

import re
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from softfuse.calibration.stiffness import fit_stiffness
from softfuse.cli.recorded import sample_frames, samples_at, sensor_columns, sensor_frames
from softfuse.cli.terminal import Quiet, busy, stdout, tracked
from softfuse.config import load, save_edited, stiffness_edits
from softfuse.config.build_device import build_device
from softfuse.config.build_tracker import build_tracker
from softfuse.errors import RecordingError, SoftfuseError
from softfuse.hardware.recording import Recording, read_recording
from softfuse.sensing.status import Status


def calibrate(
    config: Annotated[Path, typer.Argument(help="Configuration of the device (TOML).")],
    recording: Annotated[Path, typer.Argument(help="Recording with truth columns (.csv or .csv.gz).")],
    out: Annotated[Path, typer.Option(help="Configuration to write.")],
    presses: Annotated[
        str | None, typer.Option(help="Values of the column `press` to use, such as 0-4; default: all.")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Fit one factor on all moduli to the true forces of a recording."""
    settings = load(config)
    frames = read_recording(recording, sensor_columns(settings))
    at = _chosen_frames(frames, presses)
    with busy("meshing", quiet=quiet):
        device = build_device(settings)
    with busy("compiling", quiet=quiet):
        tracker = build_tracker(settings, device)
    last = int(at.max()) + 1
    found = [
        tracker.update(frame)
        for frame in tracked(sensor_frames(settings, frames)[:last], "estimating", total=last, quiet=quiet)
    ]
    samples = samples_at(frames, found, at)
    # A force at its limit says only that the true one is no smaller.
    limited = np.array([Status.force_limit in found[i].statuses for i in at])
    fit = fit_stiffness(np.where(limited, np.nan, samples.force_N), samples.true_force_N)
    save_edited(config, out, stiffness_edits(settings, fit.factor))
    if not quiet:
        stdout.print(
            f"moduli times {fit.factor:.4f} ± {fit.standard_error:.4f} from {fit.n} samples\n"
            f"written to {out}",
            markup=False,
            highlight=False,
            soft_wrap=True,
        )


def _chosen_frames(recording: Recording, presses: str | None) -> np.ndarray:
    at = sample_frames(recording)
    if not at.size:
        raise RecordingError(
            f"the recording {recording.path} has no samples with known force: calibration needs the columns "
            "sample (1, 2, ... where the force is held), true_x_mm, true_y_mm and true_force_N"
        )
    if presses is None:
        return at
    wanted = parse_presses(presses)
    at = at[np.isin(recording.matrix(["press"])[at, 0], list(wanted))]
    if not at.size:
        raise RecordingError(f"the recording {recording.path} has no samples in the presses {presses}")
    return at


def parse_presses(text: str) -> set[int]:
    """The numbers in a list such as "0-4,7"; raises SoftfuseError when it is something else."""
    wanted: set[int] = set()
    for part in text.split(","):
        ends = re.fullmatch(r"\s*(\d+)(?:-(\d+))?\s*", part)
        if ends is None:
            raise SoftfuseError(f'--presses "{text}" is no list of numbers: give one such as 0-4 or 0,2,5-7')
        first = int(ends[1])
        wanted |= set(range(first, int(ends[2] or first) + 1))
    return wanted
