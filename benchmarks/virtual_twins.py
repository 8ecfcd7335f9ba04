"""How well a robot tells force, place and shape, calibrated on a few presses of a virtual twin, on others.

    .venv/bin/python benchmarks/virtual_twins.py CONFIG --out FOLDER [--fitted-to 10] [--others 40]

The twin has at least twice the nodes, a silicone that stiffens as the nearest one of the data sheets, parts
off by up to 0.5 mm, a modulus off by up to 10 %, sensors with gains off by up to 3 %, and with zeros, drift
and noise of their own, all drawn from a seed. It is pressed and driven at random. `softfuse calibrate` sees
the first presses; of the others, each of three forces of which is held, printed are: force and place where
`softfuse observe` says of the calibrated robot that its sensors tell both, and where it says they do not,
root mean squares of forces above a fifth of the range; how much of the surface that is; points, of the body's
length; and in which part of them the truth is within 1.645 standard deviations.
"""

import argparse
import json
from pathlib import Path

import numpy as np
from calibrated_pad import run
from scipy.spatial import KDTree

import softfuse as sf
from softfuse.experiment.accuracy import Samples, coverage
from softfuse.experiment.recording_file import write_recording
from softfuse.report.observability import Expected
from softfuse.report.presses import Part

PART, PRESSED = 0.2, 0.4
"""Forces count from this part of the range; `observe` looks at this one."""

GAIN = 0.03
"""By which part readings are off at most."""

BEFORE = 5
"""Frames before a sample that are estimated, too."""

TELL_EVERY = 200
"""Frames after which is told how many have been followed."""


def recorded(settings: sf.RobotSettings, presses: int, seed: int, out: Path) -> Path:
    """A recording of the twin."""
    errors = sf.MakingErrors(chamber_place=0.5e-3, guide=0.5e-3, point=0.5e-3, seed=seed)
    twin = sf.virtual_robot(settings, errors)
    episodes = sf.random_episodes(twin, presses, seed=seed)
    played = sf.performance(twin, episodes, folder=out / "equilibria")
    path = out / "recording.csv.gz"
    write_recording(path, played.recording(seed, seed, gain=GAIN))
    print(*(f"{what}: {how}" for what, how in twin.told.items()), sep="\n", flush=True)
    return path


def observed(robot: sf.Robot, contact: str, force_N: float) -> Expected:
    """What `softfuse observe` says."""
    return sf.expected(
        robot,
        contact,
        force_N,
        side=9,
        place_sigma_m=0.2e-3,
        held_s=1.0,
        begin=lambda total: lambda: None,
    )


def followed(robot: sf.Robot, recording: sf.Recording, every: int) -> sf.Study:
    """A study of every so many frames, all samples, and the frames before these: live, there are no gaps."""
    estimated, tracker = Part.of(recording, every).estimated, sf.Tracker(robot)
    samples = np.flatnonzero(recording.columns["sample"] > 0)
    estimated[np.maximum(samples[:, None] - np.arange(1, BEFORE + 1), 0)] = True
    study = sf.Study(robot, recording.rows(np.flatnonzero(estimated)))
    frames = zip(sf.sensor_frames(robot.settings, recording), estimated.tolist(), strict=True)
    for count, now in enumerate(sf.follow(tracker, frames)):
        study.see(now)
        if count % TELL_EVERY == 0:
            print(f"followed {count} of {estimated.sum()} frames", flush=True)
    return study


def rms(values: np.ndarray) -> float | None:
    """The root mean square; None of nothing."""
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else None


def errors(samples: Samples) -> dict[str, object]:
    """Of a group of samples; those without an estimate are counted apart."""
    found = np.isfinite(samples.force_N) & np.isfinite(samples.location_m).all(axis=1)
    good = samples.only(found)
    return {
        "samples": len(samples.level),
        "without_estimate": int(np.sum(~found)),
        "force_percent": rms(100 * good.force_error),
        "place_mm": rms(1e3 * good.location_error_m),
        "within_90": {name: float(part) for name, part in coverage(good).items()} if found.any() else None,
    }


def compared(fitted: Path, recording: Path, fitted_to: int, every: int) -> dict[str, object]:
    """What a calibrated robot tells of the presses that it was not fitted to, beside the truth."""
    robot = sf.build_robot(sf.load(fitted))
    read = sf.read_sensors(robot.settings, recording)
    study = followed(robot, read, every)
    (contact,) = robot.settings.contacts
    told = observed(robot, contact.name, PRESSED * contact.max_force)
    both = told.force_told & told.place_told
    numbers: dict[str, object] = {"told_of_surface": float(both.mean())}
    samples = study.samples
    if samples is None:
        raise SystemExit(f"{recording} does not hold places and forces of contacts")
    counts = samples.true_force_N > PART * contact.max_force
    press = study.truth.press[study.sampled]
    counts &= press >= fitted_to
    at = samples.true_location_m
    near = KDTree(told.places[:, 0, : at.shape[1]]).query(at)[1]
    numbers["where told"] = errors(samples.only(counts & both[near]))
    numbers["where not told"] = errors(samples.only(counts & ~both[near]))
    shape = study.shape_samples
    if shape is not None:
        later = shape.press >= fitted_to
        off = shape.error_m[later]
        length = float(np.ptp(np.asarray(robot.model.body.rest), axis=0).max())
        numbers["points_percent_of_length"] = rms(100 * off[np.isfinite(off)] / length)
    return numbers


def main() -> None:
    """Record, calibrate, observe, follow, compare."""
    sf.prepare_jax()
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("config", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--fitted-to", type=int, default=10)
    parser.add_argument("--others", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--every", type=int, default=50)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    settings = sf.load(given.config)
    recording = recorded(settings, given.fitted_to + given.others, given.seed, given.out)
    fitted = given.out / "fitted.toml"
    seconds = run(
        "calibrate", given.config, recording, "--presses", f"0-{given.fitted_to - 1}", "--out", fitted
    )
    print(f"calibrated in {seconds:.0f} s", flush=True)
    numbers = compared(fitted, recording, given.fitted_to, given.every)
    print(json.dumps(numbers, indent=2))
    (given.out / "numbers.json").write_text(json.dumps(numbers, indent=2) + "\n")


if __name__ == "__main__":
    main()
