"""A virtual grid of mutual capacitances, read frame by frame, for the test beds of what finds touches.

The field of `sensors.mutual.field`; then parts that differ, white noise, a drift common to all and one of
each cell's own (random walks), and the converter's steps.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from softfuse.sensors.mutual.field import MutualField, Thing


@dataclass(frozen=True)
class CellParts:
    """Of the cells: counts at rest and by how much they differ, spread of the gains, noise, drift of all and
    of each after one second.
    """

    rest_counts: float = 16000.0
    rest_bound_counts: float = 1500.0
    gain_sigma: float = 0.03
    noise_counts: float = 8.0
    drift_counts: float = 5.0
    own_drift_counts: float = 2.0
    highest_counts: int = 65535

    def rest_and_gain(
        self, shape: tuple[int, ...], rng: np.random.Generator
    ) -> tuple[Float[np.ndarray, "*e"], Float[np.ndarray, "*e"]]:
        """Counts at rest and gains of cells in a given shape, drawn from a generator."""
        rest = self.rest_counts + rng.uniform(-self.rest_bound_counts, self.rest_bound_counts, shape)
        return rest, 1.0 + rng.normal(0.0, self.gain_sigma, shape)


@dataclass(frozen=True)
class MutualBed:
    """The grid, its electronics, and the seed of their parts, noise and drift."""

    field: MutualField = MutualField()
    parts: CellParts = CellParts()
    seed: int = 5

    def counts(
        self, time: Float[np.ndarray, " n"], things: Sequence[Sequence[Thing]]
    ) -> Int[np.ndarray, "n e"]:
        """Readings (n, e) at times (n,) s under the things of each frame; cells row by row."""
        relative = np.array([self.field.change(each) for each in things])
        return self.counts_of(time, relative)

    def counts_of(
        self, time: Float[np.ndarray, " n"], change: Float[np.ndarray, "n c r"]
    ) -> Int[np.ndarray, "n e"]:
        """Readings (n, e) at times (n,) s for relative changes (n, c, r) before crosstalk; cells row by
        row.
        """
        parts, noise, drift = map(np.random.default_rng, np.random.SeedSequence(self.seed).spawn(3))
        shape, made = change.shape[1:], self.parts
        rest, gain = made.rest_and_gain(shape, parts)
        root = np.sqrt(np.diff(time, prepend=time[0]))[:, None, None]
        walk = np.cumsum(root * drift.normal(0.0, made.drift_counts, (len(time), 1, 1)), axis=0)
        own = np.cumsum(root * drift.normal(0.0, made.own_drift_counts, (len(time), *shape)), axis=0)
        counts = rest * (1.0 + gain * self.field.with_crosstalk(change))
        counts = counts + walk + own + noise.normal(0.0, made.noise_counts, change.shape)
        whole = np.clip(np.rint(counts), 0, made.highest_counts).astype(int)
        return whole.transpose(0, 2, 1).reshape(len(time), -1)
