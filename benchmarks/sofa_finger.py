"""Our cable against outputs of SOFA v25.06 on the cable-driven finger of its examples.

The mesh stands under a copyleft licence and is not part of softfuse: give the folder that holds
finger_forward_large_{5,10,15}mm.npz and .json with SOFA's `nodes`, `tets`, `fixed`, `u`, guide and pulling
points (mm) and its tension `cable_force_mN`. E = 600 kPa, ν = 0.3, linear tetrahedra.

Two comparisons. With SOFA's element law, f_e = −Q K_e (Qᵀ x − X) with Q from a frame of three of the
element's nodes (`large`), and our cable (softfuse.functional.cable), tension and tip must agree with SOFA's
to its own accuracy. With our corotational energy the choice of rotation is another, and so is the answer to
second order in strain. The inverse starts at rest and is given where SOFA's tip is.

    .venv/bin/python benchmarks/sofa_finger.py FOLDER [--out DIR]
"""

import argparse
import json
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.body import LINEAR, Body
from softfuse.estimation.limits import Limits
from softfuse.estimation.step import Observation, exact_steps
from softfuse.functional.cable import guide_forces, length
from softfuse.functional.marker import Marker
from softfuse.functional.material_points import MaterialPoints
from softfuse.material import Corotational, lame_constants
from softfuse.mechanics import RESULTS, Loads, Newton, State, solve
from softfuse.mechanics.cable import PulledCable, ShortenedCable
from softfuse.mechanics.dense import Dense
from softfuse.mechanics.model import Model
from softfuse.mechanics.reading import AnswerReading, ShapeReading
from softfuse.mesh.tetmesh import tet_mesh

YOUNG, POISSON = 600e3, 0.3
SHORTENED_MM = (5, 10, 15)
NEWTON_STEPS, INVERSE_STEPS = 40, 30


class Reference(NamedTuple):
    """SOFA's finger, in m and N: mesh, fixed nodes, guides, pulling point; displacements and tension."""

    nodes: Float[np.ndarray, "n 3"]
    tets: np.ndarray
    fixed: np.ndarray
    guides: Float[np.ndarray, "g 3"]
    pulled_at: Float[np.ndarray, "3"]
    u: Float[np.ndarray, "n 3"]
    tension: float


def reference(folder: Path, shortened_mm: int) -> Reference:
    """What SOFA found at a shortening; exits with what is missing."""
    path = folder / f"finger_forward_large_{shortened_mm}mm.npz"
    try:
        with np.load(path) as data:
            d = {name: data[name] for name in data.files}
        tension = json.loads(path.with_suffix(".json").read_text())["cable_force_mN"]
    except (OSError, KeyError) as error:
        raise SystemExit(f"error: {path} and its .json do not hold SOFA's finger: {error}") from None
    lengths = (1e-3 * d[name] for name in ("nodes", "cable_points_rest", "pull_point", "u"))
    nodes, guides, pulled_at, u = lengths
    return Reference(nodes, d["tets"], d["fixed"], guides, pulled_at, u, 1e-3 * tension)


def our_body(finger: Reference) -> Body:
    """The same mesh with our corotational energy."""
    fixed = np.zeros(len(finger.nodes), bool)
    fixed[finger.fixed] = True
    mesh = tet_mesh(finger.nodes, finger.tets)
    return Body.from_mesh(mesh, [Corotational.from_young(YOUNG, POISSON)], fixed, element=LINEAR)


def tip_node(finger: Reference) -> int:
    """The node that SOFA moves farthest."""
    return int(np.argmax(np.linalg.norm(finger.u, axis=1)))


def edges(x: Float[Array, "e 4 3"]) -> Float[Array, "e 3 3"]:
    """Edge matrices [x1 − x0, x2 − x0, x3 − x0]."""
    return jnp.swapaxes(x[:, 1:] - x[:, :1], 1, 2)


def frames(x: Float[Array, "e 4 3"]) -> Float[Array, "e 3 3"]:
    """SOFA's `large` frame of each element: e1 along the first edge, e3 across the first face."""

    def unit(v):
        return v / jnp.linalg.norm(v, axis=1, keepdims=True)

    first = unit(x[:, 1] - x[:, 0])
    third = unit(jnp.cross(first, x[:, 2] - x[:, 0]))
    return jnp.stack([first, jnp.cross(third, first), third], axis=1)


