"""How near the reduced pad is to the full one, wherever it is pressed, and how long its frames take.

    .venv/bin/softfuse reduce configs/pad.toml --out out/charts
    .venv/bin/python benchmarks/reduced_pad.py configs/pad.toml --charts out/charts [--cases N] [--frames N]

Random presses in the workspace, of random force, are solved with the full body and with the chart of their
cell: errors are the largest of any node's displacement component and of any cavity's volume, relative to the
largest. Then a contact wanders through the cells at 100 mm/s, a thousand frames a second, to and fro on a
path of a metre, while its force rises and falls: each frame is estimated, and the shape of all nodes found.
Volumes are those of the full body, solved every 2 mm and interpolated. The full body's estimate of some of
these frames is timed beside. At last the sensors' frames of a recording go through the whole chain, senses,
estimate and shape of all nodes; those are counted in which something presses. Pin it to a core, `NPROC=1
taskset -c 0`, to see what one core does. Printed, and written to reduced_pad.json.
"""

import argparse
import json
import time
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from live_frames import compilations, latencies, to_and_fro

from softfuse.computing.prepare import prepare_jax
from softfuse.estimation.bounds import limits_of
from softfuse.estimation.estimator import Estimator
from softfuse.estimation.reduced_estimator import MOST_TRUNCATION, ReducedEstimator
from softfuse.estimation.step import Observation
from softfuse.estimation.tracker import Tracker
from softfuse.functional.chart import facing
from softfuse.mechanics.model import Model, simulate
from softfuse.report.presses import read_sensors, sensor_frames
from softfuse.robot.file import load
from softfuse.robot.reduced import with_charts
from softfuse.robot.robot import Robot, build_robot
from softfuse.rom.cells import Cells
from softfuse.rom.rom_file import Atlas

APART_M, PER_FRAME_M, PATH = 2e-3, 1e-4, 10_000
RECORDING = Path(__file__).parents[1] / "tests" / "data" / "pad_nominal_two_presses.csv.gz"


def errors(model: Model, atlas: Atlas, cases: int, largest: float) -> dict[str, object]:
    """Percentiles 50, 95, 100 of the errors [%] of displacements and volumes at random presses, and of the
    truncation [%] that the chart itself tells; how many are off by more than 1 % and how many the full body
    would correct, and how many are both.
    """
    random = np.random.default_rng(7)
    missed = []
    cells = atlas.regions
    assert isinstance(cells, Cells)
    for _ in range(cases):
        place = facing(np.append(random.uniform(cells.low, cells.high), 0.0), cells.direction)
        drive = jnp.array([random.uniform(0.02 * largest, largest)])
        number = cells.find(place)
        assert number is not None
        small, at = atlas.chart(number).model, jnp.asarray(place)[None]
        exact, found = (simulate(each, at, drive).state for each in (model, small))
        each = [100 * float(small.body.truncation(found.z))]
        for of in (lambda d, s: d.body.displacement(s.z), lambda d, s: d.reading(s)):
            wanted, got = np.asarray(of(model, exact)), np.asarray(of(small, found))
            each.append(100 * np.max(np.abs(got - wanted)) / np.max(np.abs(wanted)))
        missed.append(each)
    keys = ("truncation_%", "displacement_%", "volume_%")
    columns = np.transpose(missed)
    off, corrected = np.any(columns[1:] > 1.0, axis=0), columns[0] > 100 * MOST_TRUNCATION
    percentiles = {
        key: np.percentile(c, [50, 95, 100]).tolist() for key, c in zip(keys, columns, strict=True)
    }
    counts = [int(np.sum(each)) for each in (off, corrected, off & corrected)]
    return percentiles | {"off_flagged_both": counts}


def wandering(cells: Cells, frames: int, largest: float) -> tuple[np.ndarray, np.ndarray]:
    """Places (f, 3, 3) and forces (f,) N: through the workspace on a winding path."""
    length = PER_FRAME_M * np.arange(frames)
    low, high = np.array(cells.low), np.array(cells.high)
    middle, half = (low + high) / 2, (high - low) / 2
    x = middle[0] + 0.95 * half[0] * np.sin(length / 0.031)
    y = middle[1] + 0.95 * half[1] * np.sin(length / 0.043 + 1.0)
    places = facing(np.stack([x, y, 0 * x], axis=1), cells.direction)
    return places, largest * (0.3 + 0.2 * np.sin(length / 0.012))


