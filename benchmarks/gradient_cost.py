"""What the gradient of an estimate costs, as a multiple of the estimate itself.

    .venv/bin/python benchmarks/gradient_cost.py [--out FOLDER] [--repeats N]

The estimate is `exact_steps` with one step from a pressed state of the pad of configs/pad.toml, at this and a
coarser mesh: a new factor of the tangent, the response to every pressure cell, the contact, the QP. The
gradient is that of its force with respect to everything that it is computed from: rest nodes, materials, the
sensors' readings and weights, the place, the limits and the state before, in reverse mode. Both are measured
in turns in one run; printed and written to gradient_cost.json are the medians and their ratio.
"""

import argparse
import json
import time
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from pad_meshes import pad_on

from softfuse.config.build_device import build_device, build_limits
from softfuse.estimation.device import simulate
from softfuse.estimation.step import Observation, exact_steps

SIZES = (("16 mm", "20 mm", "0 mm"), ("12 mm", "12 mm", "3 mm"))
"""surface_size, base_size and fine_depth of the meshes."""
PLACE = jnp.array([[10e-3, -6e-3, 0.0]])
BEFORE_N, NOW_N = 5.0, 5.5


def measure(sizes: tuple[str, str, str], repeats: int) -> dict[str, float]:
    """One row of the benchmark."""
    config = pad_on(*sizes)
    device, limits = build_device(config), build_limits(config, 1)
    before, now = (simulate(device, PLACE, jnp.array([force])).state for force in (BEFORE_N, NOW_N))
    reading = eqx.filter_jit(lambda d, s: d.reading(s))(device, now)
    seen = Observation(reading, jnp.full(device.readings, 1e9), PLACE)
    inputs, rest = eqx.partition((device, limits, before, seen), eqx.is_inexact_array)
    indices, static = eqx.partition(rest, eqx.is_array)

    def force(inputs, indices):
        after, _ = exact_steps(*eqx.combine(inputs, indices, static), steps=1)
        return after.drive[0]

    row: dict[str, float] = {
        "nodes": device.body.n_nodes,
        "inputs": sum(x.size for x in jax.tree.leaves(inputs)),
    }
    programs = {}
    for name, function in (("estimate", force), ("gradient", jax.value_and_grad(force))):
        started = time.perf_counter()
        programs[name] = jax.jit(function).lower(inputs, indices).compile()
        row[f"{name}_compile_s"] = time.perf_counter() - started
    taken: dict[str, list[float]] = {name: [] for name in programs}
    for _ in range(repeats + 1):
        for name, program in programs.items():
            started = time.perf_counter()
            jax.block_until_ready(program(inputs, indices))
            taken[name].append(time.perf_counter() - started)
    for name, times in taken.items():
        row[f"{name}_ms"] = 1e3 * float(np.median(times[1:]))
    row["ratio"] = row["gradient_ms"] / row["estimate_ms"]
    return row


def main() -> None:
    """Measure both meshes, print a table, write JSON."""
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--repeats", type=int, default=15)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    rows = [measure(sizes, given.repeats) for sizes in SIZES]
    keys = list(rows[0])
    print("".join(f"{key:>20}" for key in keys))
    for row in rows:
        print("".join(f"{row[key]:20.4g}" for key in keys), flush=True)
    result = {"device": jax.devices()[0].device_kind, "sizes": rows}
    (given.out / "gradient_cost.json").write_text(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
