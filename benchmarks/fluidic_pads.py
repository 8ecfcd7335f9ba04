"""How well one model fits presses on real fluidic tactile pads, channels of air with pressure sensors.

    .venv/bin/python benchmarks/fluidic_pads.py --fit DIR --test DIR --json FILE [--tables FOLDER] [--finer 1]

DIR holds tables `presses_1d_air_1p5mm.csv` and `peaks_1d_air_1p5mm.csv` of pads by Goshtasbi et al. (Nature
Communications 2026, DOI 10.1038/s41467-026-72497-3), one for each diameter of the channel. Unknown, and
fitted to all of them together: Young's modulus, the volume of the tubes, the thickness of the pad with the
channel in its middle, and by how much the depth's zero is off. Where --fit and --test are one folder, each
place is predicted from the others.

A pad is pressed by a sphere of 4 mm. Its forces are in proportion to Young's modulus E, and forces and
volumes depend on the gas by p / E alone; so they are computed once for some depths, places, pressures and
thicknesses and interpolated, and the gas follows from the volume, p_a V = (p_a + p) (V + ΔV). Each of 27
meshes takes one to two minutes on two cores; --tables keeps what is computed.

Told are root mean squares over the presses before the channel's walls touch, in parts of the largest value of
the diameter's tables: of pressure and force as functions of depth, and of the force that the pressures tell
where the place is known. After that, pads tell where they are pressed, and `closed` will say how well.
"""

import argparse
import csv
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator, RegularGridInterpolator
from scipy.optimize import brentq, least_squares

import softfuse as sf
from softfuse.mechanics.linear_solver import AbstractLinearSolver
from softfuse.mesh.files import write_mesh
from softfuse.mesh.kuhn import kuhn_grid
from softfuse.mesh.orientation import oriented
from softfuse.mesh.tetmesh import quadratic, tet_mesh
from softfuse.robot.file import parse

MM, KPA = 1e-3, 1e3
LENGTH, WIDTH, CHANNEL = 100 * MM, 20 * MM, 92 * MM
ATMOSPHERE_PA, YOUNG_PA = 101.325 * KPA, 1e6
CLOSED_M = {1.0: 1.35 * MM, 1.5: 1.7 * MM, 2.0: 1.95 * MM}
"""Depths from which the walls touch, by the diameter in mm."""
APART_PA = 100.0
"""Difference of the two ends' pressures from which the channel is closed."""

THICKNESSES_M = np.array([6.5, 7.0, 8.0]) * MM
PLACES_M = np.array([0.0, 30.0, 40.0]) * MM
"""From the middle; both halves are alike."""
DEPTHS = np.array([0.5, 0.65, 0.8, 0.9, 1.0, 1.08])
"""In parts of that at which the channel closes."""
STRETCHES = np.array([0.0, 0.01])
"""Gauge pressures over Young's modulus."""
NEAR = 0.1
"""Part of the way to the next depth from which an equilibrium on it counts."""

FINE_M, CELLS, SIDE = 1.2 * MM, 16, 4
"""Edges of the boxes near the press, and how many there are along the channel and on each of its sides."""

CONFIG = """
[robot]
name = "Fluidic pad"
[body.source]
type = "mesh"
file = "{file}"
unit = "m"
[[body.material]]
law = "neo-hookean"
young = "{young} Pa"
poisson = 0.49
[body.fixed]
z = ["0 mm", "0 mm"]
[[chamber]]
name = "channel"
centre = ["0 mm", "0 mm", "{middle} mm"]
gas = "driven"
highest = "1 MPa"
[[contact]]
name = "ball"
model = "sphere"
radius = "4 mm"
max_force = "100 N"
surface = {{ normal = [0, 0, 1], angle = "20 deg" }}
"""


