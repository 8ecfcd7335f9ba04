"""Volume changes of the pad over the mesh, against numbers from independent codes.

    .venv/bin/python benchmarks/mesh_convergence.py [--out FOLDER]

Four meshes, the one of configs/pad.toml among them, under the twelve load cases of
tests/data/pad_reference.json; the error is the largest over the cavities, relative to the largest volume
change of the case. For the uniform loads of 5 N tests/data/pad_converged.json holds a finer reference.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from pad_meshes import CONFIG, pad_on

from softfuse.functional.chart import facing
from softfuse.functional.pressure_cells import flat_punch, uniform
from softfuse.mechanics.model import simulate
from softfuse.robot.file import load
from softfuse.robot.robot import build_robot

DATA = CONFIG.parents[1] / "tests" / "data"


def errors(model, cases: list[dict[str, Any]]) -> list[float]:
    """Largest relative errors in percent."""
    solve = eqx.filter_jit(lambda d, at, f: d.reading(simulate(d, at, f).state))
    found = []
    for case in cases:
        cells = {"punch": flat_punch, "uniform": uniform}[case["contact"]]()
        pressed = eqx.tree_at(lambda d: d.contacts[0].cells, model, cells)
        at = facing(1e-3 * np.array([[*case["at"], 0.0]]), (0, 0, -1))
        change = 1e9 * np.asarray(solve(pressed, at, jnp.array([case["force_N"]])))
        true = np.array(case["volume_change_mm3"])
        found.append(float(100 * np.max(np.abs(change - true)) / np.max(np.abs(true))))
    return found


def plot(rows: list[dict[str, Any]], path: Path) -> None:
    """Draw the errors over the nodes, one panel for each reference and contact model."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 3.6), layout="constrained", dpi=110)
    panels = figure.subplots(1, 3, sharey=True)
    for axes, (source, contact) in zip(
        panels, (("reference", "uniform"), ("converged", "uniform"), ("reference", "punch")), strict=True
    ):
        for case in rows[0][source]:
            if case["contact"] == contact:
                label = f"{tuple(case['at'])} mm, {case['force_N']:.0f} N"
                same = [next(c for c in row[source] if c["case"] == case["case"]) for row in rows]
                axes.loglog([row["nodes"] for row in rows], [c["error"] for c in same], "o-", label=label)
        axes.set(title=f"{contact}, against pad_{source}.json", xlabel="Taylor-Hood nodes")
        axes.grid(which="both", alpha=0.3)
        axes.legend(fontsize="x-small")
    panels[0].set_ylabel("error / largest volume change [%]")
    figure.savefig(path)


def main() -> None:
    """Solve all cases on all meshes, print a table, write JSON and picture."""
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    reference = json.loads((DATA / "pad_reference.json").read_text())
    finer = json.loads((DATA / "pad_converged.json").read_text())["cases"]
    converged = [{"contact": "uniform", "force_N": 5.0} | case for case in finer if case["order"] == 4]
    configs = [
        pad_on("16 mm", "20 mm", "0 mm"),
        pad_on("14 mm", "14 mm", "0 mm"),
        load(CONFIG),
        pad_on("9 mm", "12 mm", "0 mm"),
    ]
    rows = []
    for config in configs:
        model = build_robot(config).model
        row: dict[str, Any] = {"nodes": model.body.n_nodes, "dof": model.body.n}
        for source, cases in (("reference", reference), ("converged", converged)):
            kept = ("contact", "at", "force_N")
            row[source] = [
                {"case": k, "error": error} | {key: case[key] for key in kept}
                for k, (case, error) in enumerate(zip(cases, errors(model, cases), strict=True))
            ]
        rows.append(row)
        for source in ("reference", "converged"):
            for case in row[source]:
                place = f"({case['at'][0]:g}, {case['at'][1]:g})"
                print(
                    f"{row['nodes']:6d} nodes  {source:9s} {case['contact']:7s} {place:10s} "
                    f"{case['force_N']:5.1f} N  {case['error']:6.2f} %",
                    flush=True,
                )
    plot(rows, given.out / "mesh_convergence.png")
    (given.out / "mesh_convergence.json").write_text(json.dumps(rows, indent=2) + "\n")


if __name__ == "__main__":
    main()
