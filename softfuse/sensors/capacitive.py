"""Single-ended capacitive array: counts to signals, image and the weighted-mean location.

    signal s = (counts - baseline) / gain,   image I = s_col (x) s_row,
    x = sum(x_k s_col,k) / sum(s_col,k), y alike,

as in the paper (Navarro et al., RA-L 5(4), 2020), but for the gains of the electrodes. Signals are positive
when something grounded comes near. The weighted mean pulls contacts at the border inwards; `peak_follow` does
not. The noise of a signal is that of the counts over the gain; all are taken to have that of a gain of one,
because gains are off by some per cent, and where that matters, under a contact, the model's misfit is larger
than noise.

The baseline follows the counts of the untouched array with a time constant, is frozen while something
touches, and creeps while something is near (a hovering hand must not become the baseline soon, a drifted
electrode must not block the array for ever). A signal far below zero cannot be physical: the baseline was
taken with something on the array, and is taken anew.
"""

from abc import abstractmethod
from collections.abc import Callable
from typing import Annotated, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from annotated_types import Ge
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int
from pydantic import model_validator

from softfuse.io.quantity import Integer, Number, PositiveNumber, PositiveTime, wrong_value
from softfuse.io.settings import Positions, Settings
from softfuse.sensors.base import ContactSettings
from softfuse.sensors.electronics import ChannelElectronics, Values, equal_channels
from softfuse.sensors.parameters import parameters


class CapacitiveArray(eqx.Module):
    """Parameters of the array's electronics; all fields are leaves."""

    noise_counts: Float[Array, ""]
    """Standard deviation of one reading [counts]."""
    lowest_counts: Float[Array, ""]
    """Readings at or below belong to a dead channel [counts]."""
    highest_counts: Float[Array, ""]
    """Readings at or above belong to a dead channel [counts]."""
    stuck_frames: Int[Array, ""]
    """Number of equal readings in a row after which a channel counts as stuck."""
    baseline_time_s: Float[Array, ""]
    """Time constant of the baseline while nothing is near [s]."""
    creep_time_s: Float[Array, ""]
    """Time constant of the baseline while something is near [s]."""
    recovery_time_s: Float[Array, ""]
    """Time constant of the baseline while the signal is impossibly negative [s]."""
    negative_sigma: Float[Array, ""]
    """Signal below minus this many standard deviations is impossible."""
    gain: Float[Array, "*e"]
    """Counts of each electrode, or of all, for what a nominal one says with one [-]."""
    untouched_counts: Float[Array, "*e"]
    """What each electrode is known to read untouched, ∞ where nothing is known: see `crossed.touch`."""


class ArrayState(eqx.Module):
    """Memory of the array, rows first."""

    baseline_counts: Float[Array, " e"]
    baseline_frames: Int[Array, " e"]
    last_counts: Float[Array, " e"]
    equal_frames: Int[Array, " e"]


class ArrayReading(eqx.Module):
    """Signals of one frame, rows first."""

    signal_counts: Float[Array, " e"]
    """(e,) counts above the baseline over the gain, 0 where invalid."""
    valid: Bool[Array, " e"]
    """(e,) the channel is present, in range, alive and has a baseline."""


class BaselineTimes(Settings):
    """How the counts without touch are followed: time constants in s, nothing near, and something near."""

    time: PositiveTime = 2.0
    creep_time: PositiveTime = 60.0


class BaselineSettings(BaselineTimes):
    """And how it recovers from what cannot be: a time constant in s, a limit in standard deviations."""

    recovery_time: PositiveTime = 0.2
    negative_sigma: PositiveNumber = 10.0


class CountsSettings(ContactSettings):
    """Capacitive channels: noise in counts; a reading outside lowest_counts .. highest_counts, or the same in
    stuck_frames frames, belongs to a broken one. With 8 counts of noise two readings are equal once in 28
    frames, so 25 equal ones in a row are no chance.
    """

    noise_counts: PositiveNumber = 8.0
    lowest_counts: Number = 0.0
    highest_counts: Number = 65535.0
    stuck_frames: Annotated[Integer, Ge(2)] = 25

    @model_validator(mode="after")
    def _check_ends(self) -> Self:
        if self.lowest_counts >= self.highest_counts:
            raise wrong_value(f"must be below highest_counts = {self.highest_counts:g}", key="lowest_counts")
        return self

    def _array(self, baseline: BaselineTimes, **own: Float[ArrayLike, "*e"]) -> CapacitiveArray:
        """The electronics; own: fields of CapacitiveArray that are not the usual ones."""
        usual = {"gain": 1.0, "untouched_counts": np.inf}
        return parameters(CapacitiveArray, self, baseline, baseline_time_s=baseline.time, **usual | own)

    def _electronics(self, nothing: float, **own: Values) -> ChannelElectronics:
        """Virtual channels that read `nothing` untouched; own: what else they have of `equal_channels`."""
        ends = {"low": self.lowest_counts, "high": self.highest_counts}
        count = len(self.channels)
        return equal_channels(count, nothing=nothing, noise=self.noise_counts, step=1.0, **ends, **own)


