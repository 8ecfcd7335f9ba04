"""Two touches 20 mm apart with unequal forces: how far off both forces are, and whether their sigmas say so.

    .venv/bin/python benchmarks/two_touches.py CONFIG [--pairs N] [--apart MM] [--out FILE.csv]

CONFIG is a pad under a grid of mutual capacitances, calibrated, such as the fitted.toml of `softfuse
evaluate configs/pad_mutual.toml --grid 2 --out DIR`; its grid is calibrated here, by touches on and between
all cells, with and without a force (`calibration.mutual_grid`). The truth is the robot of that evaluation,
which is not the estimator's model: two flat punches press on it together, up to 6 and 3 N, and lift off
again; its flow sensors and its grid are read through their electronics at 100 Hz, and the frames go through
the whole tracker. Pairs lie anywhere in the workspace, the first ones across the walls between chambers.
Printed: of each pair the estimates where the forces are held, then the errors of all forces, how many are
within 10 %, in which part of them the truth lies within the 90 % interval, and the same of those that the
tracker knows to a tenth (1.645 sigma). With --places MM the places are not the grid's but true to so many
millimetres, which tells what the mechanics make of two touches that are told apart.
"""

import argparse
import csv
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from softfuse.calibration.mutual_grid import KnownTouches, fit_mutual_model
from softfuse.computing import prepare_jax
from softfuse.estimation.compiled_suite import Finding
from softfuse.estimation.packing import Packing
from softfuse.estimation.tracked import Frame, Tracked
from softfuse.estimation.tracker import Tracker
from softfuse.experiment.accuracy import NINETY
from softfuse.experiment.episodes import Episode, Touch, place_of
from softfuse.experiment.equilibria import kept_poses
from softfuse.experiment.paper.bed import build_bed
from softfuse.experiment.performance import Performance, places_of
from softfuse.experiment.timeline import frames
from softfuse.functional.chart import facing
from softfuse.functional.workspace import FlatWorkspace
from softfuse.robot.file import Edits, load, save_edited
from softfuse.robot.robot import Robot, build_robot
from softfuse.robot.settings import RobotSettings
from softfuse.sensors.mutual.settings import MutualSettings
from softfuse.sensors.parts import TrueContact

FORCES_N = np.array([6.0, 3.0])
LEVELS = np.array([1 / 3, 2 / 3, 1.0])
FIRST = (((-10.0, 15.0), (10.0, 15.0)), ((15.0, 10.0), (15.0, -10.0)), ((-10.0, 0.0), (10.0, 0.0)))
"""Pairs [mm] across the walls between chambers."""
EVERY = 10
ROWS = 50
"""Frames over which an image is averaged for the calibration of the grid."""


def places_at(at: np.ndarray) -> np.ndarray:
    """Places (n, 3, 3) at points (n, 2) m of the top."""
    return facing(np.column_stack([at, np.zeros(len(at))]), (0, 0, -1))


def pairs_of(robot: Robot, count: int, apart: float, rng: np.random.Generator) -> np.ndarray:
    """So many pairs of places (n, 2, 2) [m] that far apart, all within the workspace."""
    (workspace, *_) = robot.workspaces
    assert isinstance(workspace, FlatWorkspace)
    low, high = np.asarray(workspace.low), np.asarray(workspace.high)
    found = list(1e-3 * np.array(FIRST))[:count]
    while len(found) < count:
        turn = rng.uniform(0, 2 * np.pi)
        ends = rng.uniform(low, high) + 0.5 * apart * np.outer([-1, 1], [np.cos(turn), np.sin(turn)])
        if np.all((ends > low) & (ends < high)):
            found.append(ends)
    return np.array(found)


