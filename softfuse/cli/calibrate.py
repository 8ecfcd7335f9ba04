"""softfuse calibrate: fit a device to presses of known place and force, with what it is sure of."""

import re
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from jaxtyping import Int

from softfuse.calibration.array_pose import Located, fit_pose
from softfuse.calibration.fit import Fit, fit
from softfuse.calibration.grid import Grid
from softfuse.calibration.next_press import gain
from softfuse.calibration.presses import Adjustable, Presses
from softfuse.cli.calibration_report import Calibrated, Further, tell, write_report
from softfuse.cli.recorded import sample_frames, sensor_columns, sensor_frames
from softfuse.cli.terminal import Quiet, busy, counted, stdout, tracked
from softfuse.config import DeviceConfig, load, save_edited
from softfuse.config.build_calibration import (
    build_adjustments,
    build_pose_prior,
    calibrated_edits,
    pose_edits,
)
from softfuse.config.build_device import build_device
from softfuse.config.build_mesh import build_mesh
from softfuse.config.build_tracker import build_senses
from softfuse.config.contact import DiscSettings
from softfuse.errors import RecordingError, SoftfuseError
from softfuse.estimation.compiled_senses import CompiledSenses
from softfuse.estimation.reading_spread import write_spread
from softfuse.hardware.recording import Recording, read_recording
from softfuse.sensing.senses import Sensed