class ElectrodeLinesSettings(CountsSettings):
    """Rows and columns of electrodes under the flat face on which a [[contact]] presses; row_y, column_x:
    their centre lines in the chart of the contact, in m.
    """

    row_y: Positions
    column_x: Positions

    @abstractmethod
    def place_information(self, radius_m: float) -> Callable[[Array, Array, Array], Array]:
        """Of contacts of a radius [m]: from columns (c,), rows (r,) and places (s, 2), all in m, to the
        information (s, 2, 2) [1/m²] on the places, see `place_information`; differentiable.
        """


def array_init(electrodes: int) -> ArrayState:
    """State before the first frame: no electrode has a baseline."""
    return ArrayState(
        baseline_counts=jnp.zeros(electrodes),
        baseline_frames=jnp.zeros(electrodes, int),
        last_counts=jnp.full(electrodes, jnp.nan, float),
        equal_frames=jnp.zeros(electrodes, int),
    )


def _alive(array: CapacitiveArray, counts: Float[Array, " e"], equal: Int[Array, " e"]) -> Bool[Array, " e"]:
    in_range = (counts > array.lowest_counts) & (counts < array.highest_counts)
    return jnp.isfinite(counts) & in_range & (equal < array.stuck_frames)


def count_equal_frames(state: ArrayState, counts: Float[Array, " e"]) -> Int[Array, " e"]:
    """Number of readings in a row that equal their predecessor, up to this one: counts (e,); (e,)."""
    return jnp.where(counts == state.last_counts, state.equal_frames + 1, 0)


def array_signal(array: CapacitiveArray, state: ArrayState, counts: Float[Array, " e"]) -> ArrayReading:
    """Signals above the baseline, by the gain of each electrode.

    Args: counts (e,) readings, rows first, NaN where missing.
    Returns: ArrayReading.
    """
    valid = _alive(array, counts, count_equal_frames(state, counts)) & (state.baseline_frames > 0)
    above = jnp.where(valid, counts - state.baseline_counts, 0.0)
    return ArrayReading(signal_counts=above / array.gain, valid=valid)


def track_baseline(
    array: CapacitiveArray,
    state: ArrayState,
    dt_s: Float[Array, ""],
    counts: Float[Array, " e"],
    near: Bool[Array, "..."],
    touching: Bool[Array, "..."],
) -> ArrayState:
    """Baseline after one frame.

    Args: dt_s time since the last frame [s]; counts (e,) readings, NaN where missing; near, touching: the
    decision on this frame, () for all electrodes or (e,) for each. The first frames are averaged equally
    until that average is as long as the time constant.
    """
    equal = count_equal_frames(state, counts)
    alive = _alive(array, counts, equal)
    signal = jnp.where(alive, counts, state.baseline_counts) - state.baseline_counts
    frames = state.baseline_frames
    known = frames > 0
    negative = known & (signal < -array.negative_sigma * array.noise_counts)
    slow = jnp.where(near, array.creep_time_s, array.baseline_time_s)
    time = jnp.where(negative, array.recovery_time_s, slow)
    young = jnp.where(near | negative, 0.0, 1.0 / (frames + 1.0))
    gain = jnp.maximum(1.0 - jnp.exp(-dt_s / time), young)
    # An electrode that appears while something is near would take that something for its baseline.
    active = alive & ~touching & (known | ~near)
    last = jnp.where(jnp.isfinite(counts), counts, state.last_counts)
    return ArrayState(
        baseline_counts=state.baseline_counts + jnp.where(active, gain * signal, 0.0),
        baseline_frames=frames + active,
        last_counts=last,
        equal_frames=equal,
    )


def weighted_mean_location(
    row_y_m: Float[Array, " r"],
    column_x_m: Float[Array, " c"],
    signal: Float[Array, " e"],
    valid: Bool[Array, " e"],
) -> Float[Array, "2"]:
    """The paper's location: signal-weighted mean of the electrodes' positions, rows and columns on their own.

    Args: row_y_m (r,), column_x_m (c,) [m]; signal (r + c,) [counts], rows first, negative ones count as
    zero; valid (r + c,).
    Returns: location (2,) [m]; the middle of the array where there is no signal.
    """
    weight = jnp.where(valid, jnp.maximum(signal, 0.0), 0.0)
    rows = row_y_m.shape[0]

    def mean(position, w):
        total = jnp.sum(w)
        return jnp.where(
            total > 0, jnp.sum(w * position) / jnp.where(total > 0, total, 1.0), jnp.mean(position)
        )

    return jnp.stack([mean(column_x_m, weight[rows:]), mean(row_y_m, weight[:rows])])
