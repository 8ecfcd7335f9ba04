"""Where the middle of a contact may be: a part of the surface, with places to look at all over it."""

from abc import abstractmethod

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from softfuse.functional.chart import FlatChart


class AbstractWorkspace(eqx.Module):
    """A part of the surface."""

    @abstractmethod
    def room(
        self, places: Float[np.ndarray, "c 3 3"]
    ) -> tuple[Float[np.ndarray, "c 2"], Float[np.ndarray, "c 2"]]:
        """How far along its tangents each place (c, 3, 3) may move, at least and at most (c, 2) [m]."""

    @abstractmethod
    def grid(self, side: int) -> tuple[Float[np.ndarray, "s 3 3"], Float[np.ndarray, "2"]]:
        """Places (s, 3, 3) all over it, some `side` along its length and as many along its width, and how far
        apart they are along their tangents (2,) [m].
        """


class FlatWorkspace(AbstractWorkspace):
    """A rectangle of a flat chart, from the coordinates `low` (2,) to `high` (2,) [m]."""

    chart: FlatChart
    low: Float[np.ndarray, "2"]
    high: Float[np.ndarray, "2"]

    def room(self, places):
        """To the edges of the rectangle."""
        at = self.chart.coordinates(places)
        # Tangents are along or against the axes. In numpy: this is asked in every frame.
        axes = np.asarray(self.chart.axes)
        along = axes @ np.stack([axes[0], np.cross(axes[0], np.asarray(self.chart.direction))]).T
        ends = np.stack([(self.low - at) @ along, (self.high - at) @ along])
        return ends.min(axis=0), ends.max(axis=0)

    def grid(self, side):
        """A grid of side x side places up to the edges."""
        x, y = np.meshgrid(*np.linspace(self.low, self.high, side).T, indexing="ij")
        pitch = (self.high - self.low) / (side - 1)
        return np.asarray(self.chart.place(jnp.stack([x.ravel(), y.ravel()], axis=1))), pitch