class Press(NamedTuple):
    """A press as measured: its file, diameter in mm, place from the channel's middle [m], depth [m], gauge
    pressures of both ends [Pa], force [N].
    """

    file: str
    diameter: float
    at_m: float
    depth_m: float
    ends_Pa: tuple[float, float]
    force_N: float

    @property
    def pressure_Pa(self) -> float:
        """Of the open channel."""
        return 0.5 * sum(self.ends_Pa)

    @property
    def open(self) -> bool:
        """Whether the walls do not touch."""
        left, right = self.ends_Pa
        return self.depth_m < CLOSED_M[self.diameter] and abs(left - right) <= APART_PA


def read(folder: Path) -> list[Press]:
    """All presses of a folder's tables of air of which the depth is known."""
    found = []
    for path in sorted(folder.glob("p*_1d_air_*mm.csv")):
        whole = re.fullmatch(r"(presses|peaks)_1d_air_(\d)p(\d)mm", path.stem)
        if whole is None:
            continue
        suffix = "_early" if whole[1] == "presses" else ""
        with path.open(newline="") as file:
            found += [
                Press(
                    path.name,
                    float(f"{whole[2]}.{whole[3]}"),
                    (float(row["X_mm"]) - 50.0) * MM,
                    float(row["depth_mm"]) * MM,
                    (float(row[f"Pl{suffix}_kPa"]) * KPA, float(row[f"Pr{suffix}_kPa"]) * KPA),
                    float(row[f"F{suffix}_N"]),
                )
                for row in csv.DictReader(file)
                if row["depth_mm"]
            ]
    if not found:
        raise SystemExit(f"{folder}: no tables such as presses_1d_air_1p5mm.csv")
    return found


def _apart(count: int, first: float, length: float) -> np.ndarray:
    """Distances (count,) from 0 to a length, the first of which is given and which grow alike, without 0."""
    if count * first >= length:
        return np.linspace(0.0, length, count + 1)[1:]
    ratio = brentq(lambda r: first * np.sum(r ** np.arange(count)) - length, 1.0, 10.0)
    return np.cumsum(first * ratio ** np.arange(count))


def mesh(diameter: float, thickness: float, at: float, finer: int, path: Path) -> None:
    """Write a pad with a round channel, fine where it is pressed, so many times finer than as drawn; all that
    are as fine have the same tetrahedra.

    Boxes with a square channel of the same section, made round towards the middle of a pad; its ends are
    square. A press at a place is as one at its mirror image.
    """
    middle, end, radius = 0.5 * thickness, 0.5 * CHANNEL, 0.5 * diameter * MM
    half, fine = 0.5 * np.sqrt(np.pi) * radius, FINE_M / finer
    shorter = max(3 * finer, round(CELLS * finer * (end - at) / CHANNEL))
    left = at - _apart(CELLS * finer - shorter, fine, end + at)[::-1]
    right = at + _apart(shorter, fine, end - at)
    x = np.concatenate([[-0.5 * LENGTH], left, [at], right, [0.5 * LENGTH]])
    side = half + _apart(SIDE * finer, fine, 0.5 * WIDTH - half)
    y = np.concatenate([-side[::-1], np.linspace(-half, half, 2 * finer + 1), side])
    below = np.linspace(0.0, middle - half, finer + 1)[:-1]
    above = np.linspace(middle + half, thickness, 2 * finer + 1)[1:]
    z = np.concatenate([below, middle + np.linspace(-half, half, 2 * finer + 1), above])
    boxes = np.stack(np.meshgrid(*(0.5 * (p[1:] + p[:-1]) for p in (x, y, z)), indexing="ij"), axis=-1)
    solid = (np.abs(boxes - [0.0, 0.0, middle]) > [end, half, half]).any(axis=-1)
    odd = (0, SIDE * finer % 2, finer % 2)
    grid = kuhn_grid((x, y, z), solid, odd)
    linear = oriented(tet_mesh(grid.nodes, grid.tets))

    def rounded(nodes: np.ndarray) -> np.ndarray:
        across = nodes[:, 1:] - [0.0, middle]
        square, circle = np.abs(across).max(axis=1), np.linalg.norm(across, axis=1)
        part = np.clip((middle - square) / (middle - half), 0.0, 1.0)
        part *= np.interp(nodes[:, 0], x[[1, 2, -3, -2]], [0.0, 1.0, 1.0, 0.0])
        factor = np.divide(square * radius / half, circle, out=np.ones_like(circle), where=circle > 0.0)
        return np.column_stack([nodes[:, 0], [0.0, middle] + (1.0 + part * (factor - 1.0))[:, None] * across])

    straight, chords = quadratic(linear), quadratic(tet_mesh(rounded(linear.nodes), linear.tets))
    wall = np.isclose(np.abs(straight.nodes[:, 1:] - [0.0, middle]).max(axis=1), half, rtol=1e-6)
    wall &= (straight.nodes[:, 0] >= x[2]) & (straight.nodes[:, 0] <= x[-3])
    write_mesh(path, tet_mesh(np.where(wall[:, None], rounded(straight.nodes), chords.nodes), straight.tets))