def frame_times(robot: Robot, atlas: Atlas, frames: int) -> dict[str, object]:
    """Latencies [ms] of estimate, shape and both, 50 and 99 %; how often programs were traced or compiled,
    the full body asked and a tangent inverted; by how much forces were off; and the full body's latencies.
    """
    model, cells = robot.model, atlas.regions
    assert isinstance(cells, Cells)
    places, forces = wandering(cells, min(frames, PATH), robot.settings.contact().max_force)
    every = round(APART_M / PER_FRAME_M)
    solved = [
        model.reading(simulate(model, jnp.asarray(place)[None], jnp.array([force])).state)
        for place, force in zip(places[::every], forces[::every], strict=True)
    ]
    number = np.arange(len(places))
    readings = np.stack([np.interp(number, number[::every], each) for each in np.transpose(solved)], axis=1)
    limits, none = limits_of(robot), jnp.asarray(places[:1])
    whitening = 1e9 * np.eye(readings.shape[1])
    path = [Observation.on_host(r, whitening, p[None]) for r, p in zip(readings, places, strict=True)]
    full, small = Estimator(model, limits, none), ReducedEstimator(atlas, limits, none)
    outside = facing(np.append(np.array(cells.high) + APART_M, 0.0), cells.direction)
    for place in (*(cells[number].at(np.zeros(2)) for number in range(len(cells))), outside):
        # As after some seconds of running: all charts are read, and at last the full body is waited for.
        small.update(path[0]._replace(places=place[None]))
    small.reset()
    small.update(path[0])
    taken, off, corrected, renewed = [], [], 0, 0
    with compilations() as compiled:
        for k in to_and_fro(len(path), frames):
            began = time.perf_counter()
            found = small.update(path[k])
            estimated = time.perf_counter()
            small.displacement()
            taken.append((estimated - began, time.perf_counter() - estimated))
            off.append(abs(found.drive[0] - forces[k]))
            corrected, renewed = corrected + found.corrected, renewed + found.renewed
    beside = [full.update(each).latency_s for each in path[:200]]
    return {
        **latencies(taken),
        "traced_or_compiled": len(compiled),
        "corrected_%": 100 * corrected / frames,
        "renewed_%": 100 * renewed / frames,
        "force_off_N": np.percentile(off, [50, 95, 100]).tolist(),
        "full_ms": (1e3 * np.percentile(beside, [50, 99])).tolist(),
    }


def tracked_times(robot: Robot, atlas: Atlas, recording: Path) -> dict[str, object]:
    """Latencies [ms] from a sensors' frame to contacts, forces and shape, 50 and 99 %, and how many frames
    they are of; the second time that the recording passes, when all of its charts have been read.
    """
    tracker, settings = Tracker(robot, atlas), robot.settings
    frames = list(sensor_frames(settings, read_sensors(settings, recording)))
    taken: list[float] = []
    for _ in range(2):
        tracker.reset()
        taken.clear()
        for frame in frames:
            began = time.perf_counter()
            found = tracker.update(frame)
            if found.touching.any():
                tracker.estimator.displacement()
                taken.append(1e3 * (time.perf_counter() - began))
    return {"tracked_ms": np.percentile(taken, [50, 99]).tolist(), "tracked_frames": len(taken)}


def main() -> None:
    """Compare, time, print, write JSON."""
    prepare_jax()
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("config", type=Path)
    parser.add_argument("--charts", type=Path, required=True)
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--cases", type=int, default=100)
    parser.add_argument("--frames", type=int, default=100_000)
    parser.add_argument("--recording", type=Path, default=RECORDING)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    robot = build_robot(load(given.config))
    model, largest = robot.model, robot.settings.contact().max_force
    atlas = with_charts(robot, given.charts)
    assert isinstance(atlas, Atlas)
    row: dict[str, object] = {
        "charts": len(atlas.regions),
        "full_unknowns": model.body.n,
        "reduced_unknowns": atlas.chart(0).model.body.n,
        **errors(model, atlas, given.cases, largest),
        **frame_times(robot, atlas, given.frames),
        **tracked_times(robot, atlas, given.recording),
    }
    for key, value in row.items():
        print(f"{key:>20} {np.array2string(np.asarray(value), precision=3)}", flush=True)
    (given.out / "reduced_pad.json").write_text(json.dumps(row, indent=2) + "\n")


if __name__ == "__main__":
    main()
