"""What joining frames makes of forces that are held for long, while zeros drift and a hose is pulled.

    .venv/bin/python benchmarks/joined_holds.py CONFIG --drawing CONFIG [--hold SECONDS] [--pulls MM3]

CONFIG is a pad under crossed electrodes, calibrated, such as the fitted.toml of `softfuse evaluate
configs/pad.toml --out DIR`, of the --drawing that was evaluated. The truth is the body of that evaluation,
not the estimator's model, pressed at places all over the workspace with two forces that are held; its flow
sensors and its electrodes are read through their electronics at 100 Hz. In every second press, in the middle
of each hold, a cavity that is not pressed breathes in so much air within 0.3 s without any force. Printed, of
presses without and with that, at the ends of holds: the mean and the largest error of the force, by how much
it has changed since the hold began, although the force has not, and how often the truth is within the 90 %
interval, then and as the hold began, when zeros have hardly drifted, of single frames, of all frames so far
joined, and of all frames of the touch.
"""

import argparse
from pathlib import Path

import numpy as np
from softfuse.config.build_device import build_device
from softfuse.config.build_tracker import build_tracker
from softfuse.experiment.build_evaluation import build_bed
from softfuse.experiment.build_virtual_pad import PadPlan
from softfuse.experiment.channel_electronics import Readout
from softfuse.experiment.pad_programme import PadTiming, pad_programme
from softfuse.experiment.pad_touches import PadBed, pad_touches
from softfuse.experiment.virtual_pad import Touch
from softfuse.fusion.fusion import Fusion, fused_recording

from softfuse.computing import prepare_jax
from softfuse.estimation.tracked import Frame
from softfuse.experiment.accuracy import NINETY
from softfuse.robot.file import load
from softfuse.robot.settings import RobotSettings

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
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("config", type=Path)
    parser.add_argument("--drawing", type=Path, required=True)
    parser.add_argument("--hold", type=float, default=60.0, help="in s")
    parser.add_argument("--pulls", type=float, default=40.0, help="in mm³")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    prepare_jax()
    config, plan = load(given.config), build_bed(load(given.drawing), grid=2, seed=given.seed).plan
    assert isinstance(plan, PadPlan) and config.sensors is not None
    bed = PadBed(plan.settings, plan.array, plan.gaps)
    touches = pad_touches(bed, [Touch((1e-3 * x, 1e-3 * y), FORCES_N) for x, y in PLACES_MM])
    timing = PadTiming(hold_s=given.hold)
    programme = pad_programme(touches, timing, plan.parts, plan.flows, plan.electrodes)
    time_s = programme.step_s * np.arange(len(programme.readings))
    values = Readout(programme, plan.electronics(given.seed), (given.seed, 3000)).read(time_s)
    press, sample, force = (programme.truth[name] for name in ("press", "sample", "true_force_N"))
    cavities, gain = len(plan.flows), config.sensors.flow.sensitivity
    pulled = np.zeros(len(PLACES_MM), bool)
    middles, half = np.flatnonzero(sample > 0), 0.5 * given.hold / programme.step_s
    for middle in middles[press[middles].astype(int) % 2 == 1]:
        pulled[int(press[middle])] = True
        volume = [programme.truth[f"true_dV{k}_mm3"][middle] for k in range(cavities)]
        k, lasting = int(np.argmin(np.abs(volume))), round(PULL_S / programme.step_s)
        values[middle : middle + lasting, k] -= gain * 1e-9 * given.pulls / PULL_S
    tracker = build_tracker(config, build_device(config))
    found, rows = [], []
    begins, ends = (middles + round(part * half) for part in (-0.9, 0.9))
    wanted = {*begins.tolist(), *ends.tolist()}
    for i, t in enumerate(time_s.tolist()):
        finding = tracker.sense(Frame(t, grouped(values[i], cavities, config)))
        if i % EVERY == 0 or i in wanted:
            found.append(tracker.estimate(t, finding))
            rows.append(i)
    joined, whole = fused_recording(Fusion.of(tracker, keep=True), found)
    at = {i: n for n, i in enumerate(rows)}
    for name, which in (("zeros that drift", ~pulled), ("and a hose that is pulled", pulled)):
        holds = [(b, e) for b, e in zip(begins, ends, strict=True) if which[int(press[b])]]
        print(f"{name}: {len(holds)} holds of {given.hold:g} s")
        for label, frames in (("frame by frame", found), ("joined", joined), ("smoothed", whole)):
            first, last = ([frames[at[hold[n]]] for hold in holds] for n in (0, 1))
            true = np.array([force[e] for _, e in holds])
            began, ended = (np.array([each.force_N for each in frames]) for frames in (first, last))
            off, gone = 100 * np.abs(ended / true - 1), ended - began
            inside = [
                100 * np.mean([abs(each.force_N - f) < NINETY * each.force_sigma_N for each, f in told])
                for told in (zip(frames, true, strict=True) for frames in (first, last))
            ]
            print(
                f"  {label}: off by {off.mean():.2f} %, {off.max():.1f} % at most; "
                f"gone by {np.sqrt(np.mean(gone**2)):.3f} N (rms), {np.abs(gone).max():.3f} N at most; "
                f"{inside[1]:.0f} % within 1.645 sigma, {inside[0]:.0f} % as the hold began"
            )
    print(f"readings taken for outliers: {sum(int(each.outlier.sum()) for each in joined)}")


def grouped(values: np.ndarray, cavities: int, config: RobotSettings) -> tuple[np.ndarray, ...]:
    """A frame's values as the senses' groups: flow, rows, columns."""
    rows = len(config.sensors.capacitive.row_channels)
    return values[:cavities], values[cavities : cavities + rows], values[cavities + rows :]


if __name__ == "__main__":
    main()
