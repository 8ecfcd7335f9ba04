"""Where on its electrode each contact of a press acts, which nobody has measured but its forces depend on."""

from collections.abc import Mapping
from typing import ClassVar, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.calibration.adjustment import AbstractAdjustment, Measure
from softfuse.calibration.presses import Applied
from softfuse.functional.chart import nearest


class ContactPlaces(AbstractAdjustment):
    """θ (p,) [m]: how far along its electrode each contact of each press acts from the middle.

    `number` (n + 1, c): which θ belongs to contact c of press n, p for none; none does in the last row.
    """

    measure: ClassVar[Measure] = Measure.length
    sigma: Float[Array, " p"]
    number: Int[Array, "n1 c"]
    names: tuple[str, ...] = eqx.field(static=True)

    @classmethod
    def of(
        cls,
        applied: Applied,
        called: dict[int, str],
        electrodes: Mapping[str, Float[np.ndarray, "3 3"]],
        sigma: float,
    ) -> Self:
        """Of presses 0, 1 ... that people call something, on electrodes with names and places, with a prior
        standard deviation [m].
        """
        presses, contacts = int(applied.press.max(initial=-1)) + 1, applied.force_N.shape[1]
        number, names = np.full((presses + 1, contacts), -1), list[str]()
        known, at = list(electrodes), np.array(list(electrodes.values()))
        for press in range(presses):
            on = applied.press == press
            for contact in np.flatnonzero(np.any(applied.force_N[on] > 0, axis=0)):
                number[press, contact] = len(names)
                pushed = on & (applied.force_N[:, contact] > 0)
                where = known[int(nearest(at, applied.place[pushed][0, contact]))]
                names.append(f"place on {where} in press {called[press]}")
        number = np.where(number < 0, len(names), number)
        return cls(sigma=jnp.full(len(names), sigma), number=jnp.asarray(number), names=tuple(names))

    def arms(self, arm, press, value):
        """Where contacts act; in the middle in a press that is none of those."""
        padded = jnp.append(value, 0.0)
        return arm + padded[self.number[jnp.where(press < 0, len(self.number) - 1, press)]]
