"""Presses of known place and force, and what a device with other parameters would have read in them.

One program answers for one press, its readings and their slopes in all parameters: one equilibrium, and one
adjoint for each reading. It is compiled once and shared out over threads.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from softfuse.calibration.adjustment import Adjustments
from softfuse.equilibrium.solution import RESULTS
from softfuse.errors import SolveError
from softfuse.estimation.device import Device, simulate
from softfuse.estimation.side_by_side import side_by_side


@dataclass(frozen=True, eq=False)
class Presses:
    """s samples of presses with one contact.

    `place_m` (s, 3), `force_N` (s,): known; `reading` (s, k) in SI with standard deviations `sigma` (s, k) of
    the sensors' noise, inf for one that says nothing; `press` (s,): samples with the same number belong to
    one press.
    """

    place_m: Float[np.ndarray, "s 3"]
    force_N: Float[np.ndarray, " s"]
    reading: Float[np.ndarray, "s k"]
    sigma: Float[np.ndarray, "s k"]
    press: Int[np.ndarray, " s"]

    @property
    def told(self) -> Any:
        """Which readings (s, k) say something."""
        return np.isfinite(self.reading) & np.isfinite(self.sigma)


@dataclass(frozen=True, eq=False)
class Answer:
    """Readings (s, k) in SI of a device, their slopes (s, k, p) in its parameters, and those (s, k, 3) [1/m]
    in the place of the press.
    """

    reading: Float[np.ndarray, "s k"]
    slope: Float[np.ndarray, "s k p"]
    place_slope: Float[np.ndarray, "s k 3"]


class Adjustable:
    """A device whose parameters may be adjusted."""

    def __init__(self, device: Device, adjustments: Adjustments):
        """Compiles when first asked; `device` is as configured, with parameters 0."""
        self.adjustments = adjustments
        self._device = device
        self._others = np.zeros(device.loads(jnp.zeros((1, 3))).sizes.drives - 1)

    def answer(
        self,
        value: Float[np.ndarray, " p"],
        place_m: Float[np.ndarray, "s 3"],
        force_N: Float[np.ndarray, " s"],
        *,
        seen: Callable[[], None] = lambda: None,
    ) -> Answer:
        """What the device with parameters (p,) reads when pressed at places (s, 3) m with forces (s,) N;
        `seen` is called after each.

        Raises SolveError naming the press that has no equilibrium.
        """

        def one(place: np.ndarray, force: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            drive = np.concatenate([[force], self._others])
            slopes, (reading, result) = _read(self._device, self.adjustments, value, place, drive)
            if not bool(result == RESULTS.converged):
                x, y = 1e3 * place[:2]
                raise SolveError(
                    f"the press with {force:.2f} N at ({x:.1f}, {y:.1f}) mm has no equilibrium with the "
                    f"parameters that the fit tries: {RESULTS[result]}"
                )
            seen()
            slope, place_slope = slopes
            return np.asarray(reading), np.asarray(slope), np.asarray(place_slope)

        return Answer(*side_by_side(one, place_m, force_N))


@eqx.filter_jit
def _read(device: Device, adjustments: Adjustments, value: Any, place: Any, drive: Any) -> Any:
    def read(value, place):
        made = adjustments.adjusted(device, value)
        solution = simulate(made, place[None], drive)
        reading = adjustments.measured(made.reading(solution.state), value)
        return reading, (reading, solution.result)

    return jax.jacrev(read, argnums=(0, 1), has_aux=True)(jnp.asarray(value), jnp.asarray(place))
