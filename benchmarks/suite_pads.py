"""Pads of several sizes, presses on them, and how their frames are timed, for the suite of benchmarks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from live_frames import compilations
from pad_meshes import pad_on
from pytest_benchmark.fixture import BenchmarkFixture

from softfuse.estimation.bounds import limits_of
from softfuse.estimation.limits import Limits
from softfuse.estimation.step import Observation
from softfuse.functional.chart import facing, moved
from softfuse.mechanics.model import Model, simulate
from softfuse.robot.robot import Robot, build_robot

CONFIGS = Path(__file__).parents[1] / "configs"
MESHES = {
    1387: ("30 mm", "40 mm", "0 mm"),
    2115: ("20 mm", "20 mm", "0 mm"),
    4391: ("12 mm", "12 mm", "3 mm"),
    10467: ("8 mm", "10 mm", "3 mm"),
}
"""surface_size, base_size and fine_depth of the meshes, by how many nodes they have."""
PRESSED_AT = [[10e-3, -6e-3, 0.0], [-17e-3, 17e-3, 0.0], [17e-3, 17e-3, 0.0], [-14e-3, -14e-3, 0.0]]
PLACES = facing(np.array(PRESSED_AT), (0, 0, -1))
PEAK_N = 10.0


@dataclass(frozen=True, eq=False)
class Pad:
    """The pad of configs/pad.toml on one of the meshes."""

    robot: Robot

    @property
    def model(self) -> Model:
        """Its model."""
        return self.robot.model

    def limits(self, contacts: int = 1) -> Limits:
        """Those of so many contacts."""
        settings = self.robot.settings
        several = (settings.contact().model_copy(update={"at_once": contacts}),)
        return limits_of(replace(self.robot, settings=settings.model_copy(update={"contacts": several})))


@cache
def pad(nodes: int) -> Pad:
    """The pad with so many nodes, made once."""
    made = Pad(build_robot(pad_on(*MESHES[nodes])))
    assert made.model.body.n_nodes == nodes
    return made


@eqx.filter_jit
def _read(model: Model, places: jax.Array, forces: jax.Array) -> jax.Array:
    return model.reading(simulate(model, places, forces).state)


def press(
    model: Model, contacts: int, frames: int, seed: int = 0, place: np.ndarray | None = None
) -> list[Observation]:
    """Frames of contacts that press up to the peak and stay, jittering by 0.05 mm as located ones do.

    The peak is shared by the contacts, at the first of the places, or at one `place` (3, 3).
    """
    places = PLACES[:contacts] if place is None else place[None]
    levels = np.linspace(0.0, PEAK_N / contacts, 6)
    at = jnp.asarray(places)
    read = np.array([np.asarray(_read(model, at, jnp.full(contacts, level))) for level in levels])
    force = np.minimum(np.linspace(0.0, 1.25, frames), 1.0) * levels[-1]
    readings = np.stack([np.interp(force, levels, column) for column in read.T], axis=1)
    jitter = np.random.default_rng(seed).normal(0.0, 0.05e-3, (frames, contacts, 3))[..., :2]
    whitening = 1e9 * np.eye(readings.shape[1])
    return [
        Observation.on_host(r, whitening, moved(places, j)) for r, j in zip(readings, jitter, strict=True)
    ]


def time_frames(benchmark: BenchmarkFixture, update: Callable, frames: Sequence, **said: object) -> None:
    """Time an update of each frame; the slowest of a hundred, and programs traced or compiled meanwhile, are
    told beside what else is `said`.
    """
    coming = iter(frames)
    with compilations() as compiled:
        benchmark.pedantic(update, setup=lambda: ((next(coming),), {}), rounds=len(frames))
    p99 = 1e3 * float(np.quantile(benchmark.stats.stats.data, 0.99))
    benchmark.extra_info.update(p99_ms=p99, retraced=len(compiled), **said)


def megabytes(*trees: object) -> float:
    """What the arrays of some trees take in memory [MB]."""
    arrays = [leaf for leaf in jax.tree.leaves(trees) if isinstance(leaf, jax.Array | np.ndarray)]
    return sum(leaf.nbytes for leaf in {id(leaf): leaf for leaf in arrays}.values()) / 1e6
