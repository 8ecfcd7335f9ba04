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
from softfuse.cli.recorded import sample_frames, samples_at, sensor_columns, sensor_frames
from softfuse.config.build_device import build_device
from softfuse.config.build_tracker import build_tracker

from softfuse.computing import prepare_jax
from softfuse.estimation.tracked import Frame
from softfuse.experiment.accuracy import coverage
from softfuse.hardware.recording import Recording, read_recording
from softfuse.robot.file import load
from softfuse.robot.reduced import with_charts
from softfuse.robot.settings import RobotSettings


def blinded(config: RobotSettings, recording: Recording) -> Iterator[Frame]:
    """The recording's frames, with electrodes that nothing comes near."""
    assert config.sensors is not None
    rng, noise, still = np.random.default_rng(0), config.sensors.capacitive.noise_counts, ()
    for frame in sensor_frames(config, recording):
        flow, *counts = frame.readings
        still = still or tuple(counts)
        seen = (np.round(each + rng.normal(0.0, noise, each.shape)) for each in still)
        yield Frame(frame.time_s, (flow, *seen))


def main() -> None:
    """Follow, compare, print."""
    prepare_jax()
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("config", type=Path)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--charts", type=Path)
    given = parser.parse_args()
    config = load(given.config)
    tracker = build_tracker(config, with_charts(config, build_device(config), given.charts))
    recording = read_recording(given.recording, sensor_columns(config))
    found = [tracker.update(frame) for frame in blinded(config, recording)]
    samples = samples_at(recording, found, sample_frames(recording))
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