def answers(robot: sf.Robot, diameter: float, thickness: float, at: float) -> np.ndarray:
    """Force [N] of a pad of `YOUNG_PA` and change of its channel [m³] by depth and p / E (d, s, 2)."""
    table = np.empty((len(DEPTHS), len(STRETCHES), 2))
    for s, stretch in enumerate(STRETCHES):
        state, found = None, []
        for depth in DEPTHS * CLOSED_M[diameter]:
            press = sf.Press("ball", f"{at / MM},0,{thickness / MM}", depth_m=float(depth))
            trial = sf.Trial.of(robot, [press], pressures=[f"channel={stretch * YOUNG_PA} Pa"])
            # From None another program would be compiled.
            solution = trial.searched(trial.rest if state is None else state)
            state, numbers = solution.state, trial.numbers(solution)
            ball = numbers["contacts"][0]
            change = 1e-9 * numbers["chambers"]["channel"]["volume_change_mm3"]
            if solution.success or float(solution.stats.reached) > NEAR:
                found.append((MM * ball["depth_mm"], ball["force_N"], change))
            if not solution.success:
                print(f"{diameter:g} mm, {depth / MM:g} mm deep: {trial.failure(solution)}", flush=True)
                break
        table[:, s] = by_depth(np.array(found), DEPTHS * CLOSED_M[diameter])
    print(f"{diameter:g} mm, {thickness / MM:g} mm thick, pressed at {at / MM:g} mm", flush=True)
    return table


def by_depth(found: np.ndarray, depths: np.ndarray) -> np.ndarray:
    """Answers (d, 2) at depths (d,) m from rows of depth and answers (n, 3), the last of which may be as deep
    as it went: beyond, walls that do not touch have no equilibrium, and the table goes on in a line.
    """
    if len(found) < 3:
        raise SystemExit("too few depths have an equilibrium")
    (before, *low), (last, *high) = found[-2:]
    slope = (np.array(high) - low) / (last - before)
    inside = np.column_stack([np.interp(depths, found[:, 0], each) for each in found[:, 1:].T])
    return inside + np.maximum(depths - last, 0.0)[:, None] * slope


