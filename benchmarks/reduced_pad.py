"""How near a reduced pad is to the full one, and how much faster.

    .venv/bin/python benchmarks/reduced_pad.py [--out FOLDER] [--cases N] [--frames N]

The pad of configs/pad.toml is reduced for contacts in a square of 8 mm, from nine presses up to the
largest force and from what is near them. Then random presses inside it, of random force, are solved with
the full and the reduced body: errors are the largest of any node's displacement component and of any cavity's
volume, relative to the largest. Last, both follow a force that rises and falls, one estimate a frame, in
turns in one run. Printed and written to reduced_pad.json.
"""

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from softfuse.body.body import Body
from softfuse.config import load
from softfuse.config.build_device import build_device, build_limits
from softfuse.estimation.device import Device, simulate
from softfuse.estimation.estimator import Estimator
from softfuse.estimation.reduced_device import reduced_device
from softfuse.estimation.step import Observation
from softfuse.reduction.chart import Chart
from softfuse.reduction.load_paths import Square, pressed_square
from softfuse.reduction.rest_stiffness import RestStiffness, rest_stiffness
from softfuse.reduction.teaching import ChartSettings, teach

CONFIG = Path(__file__).parents[1] / "configs" / "pad.toml"
SQUARE = Square(np.array([4e-3, 4e-3, 0.0]), np.eye(3)[:2], 4e-3)
"""Where the places are."""


def taught(device: Device, stiffness: RestStiffness, largest: float, settings: ChartSettings) -> Chart:
    """The chart of the square, from presses up to a force [N]."""
    assert isinstance(device.body, Body)
    return teach(
        device.linear,
        device.body,
        stiffness,
        lambda body, place: replace(device, body=body).loads(place),
        pressed_square(SQUARE, largest),
        around=[jnp.asarray(place)[None] for place in SQUARE.grid(11)],
        settings=settings,
    )


def errors(full: Device, small: Device, cases: int, largest: float) -> dict[str, list[float]]:
    """Percentiles 50, 95, 100 of the errors [%] of displacements and volumes at random presses."""
    random = np.random.default_rng(7)
    missed = []
    for _ in range(cases):
        place = jnp.asarray(SQUARE.at(random.uniform(-1, 1, 2)))[None]
        drive = jnp.array([random.uniform(0.02 * largest, largest)])
        exact, found = (simulate(device, place, drive).state for device in (full, small))
        each = []
        for of in (lambda d, s: d.body.displacement(s.z), lambda d, s: d.reading(s)):
            wanted, got = np.asarray(of(full, exact)), np.asarray(of(small, found))
            each.append(100 * np.max(np.abs(got - wanted)) / np.max(np.abs(wanted)))
        missed.append(each)
    keys = ("displacement_%", "volume_%")
    columns = zip(keys, np.transpose(missed), strict=True)
    return {key: np.percentile(column, [50, 95, 100]).tolist() for key, column in columns}


def step_times(full: Device, small: Device, frames: int, largest: float) -> dict[str, list[float]]:
    """Latencies [ms] of a frame, 50 and 99 %, and by how much their forces differ at most [N]."""
    limits, place = build_limits(load(CONFIG), 1), jnp.asarray(SQUARE.grid(2)[1])[None]
    at = simulate(full, place, jnp.array([0.4 * largest])).state
    reading = np.asarray(full.reading(at))
    both = {"full": Estimator(full, limits, place), "reduced": Estimator(small, limits, place)}
    taken: dict[str, list[float]] = {name: [] for name in both}
    apart = 0.0
    for k in range(frames + 20):
        seen = Observation(
            jnp.asarray(reading * (1 + 0.3 * np.sin(k / 15))), jnp.full(len(reading), 1e9), place
        )
        force = {}
        for name, estimator in both.items():
            started = time.perf_counter()
            force[name] = estimator.update(seen).drive[0]
            taken[name].append(1e3 * (time.perf_counter() - started))
        apart = max(apart, abs(force["full"] - force["reduced"])) if k >= 20 else 0.0
    times = {f"{name}_ms": np.percentile(each[20:], [50, 99]).tolist() for name, each in taken.items()}
    return {**times, "apart_N": [apart]}


def main() -> None:
    """Reduce, compare, print, write JSON."""
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--cases", type=int, default=100)
    parser.add_argument("--frames", type=int, default=300)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    config = load(CONFIG)
    full, largest = build_device(config), float(config.contact.max_force)
    started = time.perf_counter()
    assert isinstance(full.body, Body)
    stiffness = rest_stiffness(full.body)
    made = taught(full, stiffness, largest, ChartSettings())
    small = reduced_device(full, stiffness, made)
    built_s = time.perf_counter() - started
    row: dict[str, object] = {
        "full_unknowns": full.body.n,
        "full_points": full.body.volumes.size,
        "displacement_modes": made.basis.displacement.shape[1],
        "pressure_modes": made.basis.pressure.shape[1],
        "points": len(made.cubature.parts),
        "built_s": built_s,
        **errors(full, small, given.cases, largest),
        **step_times(full, small, given.frames, largest),
    }
    for key, value in row.items():
        print(f"{key:>20} {np.array2string(np.asarray(value), precision=3)}", flush=True)
    (given.out / "reduced_pad.json").write_text(json.dumps(row, indent=2) + "\n")


if __name__ == "__main__":
    main()
