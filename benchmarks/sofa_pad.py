"""The estimate step on the meshes, and with the element, that SOFA and SoftRobots.Inverse were timed on.

    .venv/bin/python benchmarks/sofa_pad.py [--out FOLDER] [--frames N]

Linear corotational tets, E = 100 kPa, ν = 0.45, on three meshes of a pad with four cavities; one unknown, the
force that is shared equally by the nodes within 10 mm of a place on the top, is estimated from the cavities'
volumes, as SOFA's QPInverseProblemSolver does with volume effectors and one force actuator. The force goes
from 0 to 5 N and back. Printed and written to sofa_pad.json: median and 99th percentile of a step, renewed
factors included, SOFA's median beside it, and the exponents of both over the nodes. SOFA's figures (v25.06,
one step with a new factor each, on another machine of the same kind: 2 cores) are not measured here.
"""

import argparse
import json
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.body import LINEAR, Body
from softfuse.estimation.estimator import Estimator
from softfuse.estimation.limits import Limits
from softfuse.estimation.step import Observation
from softfuse.functional.cavity import Cavity
from softfuse.material import Corotational
from softfuse.mechanics import LinearPorts, Multifrontal, PrescribedForce
from softfuse.mechanics.load import AbstractContact
from softfuse.mechanics.model import Model, simulate
from softfuse.mechanics.reading import ShapeReading
from softfuse.mesh.surface import cavities
from softfuse.mesh.tetmesh import tet_mesh

MESHES = Path(__file__).parents[1] / "tests" / "data" / "sofa_pad.npz"
CENTRES_MM = np.array([[16.0, 16.0, 10.0], [-16.0, 16.0, 10.0], [-16.0, -16.0, 10.0], [16.0, -16.0, 10.0]])
SOFA_MS = {"pad_s": 9.5, "pad_m": 66.0, "pad_l": 506.0}
PEAK_N = 5.0
NOWHERE = np.zeros((1, 3, 3))
"""The only place."""


class SharedForce(AbstractContact):
    """A force in −z that some nodes share equally; it has one place."""

    pressed: Int[Array, " p"]

    @property
    def arms(self):
        """The force, at the place."""
        return jnp.zeros(1)

    def load(self, body, place):
        """The force as a load."""
        del place
        rows = jnp.zeros((body.n, 1))
        rows = rows.at[body.displacement_index[self.pressed, 2], 0].set(-1.0 / self.pressed.shape[0])
        return PrescribedForce.on(LinearPorts(jnp.zeros(1), rows), body, jnp.ones(1))


def sofa_pad(name: str) -> Model:
    """The pad as a robot whose readings are its cavities' volume changes."""
    with np.load(MESHES) as data:
        nodes, tets, bottom, press = (data[f"{name}_{key}"] for key in ("nodes", "tets", "bottom", "press"))
    mesh = tet_mesh(1e-3 * nodes, tets.astype(np.int64))
    fixed = np.zeros(len(nodes), bool)
    fixed[bottom.astype(np.int64)] = True
    body = Body.from_mesh(mesh, [Corotational.from_young(100e3, 0.45)], fixed, element=LINEAR)
    walls = (Cavity(jnp.asarray(part.faces)) for part in cavities(mesh, 1e-3 * CENTRES_MM))
    pressed = SharedForce(jnp.asarray(press, jnp.int32))
    return Model(body, tuple(map(ShapeReading, walls)), (pressed,), Multifrontal.plan(body))


def readings(model: Model, force: Float[np.ndarray, " f"]) -> Float[np.ndarray, "f k"]:
    """Volume changes (f, k) [m³] under forces (f,) [N], between six equilibria."""
    solve = eqx.filter_jit(lambda d, f: d.reading(simulate(d, NOWHERE, f[None]).state))
    levels = np.linspace(0.0, PEAK_N, 6)
    volumes = np.array([np.asarray(solve(model, jnp.asarray(level))) for level in levels])
    return np.stack([np.interp(force, levels, column) for column in volumes.T], axis=1)


def measure(name: str, frames: int) -> dict[str, float]:
    """One row of the benchmark."""
    model = sofa_pad(name)
    limits = Limits(jnp.zeros(1), jnp.full(1, 50.0), jnp.zeros(1))
    estimator = Estimator(model, limits, jnp.asarray(NOWHERE))
    force = PEAK_N * np.abs(np.interp(np.arange(frames), [0, frames / 2, frames], [0, 1, 0]))
    whitening = 1e9 * jnp.eye(model.n_readings)
    seen = [
        Observation(jnp.asarray(reading), whitening, jnp.asarray(NOWHERE))
        for reading in readings(model, force)
    ]
    for each in seen[:3]:
        estimator.update(each)
    estimator.reset()
    latency, off, renewed = [], [], 0
    for each, true in zip(seen, force, strict=True):
        found = estimator.update(each)
        latency.append(found.latency_s)
        off.append(abs(found.drive[0] - true))
        renewed += found.renewed
    return {
        "mesh": name,
        "nodes": model.body.n_nodes,
        "p50_ms": 1e3 * float(np.median(latency)),
        "p99_ms": 1e3 * float(np.quantile(latency, 0.99)),
        "renewed_factors": renewed,
        "largest_error_N": float(np.max(off)),
        "compile_s": estimator.compile_s,
        "sofa_ms": SOFA_MS[name],
    }


def main() -> None:
    """Measure the three meshes, print a table, write JSON."""
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--frames", type=int, default=200)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    keys = ("nodes", "p50_ms", "p99_ms", "renewed_factors", "largest_error_N", "compile_s", "sofa_ms")
    print(f"{'mesh':>8}" + "".join(f"{key:>17}" for key in keys))
    rows = []
    for name in SOFA_MS:
        rows.append(measure(name, given.frames))
        print(f"{name:>8}" + "".join(f"{rows[-1][key]:17.4g}" for key in keys), flush=True)
    nodes = np.log([row["nodes"] for row in rows])
    ours, sofas = (
        float(np.polyfit(nodes, np.log([row[key] for row in rows]), 1)[0]) for key in ("p50_ms", "sofa_ms")
    )
    print(f"median step grows as nodes^{ours:.2f}, SOFA's as nodes^{sofas:.2f}")
    result = {"device": jax.devices()[0].device_kind, "exponent": ours, "sofa_exponent": sofas, "sizes": rows}
    (given.out / "sofa_pad.json").write_text(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
