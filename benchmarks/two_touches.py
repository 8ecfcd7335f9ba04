"""Two touches 20 mm apart with unequal forces: how far off both forces are, and whether their sigmas say so.

    .venv/bin/python benchmarks/two_touches.py CONFIG [--pairs N] [--apart MM] [--out FILE.csv]

CONFIG is a pad under a grid of mutual capacitances, calibrated, such as the fitted.toml of `softfuse
evaluate configs/pad_mutual.toml --grid 2 --out DIR`; its grid is calibrated here, by touches on and between
all cells, with and without a force (`calibration.mutual_grid`). The truth is the body of that evaluation,
which is not the estimator's model: two flat punches press on it together, up to 6 and 3 N, and lift off
again; its flow sensors and its grid are read through their electronics at 100 Hz, and the frames go through
the whole tracker. Pairs lie anywhere in the workspace, the first ones across the walls between cavities.
Printed: of each pair the estimates where the forces are held, then the errors of all forces, how many are
within 10 %, in which part of them the truth lies within the 90 % interval, and the same of those that the
tracker knows to a tenth (1.645 sigma). With --places MM the places are not the grid's but true to so many
millimetres, which tells what the mechanics make of two touches that are told apart.
"""

import argparse
import csv
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from softfuse.config.build_device import build_device
from softfuse.config.build_tracker import build_tracker
from softfuse.config.contact import DiscSettings
from softfuse.experiment.build_evaluation import build_bed
from softfuse.experiment.build_virtual_pad import PadPlan
from softfuse.experiment.channel_electronics import Readout
from softfuse.experiment.pad_electrodes import GridElectrodes
from softfuse.experiment.pad_programme import PadTiming, pad_programme
from softfuse.experiment.pad_touches import PadTouches
from softfuse.experiment.virtual_pad import virtual_pad
from softfuse.sensors.senses import Sensed

from softfuse.calibration.mutual_grid import KnownTouches, fit_mutual_model
from softfuse.computing import prepare_jax
from softfuse.estimation.tracked import Frame, Tracked
from softfuse.experiment.accuracy import NINETY
from softfuse.experiment.programme import Programme
from softfuse.functional.chart import facing
from softfuse.mechanics.load import Loads
from softfuse.mechanics.multifrontal import Multifrontal
from softfuse.mechanics.newton import Newton, solve
from softfuse.mechanics.solution import RESULTS, State
from softfuse.robot.file import Edits, load
from softfuse.robot.settings import RobotSettings, save_edited
from softfuse.sensors.mutual.field import Thing

FORCES_N = np.array([6.0, 3.0])
SHARES = np.array([0.0, 1 / 3, 2 / 3, 1.0])
FIRST = (((-10.0, 15.0), (10.0, 15.0)), ((15.0, 10.0), (15.0, -10.0)), ((-10.0, 0.0), (10.0, 0.0)))
"""Pairs [mm] across the walls between cavities."""
EVERY = 10


class Bed:
    """The pad of an evaluation under two punches; one program is compiled for all pairs."""

    def __init__(self, plan: PadPlan) -> None:
        self._plan, self._pad = plan, virtual_pad(plan.settings)
        self._newton, self._solve = Newton(Multifrontal.plan(self._pad.body)), eqx.filter_jit(solve)

    def touched(self, at: np.ndarray) -> PadTouches:
        """Two punches at (2, 2) m that come down, press and lift together; `force` is that of both."""
        pad, grid = self._pad, self._plan.array
        assert isinstance(grid, GridElectrodes)
        places = jnp.asarray(facing(np.column_stack([at, np.zeros(2)]), (0, 0, -1)))
        loads = Loads(tuple(pad.contact.load(pad.body, place) for place in places))
        state, volume = State.rest(pad.body, loads), [np.zeros(len(pad.cavities))]
        for share in SHARES[1:]:
            found = self._solve(self._newton, pad.body, loads, jnp.asarray(share * FORCES_N), state)
            assert found.result == RESULTS.converged, RESULTS[found.result]
            state = found.state
            moved = pad.body.rest + pad.body.displacement(state.z)
            volume.append(np.asarray(pad.volumes(moved) - pad.volumes(pad.body.rest)))

        def cells(*things: Thing) -> np.ndarray:
            return grid.field.with_crosstalk(grid.field.change(things)).T.ravel()

        one, other = (tuple(each) for each in at)
        near = [
            cells(*(Thing(each, distance=gap, radius=grid.radius) for each in (one, other)))
            for gap in self._plan.gaps
        ]
        pressed = [
            cells(
                *(
                    Thing(each, force=f, radius=grid.radius)
                    for each, f in zip((one, other), force, strict=True)
                )
            )
            for force in SHARES[:, None] * FORCES_N
        ]
        return PadTouches(
            at=at.mean(axis=0, keepdims=True),
            gap=np.array(self._plan.gaps),
            near=np.array([near]),
            force=np.array([SHARES * FORCES_N.sum()]),
            depth=np.array([SHARES]),  # not looked at
            volume=np.array([volume]),
            pressed=np.array([pressed]),
        )


def pairs_of(contact: DiscSettings, count: int, apart: float, rng: np.random.Generator) -> np.ndarray:
    """So many pairs of places (n, 2, 2) [m] that far apart, all within the workspace."""
    low, high = np.array([contact.workspace.x, contact.workspace.y]).T
    found = list(1e-3 * np.array(FIRST))[:count]
    while len(found) < count:
        turn = rng.uniform(0, 2 * np.pi)
        ends = rng.uniform(low, high) + 0.5 * apart * np.outer([-1, 1], [np.cos(turn), np.sin(turn)])
        if np.all((ends > low) & (ends < high)):
            found.append(ends)
    return np.array(found)