def element_stiffness(rest: Float[Array, "e 4 3"]) -> Float[Array, "e 12 12"]:
    """K_e = V Bᵀ C B [N/m] of linear tetrahedra."""
    inner = jnp.linalg.inv(edges(rest))
    slopes = jnp.concatenate([-inner.sum(axis=1, keepdims=True), inner], axis=1)
    eye = jnp.eye(3)
    # Strain ε_ij = (u_i,j + u_j,i) / 2 for nodal displacement (a, k).
    strain = 0.5 * (jnp.einsum("eaj,ik->eijak", slopes, eye) + jnp.einsum("eai,jk->eijak", slopes, eye))
    strain = strain.reshape(*strain.shape[:3], 12)
    lame, mu = lame_constants(YOUNG, POISSON)
    trace = jnp.einsum("eiim->em", strain)
    volume = jnp.linalg.det(edges(rest)) / 6
    each = 2 * mu * jnp.einsum("eijm,eijn->emn", strain, strain) + lame * trace[:, :, None] * trace[:, None]
    return volume[:, None, None] * each


class SofaFinger:
    """SOFA's element law with our cable on its finger."""

    def __init__(self, finger: Reference):
        """Unknowns are the free nodes' displacements, then the tension."""
        self.finger = finger
        self.free = np.setdiff1d(np.arange(len(finger.nodes)), finger.fixed)
        points = MaterialPoints.embedded(our_body(finger), finger.guides)
        self._guide_nodes, self._guide_shape = points.nodes, points.shape(jnp.asarray(finger.nodes))
        self._rest = jnp.asarray(finger.nodes)[finger.tets]
        self._stiffness = element_stiffness(self._rest)
        self._length = float(length(finger.guides, finger.pulled_at))
        self._slope = jax.jit(jax.jacfwd(self._missing))

    def displaced(self, x: Float[Array, " m"]) -> Float[Array, "n 3"]:
        """Displacements of all nodes [m]."""
        return jnp.zeros(self.finger.nodes.shape).at[self.free].set(x[:-1].reshape(-1, 3))

    def _missing(self, x: Float[Array, " m"], shortened: float) -> Float[Array, " m"]:
        """Forces out of balance [N], then by how much the cable is too long [m]."""
        now = self.finger.nodes + self.displaced(x)
        elements = now[self.finger.tets]
        turn = jnp.swapaxes(frames(elements), 1, 2) @ frames(self._rest)
        back = jnp.einsum("eji,eaj->eai", turn, elements) - self._rest
        local = jnp.einsum("emn,en->em", self._stiffness, back.reshape(-1, 12)).reshape(-1, 4, 3)
        inner = jnp.zeros_like(now).at[self.finger.tets].add(jnp.einsum("eij,eaj->eai", turn, local))
        guides = jnp.einsum("ga,gai->gi", self._guide_shape, now[self._guide_nodes])
        pulls = guide_forces(guides, self.finger.pulled_at, x[-1], jnp.zeros(()))
        outer = jnp.zeros_like(now).at[self._guide_nodes].add(self._guide_shape[:, :, None] * pulls[:, None])
        short = length(guides, self.finger.pulled_at) - (self._length - shortened)
        return jnp.append((inner - outer)[self.free].ravel(), short)

    def shortened(self, amount: float, start: Float[Array, " m"]) -> Float[Array, " m"]:
        """The equilibrium at a shortening [m], by Newton's method in steps of at most 1 mm."""
        x, done = start, float(self._length - self._length_at(start))
        for at in np.linspace(done, amount, 2 + int(abs(amount - done) / 1e-3))[1:]:
            for _ in range(NEWTON_STEPS):
                change = jnp.linalg.solve(self._slope(x, at), -self._missing(x, at))
                x = x + change
                if float(jnp.max(jnp.abs(change))) < 1e-13:
                    break
        return x

    def _length_at(self, x: Float[Array, " m"]) -> float:
        now = self.finger.nodes + self.displaced(x)
        guides = jnp.einsum("ga,gai->gi", self._guide_shape, now[self._guide_nodes])
        return float(length(guides, self.finger.pulled_at))

    def inverse(self, tip: int, target: Float[np.ndarray, "3"]) -> tuple[float, Float[Array, " m"]]:
        """Shortening [m] that brings a node nearest to a target (3,) m, by Gauss-Newton from rest."""
        amount, x = 1e-3, jnp.zeros(3 * len(self.free) + 1)
        for _ in range(INVERSE_STEPS):
            x = self.shortened(amount, x)
            along = jnp.linalg.solve(self._slope(x, amount), jnp.zeros_like(x).at[-1].set(-1.0))
            moves = np.asarray(self.displaced(along))[tip]
            off = target - (self.finger.nodes[tip] + np.asarray(self.displaced(x))[tip])
            step = float(np.clip(moves @ off / (moves @ moves), -3e-3, 3e-3))
            amount += step
            if abs(step) < 1e-13:
                break
        return amount, self.shortened(amount, x)


