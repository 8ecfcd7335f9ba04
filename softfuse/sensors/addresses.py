"""Where channels, readings and contacts of a robot's sensors are among all of them."""

from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.functional.chart import FlatChart
from softfuse.sensors.contact_places import chart_places


@dataclass(frozen=True)
class Addresses:
    """Which of a row of numbers belong to whom: names, and where each one's begin, and the end of all."""

    names: tuple[str, ...]
    starts: tuple[int, ...]

    @classmethod
    def of(cls, counts: Sequence[tuple[str, int]]) -> "Addresses":
        """Of names with so many numbers each."""
        starts = np.cumsum([0, *(count for _, count in counts)]).tolist()
        return cls(tuple(name for name, _ in counts), tuple(starts))

    def __getitem__(self, name: str) -> slice:
        """The numbers that belong to a name."""
        k = self.names.index(name)
        return slice(self.starts[k], self.starts[k + 1])


class ContactSlots(eqx.Module):
    """The slots of one [[contact]]: numbers of those that see it among the contact sensors; its coordinates,
    None where sensors name the places; and the lowest and highest coordinates (2,) [m].
    """

    name: str = eqx.field(static=True)
    slots: int = eqx.field(static=True)
    seen_by: tuple[int, ...] = eqx.field(static=True)
    chart: FlatChart | None
    low_m: Float[Array, "2"]
    high_m: Float[Array, "2"]

    def waiting(self) -> Float[Array, "c 3 3"]:
        """Places of contacts that nobody sees: in the middle, apart from each other; anywhere without
        coordinates.
        """
        share = (jnp.arange(self.slots) + 0.5)[:, None] / self.slots
        low, high = (jnp.where(jnp.isfinite(end), end, 0.0) for end in (self.low_m, self.high_m))
        return self.at(low + share * (high - low))

    def at(self, coordinates: Float[Array, "c 2"]) -> Float[Array, "c 3 3"]:
        """Places at coordinates (c, 2) [m]."""
        if self.chart is None:
            return jnp.broadcast_to(jnp.eye(3).at[0].set(0.0), (len(coordinates), 3, 3))
        return chart_places(self.chart, coordinates, jnp.zeros_like(coordinates))[0]
