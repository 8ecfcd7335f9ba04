"""How near a chart of the finger is to the full finger, and how long its frames take.

    .venv/bin/python benchmarks/reduced_finger.py [--electrode NUMBER] [--cases N] [--frames N]

The chart of one electrode is taught and kept in --out. Random pushes there while the cable pulls, up to the
force that `travel` allows and the `tension` of `[reduction]`, are solved with the full body and with the
chart: the distances by which nodes are off, beside the furthest way of a node, and shortenings and pressures.
Then the finger goes from load to load, two seconds each at a thousand frames a second, by the readings of the
full body there and, between, those of the chart with what these were off by: each frame is estimated, and the
shape of all nodes found. Pin it to a core, `NPROC=1 taskset -c 0`, to see what one core does. Printed, and
written to reduced_finger.json.
"""

import argparse
import json
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from live_frames import compilations, latencies, to_and_fro, wait_until_compiled

from softfuse.body.body import Body
from softfuse.computing.prepare import prepare_jax
from softfuse.estimation.bounds import limits_of, step_settings
from softfuse.estimation.estimator import Estimator
from softfuse.estimation.step import Observation
from softfuse.mechanics.model import Model, simulate
from softfuse.mechanics.solution import RESULTS
from softfuse.robot.file import load
from softfuse.robot.reduced import Teacher, build_regions, reduction_mark
from softfuse.robot.robot import Robot, build_robot
from softfuse.rom.basis import rest_stiffness
from softfuse.rom.reduced_model import reduced_model
from softfuse.rom.rom_file import AtlasFolder, Kept, kept_sizes, read_model

PER_LOAD, SOLVED_EVERY = 2000, 50
SIGMA_M, SIGMA_PA = 5e-5, 10.0
CONFIG = Path(__file__).parents[1] / "configs" / "finger.toml"


def places_of(robot: Robot) -> np.ndarray:
    """The places (e, 3, 3) of its electrodes."""
    return np.array([*robot.settings.places.values()])


def taught(teacher: Teacher, electrode: int, folder: Path) -> tuple[Kept, float]:
    """The chart of an electrode, read from a folder where it is made if it is not there; and the seconds that
    took.
    """
    model = teacher.model
    charts, began = AtlasFolder(folder, reduction_mark(teacher.config)), time.perf_counter()
    if not charts.has(electrode):
        chart = teacher.chart(electrode)
        charts.write(
            electrode,
            reduced_model(model, teacher.stiffness, chart, places_of(teacher.robot)),
            chart.basis,
        )
    taken = time.perf_counter() - began
    file = charts.file(electrode)
    return read_model(file, charts.mark, model, kept_sizes(file, charts.mark)), taken


def drives(teacher: Teacher, electrode: int, largest_force: float, cases: int) -> np.ndarray:
    """Random drives (c, D) of all patches, up to a force [N] in all, and of the cable."""
    random, model, tension = np.random.default_rng(11), teacher.model, teacher.config.reduction.tension
    patches, place = model.contacts[0].drives, places_of(teacher.robot)[[electrode]]
    assert tension is not None
    found = np.tile(np.asarray(model.rest_state(place).drive), (cases, 1))
    share = random.dirichlet(np.ones(patches), cases)
    found[:, :patches] = share * random.uniform(0, largest_force, (cases, 1))
    found[:, patches] = random.uniform(0, tension, cases)
    return found


def errors(
    model: Model, small: Model, place: jax.Array, wanted: np.ndarray
) -> tuple[dict[str, object], np.ndarray]:
    """Of shapes and readings under drives (c, D), 50 % of the cases and the largest; and the full body's
    readings (c, k).
    """
    rows, readings = [], []
    for drive in jnp.asarray(wanted):
        exact, found = (simulate(each, place, drive) for each in (model, small))
        assert exact.result == found.result == RESULTS.converged, drive
        shape, nearly = (
            np.asarray(each.body.displacement(at.state.z)) for each, at in ((model, exact), (small, found))
        )
        read, told = (np.asarray(d.reading(at.state)) for d, at in ((model, exact), (small, found)))
        readings.append(read)
        rows.append(
            (
                1e3 * np.linalg.norm(shape, axis=1).max(),
                1e3 * np.linalg.norm(shape - nearly, axis=1).max(),
                1e3 * abs(read[0] - told[0]),
                np.abs(read - told)[1:].max(),
                np.abs(read)[1:].max(),
                100 * float(small.body.truncation(found.state.z)),
            )
        )
        print("moved by {:.1f} mm, off by {:.3f} mm".format(*rows[-1]), flush=True)
    keys = ("moved_mm", "off_mm", "shortening_off_mm", "pressure_off_Pa", "pressure_Pa", "truncation_%")
    columns = zip(keys, np.transpose(rows), strict=True)
    return {key: np.percentile(each, [50, 100]).tolist() for key, each in columns}, np.array(readings)