def main() -> None:
    """Press, estimate, compare."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("config", type=Path)
    parser.add_argument("--pairs", type=int, default=16)
    parser.add_argument("--apart", type=float, default=20.0, help="in mm")
    parser.add_argument("--places", type=float, help="standard deviation of places that are given, in mm")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--drawing", type=Path, help="config as drawn, of which the body is made")
    parser.add_argument("--out", type=Path, help="table of all estimates")
    given = parser.parse_args()
    prepare_jax()
    config, drawn = load(given.config), load(given.drawing or given.config)
    robot = build_bed(drawn, grid=2, seed=given.seed).robot
    with TemporaryDirectory() as folder:
        path = Path(folder) / "fitted.toml"
        edits = grid_edits(config, robot.made, given.seed)
        tracker = Tracker(build_robot(save_edited(given.config, path, edits)))
    pairs = pairs_of(robot.made, given.pairs, 1e-3 * given.apart, np.random.default_rng(1))
    name = drawn.contact().name
    episodes = [
        Episode(
            tuple(
                Touch(name, place_of(place), tuple((force * LEVELS).tolist()))
                for place, force in zip(places_at(at), FORCES_N, strict=True)
            )
        )
        for at in pairs
    ]
    rows = []
    for k, (at, episode, poses) in enumerate(
        zip(pairs, episodes, kept_poses(None, robot, episodes), strict=True)
    ):
        performed = Performance(robot, places_of(robot, [episode]), frames([poses]))
        said, force = performed.recording(given.seed, 1000 + k), performed.frames.values["force"].sum(axis=1)
        raw = np.stack([said[channel][1] for channel in config.channels], axis=1)
        (last,) = np.flatnonzero(performed.frames.sample == len(LEVELS))
        off = np.random.default_rng((given.seed, k)).normal(size=(2, 2))
        tracker.reset()
        now: Tracked | None = None
        for i, t in enumerate(performed.frames.time_s[: last + 1].tolist()):
            finding = tracker.sense(Frame(t, raw[i]))
            if i % EVERY == 0 or i == last:
                if given.places is not None and force[i] > 0:
                    finding = placed(finding, at + 1e-3 * given.places * off, 1e-3 * given.places)
                now = tracker.estimate(t, finding)
        assert now is not None
        rows += told(k, at, now)
    show(np.array([row[1:] for row in rows]))
    if given.out is not None:
        with given.out.open("w", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow(["pair", "true_N", "force_N", "sigma_N", "off_x_mm", "off_y_mm", "x_mm", "y_mm"])
            writer.writerows(rows)


def grid_edits(config: RobotSettings, made: Robot, seed: int) -> Edits:
    """The grid's constants as touches at known places tell them: a punch on the middles of all cells and
    between them, with 0 N and with 5 N.
    """
    (grid,) = config.sensors_of(MutualSettings)
    x, y = grid.column_x, grid.row_y
    half = 0.5 * (x[1] - x[0])
    between = [(a + half, b) for a in x[:-1] for b in y[::2]] + [
        (a, b + half) for a in x[::2] for b in y[:-1]
    ]
    on = [(a, b) for a in x for b in y]
    lying, pressed = (
        KnownTouches(images_under(made, np.array(places), force, seed), np.array(places))
        for places, force in ((on + between, 0.0), (between, 5.0))
    )
    found = fit_mutual_model(grid.model(), lying, pressed)
    key = ("sensor", config.sensors.index(grid), "shape")
    return {
        (*key, "contact_counts"): float(found.contact_counts),
        (*key, "depth"): f"{1e3 * float(found.depth_m):.6g} mm",
        (*key, "finger_radius"): f"{1e3 * float(found.finger_radius_m):.6g} mm",
        (*key, "gain"): [float(gain) for gain in np.asarray(found.gain).T.ravel()],
        (*key, "crosstalk"): float(found.crosstalk),
        (*key, "model_error"): float(found.model_error),
    }


def images_under(made: Robot, at: np.ndarray, force: float, seed: int) -> np.ndarray:
    """Images (n, c, r) in counts above rest of one punch at each of n places, as the electronics say them."""
    (grid,) = made.settings.sensors_of(MutualSettings)
    number, radius = made.settings.sensors.index(grid), made.settings.contact(grid.contact).radius
    nothing = np.zeros((0, 3))
    changes = np.stack(
        [grid.signal(made.parts, [], nothing)]
        + [
            grid.signal(made.parts, [TrueContact(place, force=force, radius=radius)], nothing)
            for place in places_at(at)
        ]
    )
    signal = np.repeat(changes, ROWS, axis=0)
    time_s = 0.01 * np.arange(len(signal))
    drawn, noise = (seed, number), (seed, 2000 + int(force), number)
    counts = grid.simulate(made.parts, time_s, signal, drawn, noise)
    mean = counts.reshape(len(changes), ROWS, -1).mean(axis=1)
    image = (mean[1:] - mean[0]).reshape(len(at), len(grid.row_y), len(grid.column_x))
    return image.transpose(0, 2, 1)


def placed(finding: Finding, at: np.ndarray, sigma: float) -> Finding:
    """What the sensors say, with both contacts at (2, 2) m, known to sigma [m]."""
    both = np.ones(2, bool)
    observation = finding.observation._replace(
        touching=both,
        pressing=both,
        clear=np.array(False),
        places=places_at(at),
        location_m=places_at(at)[:, 0],
        location_sigma_m=np.full((2, 2), sigma),
    )
    return Finding(Packing.of(observation).pack(observation), Packing.of(observation))


def told(pair: int, at: np.ndarray, now: Tracked) -> list[tuple]:
    """Rows of both touches, each with the nearest contact that was found, NaN where there is none."""
    rows = []
    place = now.location_m[:, :2]
    for true, force in zip(at, FORCES_N, strict=True):
        apart = np.where(np.isfinite(place[:, 0]), np.linalg.norm(place - true, axis=1), np.inf)
        c = int(np.argmin(apart))
        found = apart[c] < 8e-3
        values = (now.contact_force_N[c], now.contact_sigma_N[c], *(1e3 * (place[c] - true)))
        rows.append((pair, force, *(values if found else [np.nan] * 4), *(1e3 * true)))
    line = "; ".join(
        f"({r[6]:.0f}, {r[7]:.0f}) {r[1]:g} N: {r[2]:.2f} ± {r[3]:.2f}, place ({r[4]:+.2f}, {r[5]:+.2f})"
        for r in rows
    )
    print(f"{pair}: {line}; {', '.join(now.statuses)}", flush=True)
    return rows


def show(table: np.ndarray) -> None:
    """Print the numbers of all forces, then of those that are known to a tenth."""
    true, force, sigma = table[:, :3].T
    error = np.abs(force / true - 1)
    for name, which in (("all", np.ones(len(true), bool)), ("known to a tenth", NINETY * sigma < 0.1 * true)):
        if not which.any():
            print(f"{name}: none")
            continue
        part, inside = 100 * error[which], np.abs(force - true)[which] < NINETY * sigma[which]
        print(
            f"{name}: {which.sum()} of {len(which)} forces, {np.nanmean(part):.1f} % off on average, "
            f"{np.nanmax(part):.1f} % at most, {np.sum(part < 10)} within 10 %, "
            f"{100 * np.mean(inside):.0f} % within 1.645 sigma"
        )


if __name__ == "__main__":
    main()
