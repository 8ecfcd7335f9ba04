"""Cost of a frame of the pad's senses, and the time until an electrode that lies is named.

    taskset -c 0 .venv/bin/python benchmarks/sensing.py [--out FOLDER] [--repeats N]

Frames are those of a virtual pad on a coarse mesh, touched at four places (`experiment.pad_programme`); each
is sensed as in the live loop (`estimation.compiled_senses`) and its findings are read. Printed and written to
sensing.json: compile time; for frames untouched, near and touched the median and 99th percentile of the time
to sense [ms] and with reading what was found [ms]; how often something was compiled while warm. Then, at
random places and electrodes, one of which breaks while it is touched: the share that is named, and after how
many frames.
"""

import argparse
import json
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from live_frames import compilations
from softfuse.config.build_sensors import build_sensors
from softfuse.config.build_tracker import build_senses
from softfuse.estimation.compiled_senses import CompiledSenses
from softfuse.experiment.build_virtual_pad import pad_plan
from softfuse.experiment.channel_electronics import Readout
from softfuse.experiment.pad_electrodes import LineElectrodes
from softfuse.experiment.pad_programme import PadTiming, pad_programme
from softfuse.experiment.pad_touches import PadBed, pad_touches
from softfuse.experiment.virtual_pad import Touch

from softfuse.mechanics.sparse import SparseLU
from softfuse.robot.body import PadSource
from softfuse.robot.file import load
from softfuse.robot.settings import RobotSettings
from softfuse.sensors.crossed.field import FieldSettings
from softfuse.sensors.crossed.peak_follow import follow_peak, no_peak
from softfuse.sensors.crossed.peak_model import peak_signal

CONFIG = Path(__file__).parents[1] / "configs" / "pad.toml"
SHEAR_PA, POISSON = 0.2e6, 0.49
FORCES_N = (2.0, 5.0, 8.0)
STATES = ("untouched", "near", "touching")
LIES = 200
LIE_COUNTS = (4000.0, 1500.0, -2000.0)
SHARE = 0.9
"""Of the way from the middle to the outermost lines, where electrodes break."""


def frames_of(config: RobotSettings) -> tuple[np.ndarray, np.ndarray]:
    """Times (f,) [s] and readings (f, 20) of a coarse virtual pad that is touched."""
    assert isinstance(config.body.source, PadSource)
    plan = pad_plan(config, config.body.source, SHEAR_PA, POISSON)
    assert isinstance(plan.array, LineElectrodes)
    pad = replace(
        plan.settings, surface_size=28e-3, base_size=28e-3, growth=0.5, rims=(0.7, 1.0), sectors=(4, 8)
    )
    electrodes = replace(plan.array, field=FieldSettings(radius=pad.radius, cuts=3, bottom_side=2e-3))
    places = tuple(Touch(touch.at, FORCES_N) for touch in plan.touches)
    touches = pad_touches(PadBed(pad, electrodes, plan.gaps, plan=SparseLU.plan), places)
    programme = pad_programme(touches, PadTiming(), plan.parts, plan.flows, plan.electrodes)
    times = np.arange(0.0, programme.period_s, 0.01)
    return times, Readout(programme, plan.electronics(1), (1, 2, 3)).read(times)


def cost(config: RobotSettings, repeats: int) -> dict[str, object]:
    """Times of the frames of `repeats` runs by what they see."""
    times, values = frames_of(config)
    started = time.perf_counter()
    with ThreadPoolExecutor(1) as compiler:
        senses = CompiledSenses(build_senses(config), compiler)
    compile_s = time.perf_counter() - started
    groups = [(row[:4], row[4:12], row[12:]) for row in values]
    senses.update(times[0], groups[0])  # warm
    seen, sense_ms, read_ms = [], [], []
    with compilations() as compiled:
        for _ in range(repeats):
            senses.reset()
            for time_s, readings in zip(times.tolist(), groups, strict=True):
                begin = time.perf_counter()
                finding = senses.update(time_s, readings)
                jax.block_until_ready(finding.packed)
                sensed = time.perf_counter()
                details = finding.sensed.details
                sense_ms.append(1e3 * (sensed - begin))
                read_ms.append(1e3 * (time.perf_counter() - begin))
                seen.append(int(details.near) + int(details.touching))
    found: dict[str, object] = {"compile_s": compile_s, "compilations_while_warm": len(compiled)}
    for state, name in enumerate(STATES):
        here = np.array(seen) == state
        found[name] = {"frames": int(here.sum())} | {
            f"{what}_{label}_ms": round(float(np.quantile(np.array(spent)[here], part)), 4)
            for what, spent in (("sense", sense_ms), ("with_reading", read_ms))
            for label, part in (("p50", 0.5), ("p99", 0.99))
        }
    return found


def delay(config: RobotSettings) -> dict[str, object]:
    """In how many frames electrodes that break are named."""
    model, rng = build_sensors(config).peak, np.random.default_rng(0)
    most = SHARE * np.array([float(model.column_x_m[-1]), float(model.row_y_m[-1])])
    before, frames, e = 5, 60, model.row_y_m.shape[0] + model.column_x_m.shape[0]
    follow = jax.jit(lambda track, signal, valid: follow_peak(model, track, signal, valid))
    signal_at = jax.jit(
        lambda at: peak_signal(
            model, at, jnp.array([2700.0, 4500.0]), jnp.array([40.0, 70.0]), model.radius_m, jnp.zeros(())
        )
    )
    delays, wrong = [], 0
    for case in range(LIES):
        signals = np.asarray(signal_at(rng.uniform(-most, most)))
        signals = signals + rng.normal(0.0, float(model.noise_counts), (frames, e))
        liar = int(rng.integers(e))
        signals[before:, liar] += LIE_COUNTS[case % len(LIE_COUNTS)]
        track, honest = no_peak(model), np.ones(e, bool)
        for frame, signal in enumerate(signals):
            track, _, fair = follow(track, signal, honest)
            honest = honest & np.asarray(fair)
            if not honest.all():
                wrong += bool(honest[liar])
                delays += [] if honest[liar] else [frame - before]
                break
    return {
        "electrodes": LIES,
        "named": len(delays),
        "wrongly_named": wrong,
        "frames_p50": float(np.median(delays)),
        "frames_p90": float(np.quantile(delays, 0.9)),
        "frames_max": max(delays),
    }


def main() -> None:
    """Measure, print, write JSON."""
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--repeats", type=int, default=3, help="runs through all frames")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    config = load(CONFIG)
    result = {
        "device": jax.devices()[0].device_kind,
        "senses": cost(config, given.repeats),
        "lying_electrode": delay(config),
    }
    text = json.dumps(result, indent=2)
    (given.out / "sensing.json").write_text(text + "\n")
    print(text)


if __name__ == "__main__":
    main()