def way(small: Model, place: jax.Array, wanted: np.ndarray, readings: np.ndarray) -> np.ndarray:
    """Readings (f, k) on the way from rest through drives (c, D), at which they are the given ones (c, k)."""
    loads = np.concatenate([np.asarray(small.rest_state(place).drive)[None], wanted])
    at_load, every = np.arange(len(loads)), SOLVED_EVERY / PER_LOAD
    solved = np.arange(0.0, len(wanted) + every / 2, every)
    drives = np.stack([np.interp(solved, at_load, column) for column in loads.T], axis=1)
    own = np.array([small.reading(simulate(small, place, drive).state) for drive in jnp.asarray(drives)])
    missed = readings - own[:: round(1 / every)][1:]
    missed = np.concatenate([np.zeros_like(missed[:1]), missed])
    frame = np.arange(PER_LOAD * len(wanted)) / PER_LOAD
    columns = zip(own.T, missed.T, strict=True)
    return np.stack([np.interp(frame, solved, o) + np.interp(frame, at_load, m) for o, m in columns], axis=1)


def frame_times(
    robot: Robot, kept: Kept, place: jax.Array, wanted: np.ndarray, through: np.ndarray, frames: int
) -> dict[str, object]:
    """Latencies [ms] of estimate, shape and both, 50 and 99 %; how often programs were traced or compiled, a
    factor made anew and a state lost; and how far off the tension is at the loads [N], 50 % and the largest.
    """
    estimator = Estimator(kept.model, limits_of(robot), place, step_settings(robot))
    whitening = np.eye(through.shape[1]) / SIGMA_PA
    whitening[0, 0] = 1 / SIGMA_M
    wait_until_compiled(estimator)
    taken, off, renewed, lost = [], [], 0, 0
    with compilations() as compiled:
        for k in to_and_fro(len(through), frames):
            began = time.perf_counter()
            found = estimator.update(Observation.on_host(through[k], whitening, np.asarray(place)))
            estimated = time.perf_counter()
            kept.displacement(np.asarray(estimator.state.z))
            taken.append((estimated - began, time.perf_counter() - estimated))
            renewed, lost = renewed + found.renewed, lost + found.lost
            if k and k % PER_LOAD == 0:
                cable = kept.model.contacts[0].drives
                off.append(abs(found.drive[cable] - wanted[k // PER_LOAD - 1, cable]))
    return {
        **latencies(taken),
        "traced_or_compiled": len(compiled),
        "renewed": renewed,
        "lost": lost,
        "tension_off_N": np.percentile(off, [50, 100]).tolist(),
    }


def main() -> None:
    """Teach, compare, time, print, write JSON."""
    prepare_jax()
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--electrode", type=int, default=7)
    parser.add_argument("--cases", type=int, default=10)
    parser.add_argument("--frames", type=int, default=20_000)
    given = parser.parse_args()
    robot = build_robot(load(CONFIG))
    model, place = robot.model, jnp.asarray(places_of(robot)[[given.electrode]])
    assert isinstance(model.body, Body)
    teacher = Teacher(robot, rest_stiffness(model.body), build_regions(robot.settings))
    kept, taken = taught(teacher, given.electrode, given.out / "finger_charts")
    largest_force = teacher.largest_force(given.electrode)
    wanted = drives(teacher, given.electrode, largest_force, given.cases)
    # Charts are kept in single precision, which is enough for estimates.
    small = jax.tree.map(lambda x: x.astype(float) if x.dtype == jnp.float32 else x, kept.model)
    missed, readings = errors(model, small, place, wanted)
    through = way(small, place, wanted, readings)
    row = {
        "taught_s": taken,
        "largest_force_N": largest_force,
        "full_unknowns": model.body.n,
        "reduced_unknowns": kept.model.body.n,
        "points": [len(each.volumes) for each in kept.model.body.sample],
        **missed,
        **frame_times(robot, kept, place, wanted, through, given.frames),
    }
    for key, value in row.items():
        print(f"{key:>20} {np.array2string(np.asarray(value), precision=3)}", flush=True)
    (given.out / "reduced_finger.json").write_text(json.dumps(row, indent=2) + "\n")


if __name__ == "__main__":
    main()