def with_our_energy(finger: Reference, shortened_mm: int) -> tuple[float, np.ndarray, int]:
    """Tension [N], displacements (n, 3) m and load steps with our corotational energy."""
    body = our_body(finger)
    cable = PulledCable.through(body, finger.guides, finger.pulled_at)
    loads = Loads((ShortenedCable.of(cable, body),))
    drive = jnp.array([1e-3 * shortened_mm])
    found = eqx.filter_jit(solve)(Newton(Dense.plan(body)), body, loads, drive, State.rest(body, loads))
    if not bool(found.result == RESULTS.converged):
        raise SystemExit(f"error: {shortened_mm} mm: {RESULTS[found.result]}")
    u = np.asarray(body.displacement(found.state.z))
    return float(found.state.internal[0]), u, int(found.stats.load_steps)


def inverse_with_our_energy(finger: Reference, tip: int) -> tuple[float, float, float]:
    """Shortening [m], tension [N] and distance [m] from SOFA's tip, by the estimator's own steps."""
    body = our_body(finger)
    cable = PulledCable.through(body, finger.guides, finger.pulled_at)
    markers = (Marker(jnp.array([tip]), jnp.ones(1), axis) for axis in jnp.eye(3))
    readings = (*map(ShapeReading, markers), AnswerReading((0,)))
    model = Model(body, readings, (), Dense.plan(body), (cable,))
    limits = Limits(jnp.zeros(1), jnp.full(1, 5.0), jnp.zeros(1), motion=jnp.array(5e-3))
    whitening = jnp.diag(jnp.array([1e3] * 3 + [0.0]))
    target = Observation(jnp.append(finger.u[tip], 0.0), whitening, jnp.zeros((0, 3, 3)))
    rest = model.rest_state(target.places)
    state, report = eqx.filter_jit(exact_steps)(model, limits, rest, target, steps=INVERSE_STEPS)
    off = float(jnp.linalg.norm(report.misfit[:3]))
    return float(model.answers(state)[0]), float(state.drive[0]), off


def main() -> None:
    """Print and write how far tension and tip are from SOFA's."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path, help="SOFA's finger_forward_large_*mm.npz and .json")
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)

    rows = []
    for mm in SHORTENED_MM:
        finger = reference(options.folder, mm)
        tip, sofa = tip_node(finger), SofaFinger(finger)
        x = sofa.shortened(1e-3 * mm, jnp.zeros(3 * len(sofa.free) + 1))
        tension, u, steps = with_our_energy(finger, mm)
        by_law, there = np.asarray(sofa.displaced(x))[tip], finger.u[tip]
        row = {
            "shortened_mm": mm,
            "sofa_tension_mN": 1e3 * finger.tension,
            "law_tension_error": abs(float(x[-1]) / finger.tension - 1),
            "law_tip_error": float(np.linalg.norm(by_law - there) / np.linalg.norm(there)),
            "energy_tension_mN": 1e3 * tension,
            "energy_tension_error": abs(tension / finger.tension - 1),
            "energy_tip_error": float(np.linalg.norm(u[tip] - there) / np.linalg.norm(there)),
            "energy_load_steps": steps,
        }
        rows.append(row)
        print(", ".join(f"{name} {value:.3g}" for name, value in row.items()), flush=True)

    finger = reference(options.folder, 10)
    tip, sofa = tip_node(finger), SofaFinger(finger)
    amount, x = sofa.inverse(tip, finger.nodes[tip] + finger.u[tip])
    ours, tension, off = inverse_with_our_energy(finger, tip)
    inverse = {
        "law_shortened_mm": 1e3 * amount,
        "law_tension_mN": 1e3 * float(x[-1]),
        "energy_shortened_mm": 1e3 * ours,
        "energy_tension_mN": 1e3 * tension,
        "energy_tip_off_mm": 1e3 * off,
    }
    print("inverse: " + ", ".join(f"{name} {value:.6g}" for name, value in inverse.items()))
    options.out.mkdir(parents=True, exist_ok=True)
    path = options.out / "sofa_finger.json"
    path.write_text(json.dumps({"forward": rows, "inverse": inverse}, indent=2) + "\n")
    print(f"written to {path}")


if __name__ == "__main__":
    main()
