"""Cost of a frame of the pad's sensors, and the time until an electrode that lies is named.

    taskset -c 0 .venv/bin/python benchmarks/sensing.py [--out FOLDER] [--repeats N]

Frames are those of a virtual pad on a coarse mesh, touched at four places (`experiment.performance`); each is
sensed as in the live loop (`estimation.compiled_suite`) and its observation is read. Printed and written to
sensing.json: compile time; for frames untouched, near and touched the median and 99th percentile of the time
to sense [ms] and with reading what was found [ms]; how often something was compiled while warm. Then, at
random places and electrodes, one of which breaks while it is touched: the share that is named, and after how
many frames.
"""

import argparse
import json
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from live_frames import compilations

from softfuse.estimation.compiled_suite import CompiledSuite
from softfuse.experiment.episodes import Episode, Touch, place_of
from softfuse.experiment.performance import performance
from softfuse.experiment.virtual_robot import MakingErrors, virtual_robot
from softfuse.functional.chart import facing
from softfuse.mesh.pad import PadSource
from softfuse.robot.file import load
from softfuse.robot.robot import Robot, build_robot
from softfuse.robot.settings import RobotSettings
from softfuse.sensors.crossed.peak_follow import follow_peak, no_peak
from softfuse.sensors.crossed.peak_model import peak_layers, peak_shape
from softfuse.sensors.crossed.sensor import CrossedElectrodes

CONFIG = Path(__file__).parents[1] / "configs" / "pad.toml"
COARSE = {"surface_size": 28e-3, "base_size": 28e-3, "growth": 0.5, "fine_depth": 0.0}
PLACES_MM = ((18.0, 15.0), (-15.0, 3.0), (3.0, -21.0), (-24.0, -24.0))
FORCES_N = (2.0, 5.0, 8.0)
STATES = ("untouched", "near", "touching")
LIES = 200
LIE_COUNTS = (4000.0, 1500.0, -2000.0)
SHARE = 0.9
"""Of the way from the middle to the outermost lines, where electrodes break."""


def coarse(settings: RobotSettings) -> RobotSettings:
    """The settings of a pad on a coarse mesh: what sensors say of it costs as much as of another."""
    source = settings.body.source
    assert isinstance(source, PadSource)
    body = settings.body.model_copy(update={"source": source.model_copy(update=COARSE)})
    return settings.model_copy(update={"body": body})


def frames_of(settings: RobotSettings) -> tuple[np.ndarray, np.ndarray]:
    """Times (f,) [s] and readings (f, 20) of a virtual pad that is touched."""
    robot = virtual_robot(settings, MakingErrors(nodes=0))
    name, at = settings.contact().name, 1e-3 * np.column_stack([PLACES_MM, np.zeros(len(PLACES_MM))])
    episodes = [Episode((Touch(name, place_of(place), FORCES_N),)) for place in facing(at, (0, 0, -1))]
    performed = performance(robot, episodes, folder=None)
    said = performed.recording(1, 2)
    return performed.frames.time_s, np.stack([said[channel][1] for channel in settings.channels], axis=1)


def cost(robot: Robot, repeats: int) -> dict[str, object]:
    """Times of the frames of `repeats` runs by what they see."""
    times, values = frames_of(robot.settings)
    started = time.perf_counter()
    with ThreadPoolExecutor(1) as compiler:
        suite = CompiledSuite(robot.suite, compiler)
    compile_s = time.perf_counter() - started
    (electrodes,) = robot.suite.contact_sensors
    suite.update(times[0], values[0])  # warm
    seen, sense_ms, read_ms = [], [], []
    with compilations() as compiled:
        for _ in range(repeats):
            suite.reset()
            for time_s, raw in zip(times.tolist(), values, strict=True):
                begin = time.perf_counter()
                finding = suite.update(time_s, raw)
                jax.block_until_ready(finding.packed)
                sensed = time.perf_counter()
                details = finding.observation.details[electrodes.name]
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


def delay(robot: Robot) -> dict[str, object]:
    """In how many frames electrodes that break are named."""
    (electrodes,) = robot.suite.contact_sensors
    assert isinstance(electrodes, CrossedElectrodes)
    model, rng = electrodes.peak, np.random.default_rng(0)
    most = SHARE * np.array([float(model.column_x_m[-1]), float(model.row_y_m[-1])])
    before, frames, e = 5, 60, model.row_y_m.shape[0] + model.column_x_m.shape[0]
    follow = jax.jit(lambda track, signal, valid: follow_peak(model, track, signal, valid))
    shape, layer, own = peak_shape(model), peak_layers(model), jnp.stack([model.radius_m, jnp.zeros(())])
    amplitude, offset = jnp.array([2700.0, 4500.0]), jnp.array([40.0, 70.0])
    signal_at = jax.jit(lambda at: layer @ amplitude * shape(jnp.append(at, own)) + layer @ offset)
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
    robot = build_robot(coarse(load(CONFIG)))
    result = {
        "device": jax.devices()[0].device_kind,
        "sensors": cost(robot, given.repeats),
        "lying_electrode": delay(robot),
    }
    text = json.dumps(result, indent=2)
    (given.out / "sensing.json").write_text(text + "\n")
    print(text)


if __name__ == "__main__":
    main()
