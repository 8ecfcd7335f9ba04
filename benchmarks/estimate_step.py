"""Latency of the warm, full-order estimate step over the size of the mesh.

    .venv/bin/python benchmarks/estimate_step.py [--out FOLDER] [--frames N]

Each size is the pad of configs/pad.toml on another mesh, pressed at two places from 0 to 12 N by a punch that
jitters by 0.05 mm as a located contact does. Printed and written to estimate_step.json: compile time, median
and 99th percentile of the time from an observation to its estimate (renewed factors included), nodes,
unknowns, the largest unbalanced nodal force after the last step, and how often something was compiled while
warm. estimate_step.png shows the median over the size with the fitted exponent.
"""

import argparse
import json
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from pad_meshes import pad_on

from softfuse.config.build_device import build_device, build_limits, build_step_settings
from softfuse.equilibrium.linearised import unbalanced
from softfuse.estimation.device import Device, simulate
from softfuse.estimation.estimator import Estimator
from softfuse.estimation.step import Observation

SIZES = (("16 mm", "20 mm"), ("14 mm", "14 mm"), ("12 mm", "12 mm"), ("9 mm", "12 mm"))
"""surface_size and base_size of the meshes."""
PLACES = np.array([[10e-3, -6e-3, 0.0], [-17e-3, 17e-3, 0.0]])
PEAK_N = 12.0


def press(device: Device, place: np.ndarray, frames: int):
    """Locations (f, 3) and volume changes (f, k) of a press up to the peak, from five equilibria."""
    solve = eqx.filter_jit(lambda d, at, f: d.reading(simulate(d, at[None], f[None]).state))
    levels = np.linspace(0.0, PEAK_N, 6)
    at = jnp.asarray(place)
    volumes = np.array([np.asarray(solve(device, at, jnp.asarray(level))) for level in levels])
    ramp = np.minimum(np.linspace(0.0, 1.25, frames), 1.0) * PEAK_N
    change = np.stack([np.interp(ramp, levels, v) for v in volumes.T], axis=1)
    jitter = np.random.default_rng(0).normal(0.0, 0.05e-3, (frames, 3)) * [1.0, 1.0, 0.0]
    return place + jitter, change


def measure(surface_size: str, base_size: str, frames: int) -> dict[str, float]:
    """One row of the benchmark."""
    config = pad_on(surface_size, base_size, "0 mm")
    device = build_device(config)
    estimator = Estimator(device, build_limits(config, 1), jnp.zeros((1, 3)), build_step_settings(config))
    compiled: list[str] = []
    weight = jnp.full(device.readings, 1e9)
    latency, renewals = [], 0
    presses = [
        [
            Observation(jnp.asarray(change), weight, jnp.asarray(location)[None])
            for location, change in zip(*press(device, place, frames), strict=True)
        ]
        for place in PLACES
    ]
    estimator.update(presses[0][0])  # warm
    jax.monitoring.register_event_duration_secs_listener(lambda name, *_, **__: compiled.append(name))
    found = None
    for observations in presses:
        estimator.reset()
        for seen in observations:
            found = estimator.update(seen)
            latency.append(found.latency_s)
            renewals += found.renewed
    retraced = sum("compile" in name or "trace" in name for name in compiled)
    jax.monitoring.clear_event_listeners()
    assert found is not None
    loads = device.loads(presses[-1][-1].places)
    left = unbalanced(device.body, loads, estimator.state)[: device.body.n_displacements]
    return {
        "surface_size_mm": float(surface_size.split()[0]),
        "nodes": device.body.n_nodes,
        "dof": device.body.n,
        "compile_s": estimator.compile_s,
        "p50_ms": 1e3 * float(np.median(latency)),
        "p99_ms": 1e3 * float(np.quantile(latency, 0.99)),
        "frames": len(latency),
        "renewed_factors": renewals,
        "residual_N": float(jnp.max(jnp.abs(left))),
        "force_N": float(found.drive[0]),
        "compilations_while_warm": retraced,
    }


def plot(rows: list[dict[str, float]], path: Path) -> float:
    """Draw the median latency over the nodes; returns the exponent of the fitted power law."""
    from matplotlib.figure import Figure

    nodes, p50 = (np.array([row[key] for row in rows]) for key in ("nodes", "p50_ms"))
    slope, offset = np.polyfit(np.log(nodes), np.log(p50), 1)
    axes = (figure := Figure(figsize=(5.5, 4), layout="constrained", dpi=110)).subplots()
    axes.loglog(nodes, p50, "o", label="median")
    axes.loglog(nodes, [row["p99_ms"] for row in rows], "x", color="0.5", label="99th percentile")
    axes.loglog(nodes, np.exp(offset) * nodes**slope, lw=1, label=f"nodes^{slope:.2f}")
    axes.set(xlabel="Taylor-Hood nodes", ylabel="estimate step [ms]")
    axes.grid(which="both", alpha=0.3)
    axes.legend()
    figure.savefig(path)
    return float(slope)


def main() -> None:
    """Measure all sizes, print a table, write JSON and picture."""
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--frames", type=int, default=100, help="frames of each of the two presses")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    keys = ("nodes", "dof", "compile_s", "p50_ms", "p99_ms", "renewed_factors", "residual_N")
    print("".join(f"{key:>17}" for key in (*keys, "recompilations")))
    rows = []
    for surface_size, base_size in SIZES:
        row = measure(surface_size, base_size, given.frames)
        rows.append(row)
        print("".join(f"{row[key]:17.4g}" for key in (*keys, "compilations_while_warm")), flush=True)
    slope = plot(rows, given.out / "estimate_step.png")
    print(f"median latency grows as nodes^{slope:.2f}")
    result = {"device": jax.devices()[0].device_kind, "exponent": slope, "sizes": rows}
    (given.out / "estimate_step.json").write_text(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