def calibrate(
    config: Annotated[Path, typer.Argument(help="Configuration of the device (TOML).")],
    recordings: Annotated[
        list[Path], typer.Argument(help="Recordings with truth columns (.csv or .csv.gz).")
    ],
    out: Annotated[
        Path,
        typer.Option(
            help="Configuration to write; beside it go what is uncertain, as .npz, and a report, as .html."
        ),
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
    chosen = [_chosen_frames(recording, presses) for recording in read]
    calibrated = calibrated_device(settings, read, chosen, out, quiet=quiet)
    if not quiet:
        files = ", ".join(str(out.with_suffix(kind)) for kind in (".npz", ".html"))
        lines = [*tell(calibrated), f"written to {out}, {files}"]
        stdout.print("\n".join(lines), markup=False, highlight=False, soft_wrap=True)


def calibrated_device(
    settings: DeviceConfig,
    recordings: Sequence[Recording],
    chosen: Sequence[Int[np.ndarray, " s"]],
    out: Path,
    *,
    quiet: bool,
) -> Calibrated:
    """The device of a configuration fitted to some frames (s,) of each recording; written to `out`, last the
    report.

    Raises ConfigError for a device that cannot be fitted, SoftfuseError when presses cannot be explained.
    """
    with busy("meshing", quiet=quiet):
        mesh = build_mesh(settings)
        device = build_device(settings, mesh)
        adjustments = build_adjustments(settings, device, mesh)
    felt = _felt_presses(settings, recordings, chosen, quiet=quiet)
    known, called = felt.presses, felt.called
    adjustable = Adjustable(device, adjustments)
    with counted("fitting", "presses simulated", quiet=quiet) as simulated:
        found = fit(adjustable, known, seen=simulated)
    assert isinstance(settings.contact, DiscSettings)  # build_adjustments has told
    area = settings.contact.workspace
    grid = Grid.over(area.x, area.y, float(known.force_N.max()))
    pose = None
    if felt.located is not None:
        pose = fit_pose(felt.located, build_pose_prior(settings), grid.place_m[:, :2])
    with counted("looking over the workspace", "presses simulated", quiet=quiet) as simulated:
        answer = adjustable.answer(found.value, grid.place_m, grid.force_N, seen=simulated)
    spread_path = out.with_suffix(".npz")
    write_spread(spread_path, grid.spread(answer, found.covariance), **_posterior(found))
    edits = {
        **calibrated_edits(settings, device, adjustments, found.value),
        **pose_edits(settings, pose),
        ("estimator", "model_error"): float(f"{found.discrepancy.part:.4g}"),
        ("estimator", "reading_spread"): spread_path.name,
    }
    save_edited(settings.path, out, edits)
    noise = float(np.median(known.sigma[known.told]))
    further = Further(grid.place_m, grid.force_N, gain(found, answer, noise))
    calibrated = Calibrated(settings, known, called, found, pose, further)
    write_report(out.with_suffix(".html"), calibrated)
    return calibrated


def _check_out(out: Path) -> None:
    # Before minutes of work, not after them.
    if out.suffix != ".toml":
        raise SoftfuseError(f"--out {out}: give a file that ends with .toml")
    if not out.parent.is_dir():
        raise SoftfuseError(f"--out {out}: there is no folder {out.parent}")


def _chosen_frames(recording: Recording, presses: str | None) -> Int[np.ndarray, " s"]:
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


@dataclass(frozen=True, eq=False)
class _Felt:
    """What the sensors say of presses: their readings, where crossed electrodes place them (None without
    such), and what to call each press.
    """

    presses: Presses
    located: Located | None
    called: dict[int, str]


def _felt_presses(
    settings: DeviceConfig,
    recordings: Sequence[Recording],
    chosen: Sequence[Int[np.ndarray, " s"]],
    *,
    quiet: bool,
) -> _Felt:
    """The samples of all recordings; the presses of different ones are different."""
    parts, found, called = list[Presses](), list[Sensed](), dict[int, str]()
    with ThreadPoolExecutor(1) as aside:
        senses = CompiledSenses(build_senses(settings), aside)
        for recording, at in zip(recordings, chosen, strict=True):
            last = int(at.max()) + 1
            frames = sensor_frames(settings, recording)[:last]
            senses.reset()
            sensed = [
                senses.update(frame.time_s, frame.readings)
                for frame in tracked(frames, "sensing", total=last, quiet=quiet)
            ]
            found += [sensed[i].sensed for i in at]
            known = _samples(recording, at, found[-len(at) :])
            names, number = np.unique(known.press, return_inverse=True)
            where = f" of {recording.path.name}" if len(recordings) > 1 else ""
            parts.append(replace(known, press=number + len(called)))
            called |= {
                k + len(called): f"{name if name >= 0 else 'without number'}{where}"
                for k, name in enumerate(names)
            }
    whole = {
        each.name: np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(Presses)
    }
    presses = Presses(**whole)
    assert settings.sensors is not None  # its frames have been read
    return _Felt(presses, _located(presses, found) if settings.sensors.crossed else None, called)


def _located(presses: Presses, sensed: Sequence[Sensed]) -> Located | None:
    """Where the electrodes place the samples that they feel; None when they feel none."""
    location = np.array([np.asarray(each.location_m)[0, :2] for each in sensed])
    sigma = np.array([np.asarray(each.location_sigma_m)[0] for each in sensed])
    on = np.isfinite(location).all(axis=1) & np.isfinite(sigma).all(axis=1)
    if not on.any():
        return None
    return Located(presses.place_m[on, :2], location[on], sigma[on], presses.press[on])


def _samples(recording: Recording, at: Int[np.ndarray, " s"], sensed: list[Sensed]) -> Presses:
    columns = recording.columns
    place = 1e-3 * np.stack([columns["true_x_mm"][at], columns["true_y_mm"][at], 0.0 * at], axis=1)
    # A sample of no known press is one by itself.
    press = columns["press"][at] if "press" in columns else np.full(len(at), np.nan)
    press = np.where(np.isfinite(press), press, -1 - np.arange(len(at)))
    # What nothing is felt to touch has read nothing.
    valid = np.array([each.valid & each.touching.any() for each in sensed])
    return Presses(
        place,
        columns["true_force_N"][at],
        np.array([each.reading for each in sensed]),
        np.where(valid, np.array([each.sigma for each in sensed]), np.inf),
        press.astype(int),
    )


def _posterior(found: Fit) -> dict[str, np.ndarray]:
    """What the file of the spread says of parameters besides."""
    return {
        "names": np.array(found.names),
        "value": found.value,
        "covariance": found.covariance,
        "prior_sigma": found.prior_sigma,
    }
