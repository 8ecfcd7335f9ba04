r"""How well a pad estimates, calibrated on some presses of a recording, on its other presses.

    .venv/bin/python benchmarks/calibrated_pad.py CONFIG RECORDING --presses 0-4 --out FOLDER \
        [--charts FOLDER]

Runs `softfuse calibrate` on those presses and `softfuse estimate` with what it wrote on all of the
recording, and prints of both groups of samples: means of the force error [%], of all and within the paper's
circle, the largest, of the location error [mm], and in which part of them the truth lies within 1.645
standard deviations, which is 90 % where these are right.
"""

import argparse
import time
from pathlib import Path

import numpy as np

from softfuse.cli import main
from softfuse.cli.calibrate import parse_presses
from softfuse.cli.recorded import sample_frames
from softfuse.experiment.accuracy import WORKSPACE_CIRCLE_M
from softfuse.hardware.recording import read_recording

NINETY = 1.645


def run(*arguments: str | Path) -> float:
    """Seconds that a command took; ends with its exit code if that is not 0."""
    started = time.perf_counter()
    try:
        main([*map(str, arguments)])
    except SystemExit as end:
        if end.code:
            raise
    return time.perf_counter() - started


def shown(
    name: str, estimated: dict[str, np.ndarray], true: dict[str, np.ndarray], which: np.ndarray
) -> None:
    """Print the numbers of a group of samples."""
    off = {key: estimated[key] - true[key] for key in true}
    force = 100 * np.abs(off["force_N"] / true["force_N"])
    circle = np.hypot(true["x_mm"], true["y_mm"]) <= 1e3 * WORKSPACE_CIRCLE_M
    place = np.hypot(off["x_mm"], off["y_mm"])
    inside = {
        key: np.mean(np.abs(off[key][which]) < NINETY * estimated[key.replace("_", "_sigma_")][which])
        for key in true
    }
    print(f"{name}: {which.sum()} samples")
    print(
        f"  force error {force[which].mean():.2f} %, in the circle {force[which & circle].mean():.2f} %, "
        f"largest {force[which].max():.1f} %"
    )
    print(f"  location error {place[which].mean():.3f} mm, largest {place[which].max():.3f} mm")
    print(
        "  within the 90 % interval: "
        + ", ".join(f"{key} {100 * part:.0f} %" for key, part in inside.items())
    )


def main_program() -> None:
    """Calibrate, estimate, compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("config", type=Path)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--presses", required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--charts", type=Path)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    fitted = given.out / "fitted.toml"
    calibrating = run("calibrate", given.config, given.recording, "--presses", given.presses, "--out", fitted)
    charts = () if given.charts is None else ("--charts", given.charts)
    run("estimate", fitted, given.recording, "--out", given.out, "--quiet", *charts)
    recording = read_recording(given.recording, ["press"])
    at = sample_frames(recording)
    found = read_recording(given.out / "estimates.csv", ["force_N"])
    estimated = {name: column[at] for name, column in found.columns.items() if name != "status"}
    true = {name: recording.columns[f"true_{name}"][at] for name in ("x_mm", "y_mm", "force_N")}
    fit_to = np.isin(recording.columns["press"][at], list(parse_presses(given.presses)))
    print(f"calibrated in {calibrating:.0f} s")
    shown("fitted to", estimated, true, fit_to)
    shown("the others", estimated, true, ~fit_to)


if __name__ == "__main__":
    main_program()
