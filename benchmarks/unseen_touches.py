"""How well a pad finds touches that its electrodes do not see, by its cavities alone.

    .venv/bin/python benchmarks/unseen_touches.py CONFIG RECORDING [--charts FOLDER]

The recording's flow is as it is, while the electrodes stay as they are in its first frame, but for their
noise: so the same presses would look to them, were the indenter of a foam that does not conduct. Prints
errors of place and force at the recording's samples, how sure the tracker says it is, and how many of the
true values are within its 90 % intervals.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from softfuse.computing.prepare import prepare_jax
from softfuse.estimation.stream import follow
from softfuse.estimation.tracked import Frame
from softfuse.estimation.tracker import Tracker
from softfuse.experiment.accuracy import coverage
from softfuse.hardware.recording import Recording
from softfuse.report.presses import read_sensors, sensor_frames
from softfuse.report.study import Study
from softfuse.robot.file import load
from softfuse.robot.reduced import with_charts
from softfuse.robot.robot import Robot, build_robot
from softfuse.sensors.crossed.settings import CrossedSettings


def blinded(robot: Robot, recording: Recording) -> Iterator[Frame]:
    """The recording's frames, with electrodes that nothing comes near."""
    (electrodes,) = robot.settings.sensors_of(CrossedSettings)
    rng, noise, still = np.random.default_rng(0), electrodes.noise_counts, np.zeros(0)
    at = [robot.settings.channels.index(channel) for channel in electrodes.columns]
    for frame in sensor_frames(robot.settings, recording):
        raw = np.array(frame.raw)
        still = still if still.size else raw[at]
        raw[at] = np.round(still + rng.normal(0.0, noise, still.shape))
        yield Frame(frame.time_s, raw)


def main() -> None:
    """Follow, compare, print."""
    prepare_jax()
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("config", type=Path)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--charts", type=Path)
    given = parser.parse_args()
    robot = build_robot(load(given.config))
    tracker = Tracker(robot, with_charts(robot, given.charts))
    recording = read_sensors(robot.settings, given.recording)
    study = Study(robot, recording)
    for now in follow(tracker, ((frame, True) for frame in blinded(robot, recording))):
        study.see(now)
    samples = study.samples
    if samples is None:
        raise SystemExit(f"{given.recording} does not hold the truth")
    place, force = 1e3 * samples.location_error_m, 100 * samples.force_error
    sigma = 1e3 * samples.location_sigma_m.max(axis=1)
    print(f"{len(place)} samples, {np.isnan(samples.force_N).sum()} without an estimate")
    for name, values, unit in (
        ("place off", place, "mm"),
        ("its sigma", sigma, "mm"),
        ("force off", force, "%"),
    ):
        half, most, largest = np.nanpercentile(values, [50, 95, 100])
        print(f"  {name}: {half:.2f} {unit} (50 %), {most:.2f} (95 %), {largest:.2f} at most")
    parts = (f"{key} {100 * part:.0f} %" for key, part in coverage(samples).items())
    print("  within the 90 % interval: " + ", ".join(parts))


if __name__ == "__main__":
    main()
