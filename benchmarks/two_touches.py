"""Two touches 20 mm apart with unequal forces: how far off both forces are, and whether their sigmas say so.

    .venv/bin/python benchmarks/two_touches.py [CONFIG] [--pairs N] [--apart MM] [--model-error PART]

The truth is a pad on a finer mesh, whose volumes differ from the estimator's by some per cent: with no noise
but that of the flow sensors, half a cubic millimetre, and places that the electrodes know to 0.2 mm. Pairs of
touches of 6 and 3 N lie anywhere in the workspace. Four volumes tell two forces well where the touches are
over different cavities, and hardly where one cavity is under both; a force is believed where its sigma is
below a tenth of it. Printed: of the believed pairs the force errors, how many are within 10 %, and in which
part of all pairs the truth lies within 1.645 sigma.
"""

import argparse
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from softfuse.calibration.adjustment import Adjustments, Stiffness
from softfuse.calibration.grid import Grid
from softfuse.calibration.presses import Adjustable
from softfuse.cli.computing import prepare_jax
from softfuse.config import load
from softfuse.config.body import PadSource
from softfuse.config.build_device import build_device, build_limits
from softfuse.config.contact import DiscSettings
from softfuse.config.device import DeviceConfig
from softfuse.equilibrium.solution import RESULTS
from softfuse.estimation.device import Device, compliance, simulate
from softfuse.estimation.model_error import ModelError, whitening
from softfuse.estimation.nonlinear import nonlinear_estimate
from softfuse.estimation.reading_spread import ReadingSpread
from softfuse.estimation.step import Observation

ROOT = Path(__file__).parents[1]
FORCES_N = np.array([6.0, 3.0])
NOISE_M3, PLACE_SIGMA_M = 0.5e-9, 0.2e-3
FINER = 2 / 3
NINETY, BELIEVED = 1.645, 0.1


def finer(config: DeviceConfig) -> DeviceConfig:
    """The config on a finer mesh."""
    source = config.body.source
    assert isinstance(source, PadSource)
    body = config.body.model_copy(
        update={"source": source.model_copy(update={"surface_size": FINER * source.surface_size})}
    )
    return config.model_copy(update={"body": body})


def spread_of_places(device: Device, contact: DiscSettings) -> ReadingSpread:
    """How volumes depend on places, by the device itself; its parameters are taken to be known."""
    grid = Grid.over(contact.workspace.x, contact.workspace.y, float(FORCES_N.mean()))
    known = Adjustable(device, Adjustments((Stiffness.within(1e-6),)))
    answer = known.answer(np.zeros(1), grid.place_m, grid.force_N)
    return grid.spread(answer, np.array([[1e-12]]))


def pairs_of(contact: DiscSettings, count: int, apart: float, rng: np.random.Generator) -> np.ndarray:
    """So many pairs of places (n, 2, 3) [m] that far apart, all within the workspace."""
    low, high = np.array([contact.workspace.x, contact.workspace.y]).T
    found: list[np.ndarray] = []
    while len(found) < count:
        turn = rng.uniform(0, 2 * np.pi)
        ends = rng.uniform(low, high) + 0.5 * apart * np.outer([-1, 1], [np.cos(turn), np.sin(turn)])
        if np.all((ends > low) & (ends < high)):
            found.append(np.column_stack([ends, np.zeros(2)]))
    return np.array(found)


def main() -> None:
    """Press, estimate, compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("config", type=Path, nargs="?", default=ROOT / "configs" / "pad_mutual.toml")
    parser.add_argument("--pairs", type=int, default=20)
    parser.add_argument("--apart", type=float, default=20.0, help="in mm")
    parser.add_argument("--model-error", type=float, default=0.03)
    given = parser.parse_args()
    prepare_jax()
    config = load(given.config)
    contact = config.contact
    assert isinstance(contact, DiscSettings)
    device, truth, limits = build_device(config), build_device(finer(config)), build_limits(config, 2)
    error = ModelError(given.model_error, spread_of_places(device, contact))
    rng = np.random.default_rng(1)
    off, sigma = [], []
    for places in pairs_of(contact, given.pairs, 1e-3 * given.apart, rng):
        true = simulate(truth, jnp.asarray(places), jnp.asarray(FORCES_N))
        assert true.result == RESULTS.converged
        reading = np.asarray(truth.reading(true.state)) + NOISE_M3 * rng.normal(size=truth.readings)
        seen_at = places + PLACE_SIGMA_M * rng.normal(size=places.shape) * [1, 1, 0]
        noise, sure = np.full(len(reading), NOISE_M3), np.full((2, 2), PLACE_SIGMA_M)
        covariance = error.covariance(reading, noise, seen_at, sure, FORCES_N)
        white = whitening(covariance, np.ones(len(reading), bool))
        seen = Observation(jnp.asarray(reading), jnp.asarray(white), jnp.asarray(seen_at))
        found = nonlinear_estimate(device, limits, device.rest_state(seen.places), seen)
        w = white @ np.asarray(compliance(device, seen.places, found.drive))
        off.append(np.asarray(found.drive) - FORCES_N)
        sigma.append(np.sqrt(np.diag(np.linalg.inv(w.T @ w))))
    off, sigma = np.array(off), np.array(sigma)
    part = np.abs(off) / FORCES_N
    believed = np.all(sigma < BELIEVED * FORCES_N, axis=1)
    print(
        f"{len(off)} pairs {given.apart:g} mm apart, {FORCES_N} N; both forces believed in {believed.sum()}"
    )
    worst, within = 100 * part[believed].max(), np.all(part[believed] < 0.1, axis=1).sum()
    print(f"  of those: errors {100 * part[believed].mean():.1f} % on average, {worst:.1f} % at most")
    print(f"  both within 10 % in {within}")
    print(f"  all: errors {100 * part.mean():.1f} % on average, {100 * part.max():.1f} % at most")
    print(f"  truth within 1.645 sigma: {100 * np.mean(np.abs(off) < NINETY * sigma):.0f} % of all forces")


if __name__ == "__main__":
    main()