@dataclass
class Pads:
    """Pads of `YOUNG_PA`, so many times finer than as drawn, with answers that are kept in a folder. All are
    eliminated like the first and count all faces near a press: one compiled program solves them.
    """

    finer: int
    folder: Path
    linear: AbstractLinearSolver | None = None

    def built(self, diameter: float, thickness: float, at: float) -> sf.Robot:
        """A pad with a mesh for presses at a place."""
        with TemporaryDirectory() as folder:
            path = Path(folder) / "pad.vtu"
            mesh(diameter, thickness, at, self.finer, path)
            text = CONFIG.format(file=path.name, young=YOUNG_PA, middle=0.5 * thickness / MM)
            robot = sf.build_robot(parse(text, Path(folder) / "pad.toml"))
        (ball,) = robot.model.contacts
        ball = replace(ball, surface=replace(ball.surface, near=len(ball.surface.faces)))
        self.linear = self.linear or robot.model.linear
        return replace(robot, model=replace(robot.model, contacts=(ball,), linear=self.linear))

    def tables(self, diameter: float) -> np.ndarray:
        """`answers` of all thicknesses and places (t, x, d, s, 2)."""
        return np.array([[self.kept(diameter, t, x) for x in PLACES_M] for t in THICKNESSES_M])

    def kept(self, diameter: float, thickness: float, at: float) -> np.ndarray:
        """`answers`, from the folder where they are there for the same depths, pressures and mesh."""
        grid = np.array([*DEPTHS, *STRETCHES, FINE_M / self.finer, CELLS * self.finer, SIDE * self.finer])
        path = self.folder / f"{diameter:g}mm_{thickness / MM:g}mm_{at / MM:g}mm.npz"
        if path.exists():
            with np.load(path) as found:
                if np.array_equal(found["grid"], grid):
                    return found["table"]
        table = answers(self.built(diameter, thickness, at), diameter, thickness, at)
        np.savez(path, grid=grid, table=table)
        return table


@dataclass(frozen=True, eq=False)
class Channel:
    """A pad of one diameter with the parameters (4,) that all share: ln of Young's modulus [Pa] and of the
    tubes' volume [m³], thickness [m], and depth of the zero [m].
    """

    diameter: float
    theta: np.ndarray
    interpolated: RegularGridInterpolator

    def pressed(self, at_m: float, depth_m: float) -> tuple[float, float]:
        """Gauge pressure [Pa] and force [N]."""
        (young, tubes), (thickness, zero) = np.exp(self.theta[:2]), self.theta[2:]
        volume = np.pi / 4 * (self.diameter * MM) ** 2 * CHANNEL + tubes
        deep = (depth_m + zero) / CLOSED_M[self.diameter]

        def answer(pressure: float) -> np.ndarray:
            return self.interpolated((thickness, abs(at_m), deep, pressure / young))

        def unmet(pressure: float) -> float:
            return (ATMOSPHERE_PA + pressure) * (volume + answer(pressure)[1]) - ATMOSPHERE_PA * volume

        found = brentq(unmet, -5 * KPA, 20 * KPA)
        return float(found), float(answer(found)[0] * young / YOUNG_PA)

    def force(self, at_m: float, pressure_Pa: float) -> float:
        """The force [N] at a place where the channel has such a pressure, from the depth that makes it."""
        depths = np.linspace(DEPTHS[0], DEPTHS[-1], 25) * CLOSED_M[self.diameter] - self.theta[3]
        every = np.array([self.pressed(at_m, depth) for depth in depths])
        pressures = np.maximum.accumulate(every[:, 0]) + 1e-6 * np.arange(len(depths))
        return float(PchipInterpolator(pressures, every[:, 1])(pressure_Pa))


START = np.array([np.log(225e3), np.log(200e-9), 7 * MM, 0.0])
SCALES = np.array([0.1, 0.5, 0.5 * MM, 0.1 * MM])
"""Where the fit begins, and steps of ln E, ln of the tubes' volume, thickness and zero."""


class Ranges(NamedTuple):
    """The largest pressure [Pa] and force [N] of a diameter's tables."""

    pressure: float
    force: float


def fitted(presses: Sequence[Press], at: dict[float, RegularGridInterpolator], ranges: dict[float, Ranges]):
    """The parameters that are likeliest, all pressures and forces being as wrong in parts of their ranges."""

    def misfits(scaled: np.ndarray) -> np.ndarray:
        theta = START + SCALES * scaled
        pads = {diameter: Channel(diameter, theta, each) for diameter, each in at.items()}
        left = []
        for press in presses:
            pressure, force = pads[press.diameter].pressed(press.at_m, press.depth_m)
            of = ranges[press.diameter]
            left += [(pressure - press.pressure_Pa) / of.pressure, (force - press.force_N) / of.force]
        return np.array(left)

    low = np.array([-5.0, -6.0, (THICKNESSES_M[0] - START[2]) / SCALES[2], -3.0])
    high = np.array([5.0, 6.0, (THICKNESSES_M[-1] - START[2]) / SCALES[2], 1.5])
    return START + SCALES * least_squares(misfits, np.zeros(4), bounds=(low, high)).x


