"""What joining frames makes of forces that are held for long, while zeros drift and a hose is pulled.

    .venv/bin/python benchmarks/joined_holds.py CONFIG --drawing CONFIG [--hold SECONDS] [--pulls MM3]

CONFIG is a pad under crossed electrodes, calibrated, such as the fitted.toml of `softfuse evaluate
configs/pad.toml --out DIR`, of the --drawing that was evaluated. The truth is the robot of that evaluation,
not the estimator's model, pressed at places all over the workspace with two forces that are held; its flow
sensors and its electrodes are read through their electronics at 100 Hz. In every second press, in the middle
of each hold, a chamber that is not pressed breathes in so much air within 0.3 s without any force. Printed,
of presses without and with that, at the ends of holds: the mean and the largest error of the force, by how
much it has changed since the hold began, although the force has not, and how often the truth is within the
90 % interval, then and as the hold began, when zeros have hardly drifted, of single frames, of all frames so
far joined, and of all frames of the touch.
"""

import argparse
from pathlib import Path

import numpy as np

from softfuse.computing import prepare_jax
from softfuse.estimation.smoothing.smoother import Smoother, smoothed_recording
from softfuse.estimation.tracked import Frame
from softfuse.estimation.tracker import Tracker
from softfuse.experiment.accuracy import NINETY
from softfuse.experiment.episodes import Episode, Touch, place_of
from softfuse.experiment.paper.bed import build_bed
from softfuse.experiment.performance import performance
from softfuse.experiment.timeline import Timing
from softfuse.functional.chart import facing
from softfuse.robot.file import load
from softfuse.robot.robot import build_robot
from softfuse.sensors.flow import FlowSettings

PLACES_MM = (
    (-17.0, -17.0),
    (0.0, 0.0),
    (20.0, -4.0),
    (-5.0, 24.0),
    (10.0, 10.0),
    (24.0, 24.0),
    (4.0, -12.0),
    (-24.0, 6.0),
)
FORCES_N = (4.0, 8.0)
PULL_S = 0.3
EVERY = 10


def main() -> None:
    """Press, hold, estimate, join, compare."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("config", type=Path)
    parser.add_argument("--drawing", type=Path, required=True)
    parser.add_argument("--hold", type=float, default=60.0, help="in s")
    parser.add_argument("--pulls", type=float, default=40.0, help="in mm³")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    prepare_jax()
    config = load(given.config)
    tracker = Tracker(build_robot(config))
    robot = build_bed(load(given.drawing), grid=2, seed=given.seed).robot
    contact, (flow,) = robot.drawn.contact(), config.sensors_of(FlowSettings)
    at = 1e-3 * np.column_stack([PLACES_MM, np.zeros(len(PLACES_MM))])
    episodes = [
        Episode((Touch(contact.name, place_of(place), FORCES_N),)) for place in facing(at, (0, 0, -1))
    ]
    performed = performance(robot, episodes, folder=None, timing=Timing(hold_s=given.hold))
    frames, said = performed.frames, performed.recording(given.seed, 3000)
    time_s, press, force = frames.time_s, frames.episode, frames.values["force"].sum(axis=1)
    raw = np.stack([said[channel][1] for channel in config.channels], axis=1)
    pulled = np.zeros(len(PLACES_MM), bool)
    middles, half = np.flatnonzero(frames.sample > 0), 0.5 * given.hold / time_s[1]
    lasting = round(PULL_S / time_s[1])
    for middle in middles[press[middles] % 2 == 1]:
        pulled[press[middle]] = True
        k = int(np.argmin(np.abs(frames.values["volume"][middle])))
        channel = config.channels.index(flow.channels[flow.chambers.index(config.chambers[k].name)])
        raw[middle : middle + lasting, channel] -= flow.sensitivity * 1e-9 * given.pulls / PULL_S
    found, rows = [], []
    begins, ends = (middles + round(part * half) for part in (-0.9, 0.9))
    wanted = {*begins.tolist(), *ends.tolist()}
    for i, t in enumerate(time_s.tolist()):
        finding = tracker.sense(Frame(t, raw[i]))
        if i % EVERY == 0 or i in wanted:
            found.append(tracker.estimate(t, finding))
            rows.append(i)
    joined, whole = smoothed_recording(Smoother.of(tracker, keep=True), found)
    frame_of = {i: n for n, i in enumerate(rows)}
    for name, which in (("zeros that drift", ~pulled), ("and a hose that is pulled", pulled)):
        holds = [(b, e) for b, e in zip(begins, ends, strict=True) if which[press[b]]]
        print(f"{name}: {len(holds)} holds of {given.hold:g} s")
        for label, each in (("frame by frame", found), ("joined", joined), ("smoothed", whole)):
            first, last = ([each[frame_of[hold[n]]] for hold in holds] for n in (0, 1))
            true = np.array([force[e] for _, e in holds])
            began, ended = (np.array([one.force_N for one in told]) for told in (first, last))
            off, gone = 100 * np.abs(ended / true - 1), ended - began
            inside = [
                100 * np.mean([abs(one.force_N - f) < NINETY * one.force_sigma_N for one, f in told])
                for told in (zip(told, true, strict=True) for told in (first, last))
            ]
            print(
                f"  {label}: off by {off.mean():.2f} %, {off.max():.1f} % at most; "
                f"gone by {np.sqrt(np.mean(gone**2)):.3f} N (rms), {np.abs(gone).max():.3f} N at most; "
                f"{inside[1]:.0f} % within 1.645 sigma, {inside[0]:.0f} % as the hold began"
            )
    print(f"readings taken for outliers: {sum(int(each.outlier.sum()) for each in joined)}")


if __name__ == "__main__":
    main()