def main() -> None:
    """Press, estimate, compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
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
    plan = build_bed(drawn, grid=2, seed=given.seed).plan
    assert (
        isinstance(plan, PadPlan) and isinstance(config.contact, DiscSettings) and config.sensors is not None
    )
    bed = Bed(plan)
    with TemporaryDirectory() as folder:
        fitted = save_edited(given.config, Path(folder) / "fitted.toml", grid_edits(config, plan, given.seed))
        tracker = build_tracker(fitted, build_device(fitted))
    cavities = len(plan.flows)
    rows = []
    for k, at in enumerate(
        pairs_of(config.contact, given.pairs, 1e-3 * given.apart, np.random.default_rng(1))
    ):
        programme = pad_programme(bed.touched(at), PadTiming(), plan.parts, plan.flows, plan.electrodes)
        time_s = programme.step_s * np.arange(len(programme.readings))
        values = Readout(programme, plan.electronics(given.seed), (given.seed, 1000 + k)).read(time_s)
        sample = programme.truth["sample"] == len(SHARES) - 1
        given_at = None
        if given.places is not None:
            given_at = at + 1e-3 * given.places * np.random.default_rng((given.seed, k)).normal(size=(2, 2))
        tracker.reset()
        now: Tracked | None = None
        for i, t in enumerate(time_s.tolist()):
            finding = tracker.sense(Frame(t, (values[i, :cavities], values[i, cavities:])))
            if i % EVERY == 0 or sample[i]:
                if given_at is not None and programme.truth["true_force_N"][i] > 0:
                    finding = Placed(placed(finding.sensed, given_at, 1e-3 * given.places))
                now = tracker.estimate(t, finding)
            if sample[i]:
                break
        assert now is not None
        rows += told(k, at, now)
    show(np.array([row[1:] for row in rows]))
    if given.out is not None:
        with given.out.open("w", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow(["pair", "true_N", "force_N", "sigma_N", "off_x_mm", "off_y_mm", "x_mm", "y_mm"])
            writer.writerows(rows)


def grid_edits(config: RobotSettings, plan: PadPlan, seed: int) -> Edits:
    """The grid's constants as touches at known places tell them: a punch on the middles of all cells and
    between them, with 0 N and with 5 N.
    """
    array, model = plan.array, config.sensors.mutual.grid().model
    assert isinstance(array, GridElectrodes)
    x, y = array.field.column_x, array.field.row_y
    half = 0.5 * (x[1] - x[0])
    between = [(a + half, b) for a in x[:-1] for b in y[::2]] + [
        (a, b + half) for a in x[::2] for b in y[:-1]
    ]
    on = [(a, b) for a in x for b in y]
    lying, pressed = (
        KnownTouches(images_under(plan, places, force, seed), np.array(places))
        for places, force in ((on + between, 0.0), (between, 5.0))
    )
    found = fit_mutual_model(model, lying, pressed)
    key = ("sensors", "mutual", "shape")
    return {
        (*key, "contact_counts"): float(found.contact_counts),
        (*key, "depth"): f"{1e3 * float(found.depth_m):.6g} mm",
        (*key, "finger_radius"): f"{1e3 * float(found.finger_radius_m):.6g} mm",
        (*key, "gain"): [float(gain) for gain in np.asarray(found.gain).T.ravel()],
        (*key, "crosstalk"): float(found.crosstalk),
        (*key, "model_error"): float(found.model_error),
    }


def images_under(plan: PadPlan, places: list[tuple[float, float]], force: float, seed: int) -> np.ndarray:
    """Images (n, c, r) in counts above rest of one punch at each of n places, as the electronics say them."""
    array = plan.array
    assert isinstance(array, GridElectrodes)
    field, rows = array.field, 50
    changes = np.array(
        [
            field.with_crosstalk(field.change([Thing(at, force=force, radius=array.radius)])).T.ravel()
            for at in places
        ]
    )
    signal = np.concatenate([np.zeros((rows, changes.shape[1])), np.repeat(changes, rows, axis=0)])
    volts = plan.parts.readings(np.zeros((len(signal), len(plan.flows))), signal)
    programme = Programme(0.01, (*plan.flows, *plan.electrodes), volts, {})
    time_s = 0.01 * np.arange(len(signal))
    counts = Readout(programme, plan.electronics(seed), (seed, 2000 + int(force))).read(time_s)
    mean = counts[:, len(plan.flows) :].reshape(len(places) + 1, rows, -1).mean(axis=1)
    image = (mean[1:] - mean[0]).reshape(len(places), len(field.row_y), len(field.column_x))
    return image.transpose(0, 2, 1)


@dataclass(frozen=True, eq=False)
class Placed:
    """What the tracker reads of a frame."""

    sensed: Sensed


def placed(sensed: Sensed, at: np.ndarray, sigma: float) -> Sensed:
    """What the sensors say, with both contacts at (2, 2) m, known to sigma [m]."""
    middles, both = np.column_stack([at, np.zeros(2)]), np.ones(2, bool)
    return sensed._replace(
        touching=both,
        pressing=both,
        clear=np.array(False),
        places=facing(middles, (0, 0, -1)),
        location_m=middles,
        location_sigma_m=np.full((2, 2), sigma),
    )


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