def numbers(rows: Sequence[tuple[Press, float, float, float]], ranges: dict[float, Ranges]) -> dict[str, Any]:
    """Root mean squares of presses with what was predicted: pressure, force by depth, force by pressure."""

    def rms(values: list[float]) -> float:
        return float(np.sqrt(np.mean(np.square(values))))

    return {
        "place_mm": None,
        "force_N": rms([by - press.force_N for press, _, _, by in rows]),
        "force_percent": rms([100 * (by - p.force_N) / ranges[p.diameter].force for p, _, _, by in rows]),
        "pressure_percent": rms(
            [100 * (found - p.pressure_Pa) / ranges[p.diameter].pressure for p, found, _, _ in rows]
        ),
        "force_by_depth_percent": rms(
            [100 * (deep - p.force_N) / ranges[p.diameter].force for p, _, deep, _ in rows]
        ),
        "presses": len(rows),
    }


def predicted(presses: Sequence[Press], theta: np.ndarray, at: dict[float, RegularGridInterpolator]):
    """Each press with its predicted pressure, force by depth and force by pressure."""
    pads = {diameter: Channel(diameter, theta, each) for diameter, each in at.items()}
    return [
        (p, *pads[p.diameter].pressed(p.at_m, p.depth_m), pads[p.diameter].force(p.at_m, p.pressure_Pa))
        for p in presses
    ]


def main() -> None:
    """Compute the tables, fit, predict, compare."""
    sf.prepare_jax()
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    for name in ("--fit", "--test", "--json"):
        parser.add_argument(name, type=Path, required=True)
    parser.add_argument("--tables", type=Path)
    parser.add_argument("--finer", type=int, default=1, help="times that the mesh is finer")
    given = parser.parse_args()
    fit_to, tests = read(given.fit), read(given.test)
    diameters = sorted({press.diameter for press in [*fit_to, *tests]})
    ranges = {}
    for diameter in diameters:
        own = [press for press in fit_to if press.diameter == diameter] or tests
        ranges[diameter] = Ranges(max(max(p.ends_Pa) for p in own), max(p.force_N for p in own))
    with TemporaryDirectory() as temporary:
        folder = given.tables or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        grid, pads = (THICKNESSES_M, PLACES_M, DEPTHS, STRETCHES), Pads(given.finer, folder)
        at = {
            each: RegularGridInterpolator(grid, pads.tables(each), bounds_error=False, fill_value=None)
            for each in diameters
        }
    fit_to, tests = ([press for press in each if press.open] for each in (fit_to, tests))
    if given.fit.resolve() == given.test.resolve():
        rows, every = [], []
        for place in sorted({press.at_m for press in tests}):
            theta = fitted([press for press in fit_to if press.at_m != place], at, ranges)
            every.append(theta)
            rows += predicted([press for press in tests if press.at_m == place], theta, at)
    else:
        every = [fitted(fit_to, at, ranges)]
        rows = predicted(tests, every[0], at)
    for young, tubes, thickness, zero in every:
        print(
            f"E {np.exp(young) / KPA:.1f} kPa, tubes {1e9 * np.exp(tubes):.0f} mm³, thickness "
            f"{thickness / MM:.2f} mm, zero {zero / MM:+.3f} mm"
        )
    files = sorted({press.file for press, *_ in rows})
    found = numbers(rows, ranges) | {
        "files": {name: numbers([row for row in rows if row[0].file == name], ranges) for name in files}
    }
    given.json.write_text(json.dumps({"open": found}, indent=2) + "\n")
    print(json.dumps({"open": found}, indent=2))


if __name__ == "__main__":
    main()
