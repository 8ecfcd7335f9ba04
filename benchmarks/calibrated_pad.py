"""How well a pad estimates, calibrated on some presses of a recording, on its other presses.

    .venv/bin/python benchmarks/calibrated_pad.py CONFIG RECORDING --presses 0-4 --out FOLDER

Runs `softfuse calibrate` on those presses and `softfuse estimate` with what it wrote on every tenth frame and
all samples of the recording, and prints of both groups of samples: means of the force error [%], of all and
within the paper's circle, the largest, of the location error [mm], and in which part of them the truth lies
within 1.645 standard deviations, which is 90 % where these are right.
"""

import argparse
import time
from pathlib import Path

import numpy as np

from softfuse.cli import main
from softfuse.experiment.accuracy import Samples, coverage, force_table
from softfuse.hardware.recording import read_recording
from softfuse.report.columns import Columns
from softfuse.report.presses import parse_presses
from softfuse.report.truth import Truth
from softfuse.robot.file import load
from softfuse.robot.robot import build_robot


def run(*arguments: str | Path) -> float:
    """Seconds that a command took; ends with its exit code if that is not 0."""
    started = time.perf_counter()
    try:
        main([*map(str, arguments)])
    except SystemExit as end:
        if end.code:
            raise
    return time.perf_counter() - started


def shown(name: str, samples: Samples) -> None:
    """Print the numbers of a group of samples."""
    force, place = 100 * samples.force_error, 1e3 * samples.location_error_m
    circle = force_table(samples)["circle"].scaled(100)
    print(f"{name}: {len(force)} samples")
    print(
        f"  force error {force.mean():.2f} %, in the circle {circle.mean:.2f} %, largest {force.max():.1f} %"
    )
    print(f"  location error {place.mean():.3f} mm, largest {place.max():.3f} mm")
    parts = (f"{key} {100 * part:.0f} %" for key, part in coverage(samples).items())
    print("  within the 90 % interval: " + ", ".join(parts))


def main_program() -> None:
    """Calibrate, estimate, compare."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("config", type=Path)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--presses", required=True)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    fitted = given.out / "fitted.toml"
    calibrating = run("calibrate", given.config, given.recording, "--presses", given.presses, "--out", fitted)
    run("estimate", fitted, given.recording, "--out", given.out, "--every", "10", "--quiet")
    recording = read_recording(given.recording, ["press"])
    truth = Truth.of(recording, Columns(build_robot(load(given.config))))
    at = truth.samples(["x_mm", "y_mm", "force_N"])
    at = at[truth.get("force_N")[at] > 0]
    found = read_recording(given.out / "estimates.csv", ["force_N"])
    sampled = np.isin(np.round(found.time_s, 4), np.round(recording.time_s[at], 4))
    said = {name: column[sampled] for name, column in found.columns.items()}
    true = {name: truth.get(name)[at] for name in ("x_mm", "y_mm", "force_N")}
    samples = Samples(
        level=truth.level[at],
        location_m=1e-3 * np.stack([said["x_mm"], said["y_mm"]], axis=1),
        force_N=said["force_N"],
        true_location_m=1e-3 * np.stack([true["x_mm"], true["y_mm"]], axis=1),
        true_force_N=true["force_N"],
        location_sigma_m=1e-3 * np.stack([said["x_sigma_mm"], said["y_sigma_mm"]], axis=1),
        force_sigma_N=said["force_sigma_N"],
    )
    fit_to = np.isin(truth.press[at], list(parse_presses(given.presses)))
    print(f"calibrated in {calibrating:.0f} s")
    shown("fitted to", samples.only(fit_to))
    shown("the others", samples.only(~fit_to))


if __name__ == "__main__":
    main_program()
