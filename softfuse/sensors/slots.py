"""Which contacts the estimator follows: at most N of the touched electrodes, each in a slot of its own.

An electrode keeps its slot for as long as it is touched: a force that is carried from frame to frame belongs
to the contact in its slot. Free slots are given to the strongest touched electrodes without one.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from softfuse.errors import ConfigError


class ContactSlots(eqx.Module):
    """Electrodes in their slots."""

    electrode: Int[Array, " s"]
    """(s,) index of the electrode; that of the last one while the slot is not used."""
    used: Bool[Array, " s"]
    """(s,) an electrode is in the slot."""


def slots_init(slots: int, electrodes: int) -> ContactSlots:
    """All slots free.

    Raises ConfigError unless 1 <= slots <= electrodes.
    """
    if not 1 <= slots <= electrodes:
        raise ConfigError(
            f"{slots} contacts at once on {electrodes} electrodes: give a number from 1 to {electrodes}"
        )
    return ContactSlots(electrode=jnp.zeros(slots, int), used=jnp.zeros(slots, bool))


def assign_slots(slots: ContactSlots, signal: Float[Array, " n"], touched: Bool[Array, " n"]) -> ContactSlots:
    """Slots after one frame.

    Args: signal (n,), the larger the stronger the touch, in any unit; touched (n,) electrodes to be followed.
    Returns: the slots; electrodes beyond their number wait until one is free.
    """
    kept = slots.used & touched[slots.electrode]
    waiting = touched.at[slots.electrode].min(~kept)
    order = jnp.argsort(jnp.where(waiting, signal, -jnp.inf), descending=True)
    # The j-th free slot takes the j-th strongest of those who wait, if there are that many.
    turn = jnp.cumsum(~kept) - 1
    taken = ~kept & (turn < jnp.sum(waiting))
    return ContactSlots(
        electrode=jnp.where(taken, order[turn], slots.electrode),
        used=kept | taken,
    )
