"""A normal distribution that goes on in time, is updated by readings, and is smoothed afterwards.

Kalman filter and Rauch-Tung-Striebel smoother (Rauch, Tung, Striebel, AIAA Journal 3, 1445, 1965); states are
scaled by who makes them, so that their numbers are of similar size.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

_SINGULAR = 1e-12
"""Of the largest variance: below, a state is certain."""


class Normal(NamedTuple):
    """Mean (n,) and covariance (n, n) of a state."""

    mean: Float[np.ndarray, " n"]
    covariance: Float[np.ndarray, "n n"]

    def gone_on(self, change: "Change") -> "Normal":
        """Some time later."""
        covariance = change.transition @ self.covariance @ change.transition.T + change.noise
        return Normal(change.transition @ self.mean, covariance)

    def updated(self, reading: "Reading", considered: slice = slice(0)) -> "Normal":
        """With a reading of it; of numbers that are only `considered` it says nothing, although they matter
        for it (Schmidt, Advances in Control Systems 3, 293, 1966).
        """
        gain, innovation, _ = self._compared(reading)
        gain[considered] = 0.0
        left = np.eye(len(self.mean)) - gain @ reading.rows
        covariance = left @ self.covariance @ left.T + (gain * reading.sigma**2) @ gain.T
        return Normal(self.mean + gain @ innovation, 0.5 * (covariance + covariance.T))

    def surprise(self, reading: "Reading") -> float:
        """Square of the innovation in standard deviations [-]: expected is the number of readings."""
        _, innovation, inverse = self._compared(reading)
        return float(innovation @ inverse @ innovation)

    def _compared(self, reading: "Reading") -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        # In standard deviations, as readings may be of any unit.
        rows = reading.rows / reading.sigma[:, None]
        across = self.covariance @ rows.T
        inverse = np.linalg.inv(rows @ across + np.eye(len(rows)))
        gain = across @ inverse / reading.sigma
        innovation = reading.value - reading.rows @ self.mean
        return gain, innovation, inverse / np.outer(reading.sigma, reading.sigma)


class Change(NamedTuple):
    """From one frame to the next: x ← F x + w, `transition` F (n, n), `noise` (n, n) the covariance of w."""

    transition: Float[np.ndarray, "n n"]
    noise: Float[np.ndarray, "n n"]


class Reading(NamedTuple):
    """y = H x + v: `value` y (m,), `rows` H (m, n), `sigma` (m,): standard deviations of v, positive."""

    value: Float[np.ndarray, " m"]
    rows: Float[np.ndarray, "m n"]
    sigma: Float[np.ndarray, " m"]

    def only(self, which: Bool[np.ndarray, " m"]) -> "Reading":
        """Those for which it holds (m,)."""
        return Reading(self.value[which], self.rows[which], self.sigma[which])


class Step(NamedTuple):
    """A frame: how the state came to it, what was expected of it, and what is known with its readings."""

    change: Change
    expected: Normal
    known: Normal


def smoothed(steps: Sequence[Step]) -> list[Normal]:
    """What all frames together say of the state in each."""
    if not steps:
        return []
    found = [steps[-1].known]
    for now, then in zip(reversed(steps[:-1]), reversed(steps[1:]), strict=True):
        cut = _SINGULAR * max(float(np.diag(then.expected.covariance).max()), 1e-300)
        inverse = _pseudo_inverse(then.expected.covariance, cut)
        gain = now.known.covariance @ then.change.transition.T @ inverse
        mean = now.known.mean + gain @ (found[-1].mean - then.expected.mean)
        lower = found[-1].covariance - then.expected.covariance
        covariance = now.known.covariance + gain @ lower @ gain.T
        found.append(Normal(mean, 0.5 * (covariance + covariance.T)))
    return found[::-1]


def _pseudo_inverse(covariance: Float[np.ndarray, "n n"], cut: float) -> Float[np.ndarray, "n n"]:
    """The inverse of a covariance, 0 along what is certain."""
    values, vectors = np.linalg.eigh(covariance)
    inverse = np.where(values > cut, 1 / np.maximum(values, cut), 0.0)
    return (vectors * inverse) @ vectors.T
