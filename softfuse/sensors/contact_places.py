"""Contacts that sensors see: in which slots they are followed, and where they are.

An electrode, or whatever else is touched, keeps its slot for as long as it is touched: a force that is
carried from frame to frame belongs to the contact in its slot. Free slots are given to the strongest touched
ones without one.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.scipy.special import ndtr
from jaxtyping import Array, Bool, Float, Int

from softfuse.errors import ConfigError
from softfuse.functional.chart import FlatChart, moved

_FAR = 3.0
"""Standard deviations outside beyond which a place is outside after all."""

_WIDE = 10.0
"""Widths of the box beyond which a larger standard deviation says nothing more."""


class SlotsUsed(eqx.Module):
    """Electrodes in their slots."""

    electrode: Int[Array, " s"]
    """(s,) index of the electrode; that of the last one while the slot is not used."""
    used: Bool[Array, " s"]
    """(s,) an electrode is in the slot."""


def slots_init(slots: int, electrodes: int) -> SlotsUsed:
    """All slots free.

    Raises ConfigError unless 1 <= slots <= electrodes.
    """
    if not 1 <= slots <= electrodes:
        raise ConfigError(
            f"{slots} contacts at once on {electrodes} electrodes: give a number from 1 to {electrodes}"
        )
    return SlotsUsed(electrode=jnp.zeros(slots, int), used=jnp.zeros(slots, bool))


def assign_slots(slots: SlotsUsed, signal: Float[Array, " n"], touched: Bool[Array, " n"]) -> SlotsUsed:
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
    return SlotsUsed(
        electrode=jnp.where(taken, order[turn], slots.electrode),
        used=kept | taken,
    )


def apart(low_m: Float[Array, "2"], high_m: Float[Array, "2"], slots: int) -> Float[Array, "c 2"]:
    """Coordinates (c, 2) of contacts that nobody sees: two in one place would be one."""
    share = (jnp.arange(slots) + 0.5)[:, None] / slots
    return low_m + share * (high_m - low_m)


class ContactSlots(eqx.Module):
    """The slots of one [[contact]]: numbers of those that see it among the contact sensors; its coordinates,
    None where it has none; the lowest and highest coordinates (2,) [m]; a place (3, 3) where it may press.
    """

    name: str = eqx.field(static=True)
    slots: int = eqx.field(static=True)
    seen_by: tuple[int, ...] = eqx.field(static=True)
    chart: FlatChart | None
    low_m: Float[Array, "2"]
    high_m: Float[Array, "2"]
    somewhere: Float[Array, "3 3"]

    def waiting(self) -> Float[Array, "c 3 3"]:
        """Places of contacts that nobody sees: in the middle, apart from each other; the same without
        coordinates, where a body can be pressed: off its surface a patch has no rows.
        """
        low, high = (jnp.where(jnp.isfinite(end), end, 0.0) for end in (self.low_m, self.high_m))
        return self.at(apart(low, high, self.slots))

    def at(self, coordinates: Float[Array, "c 2"]) -> Float[Array, "c 3 3"]:
        """Places at coordinates (c, 2) [m]."""
        if self.chart is None:
            return jnp.broadcast_to(self.somewhere, (len(coordinates), 3, 3))
        return chart_places(self.chart, coordinates, jnp.zeros_like(coordinates))[0]


def chart_place(
    chart: FlatChart, at: Float[Array, "2"], covariance_m2: Float[Array, "2 2"]
) -> tuple[Float[Array, "3 3"], Float[Array, "2 2"]]:
    """The place (3, 3) at coordinates (2,) [m], and their covariance (2, 2) [m²] along its tangents."""
    place = chart.place(at)
    turned = place[1:] @ jax.jacfwd(lambda x: chart.place(x)[0])(at)
    return place, turned @ covariance_m2 @ turned.T


def chart_places(
    chart: FlatChart, at: Float[Array, "c 2"], sigma_m: Float[Array, "c 2"]
) -> tuple[Float[Array, "c 3 3"], Float[Array, "c 2 2"]]:
    """The same of c contacts whose coordinates have standard deviations (c, 2) [m], each for itself."""
    return jax.vmap(lambda x, s: chart_place(chart, x, jnp.diag(s**2)))(at, sigma_m)


def joined_places(
    places: Float[Array, "n c 3 3"], covariance_m2: Float[Array, "n c 2 2"], located: Bool[Array, "n c"]
) -> tuple[Float[Array, "c 3 3"], Float[Array, "c 2 2"]]:
    """What n sensors say of c contacts, each by its precision; where none locates one, what the first says.

    Args: places, covariances along their own tangents [m²], and who locates a contact. The place found lies
    in the tangents of the first that does.
    """
    first = jnp.argmax(located, axis=0)
    contacts = jnp.arange(located.shape[1])
    base, own = places[first, contacts], covariance_m2[first, contacts]
    tangents = base[:, 1:]
    offset = jnp.einsum("cki,nci->nck", tangents, places[:, :, 0] - base[:, 0])
    turn = jnp.einsum("cki,ncli->nckl", tangents, places[:, :, 1:])
    spread = jnp.einsum("nckl,nclm,ncjm->nckj", turn, covariance_m2, turn)
    used = located[..., None, None]
    # A covariance that is not used may be anything, also none.
    precision = jnp.where(used, jnp.linalg.inv(jnp.where(used, spread, jnp.eye(2))), 0.0)
    total = jnp.sum(precision, axis=0)
    known = jnp.any(located, axis=0)
    joined = jnp.linalg.inv(jnp.where(known[:, None, None], total, jnp.eye(2)))
    pull = jnp.einsum("nckl,ncl->ck", precision, jnp.where(located[..., None], offset, 0.0))
    mean = jnp.einsum("ckl,cl->ck", joined, pull)
    place = jnp.where(known[:, None, None], moved(base, mean), places[0])
    return place, jnp.where(known[:, None, None], joined, own)


def within(
    place_m: Float[Array, "n 2"], sigma_m: Float[Array, "n 2"], box_m: Float[Array, "2 2"]
) -> tuple[Bool[Array, " n"], Float[Array, "n 2"], Float[Array, "n 2"]]:
    """Places of which it is known that they lie within a box.

    Along each axis a place is N(μ, σ²) by what was seen, and between a and b. With α = (a − μ)/σ,
    β = (b − μ)/σ, φ and Φ of the standard normal distribution and Z = Φ(β) − Φ(α), what both say together has
    (N. L. Johnson, S. Kotz, N. Balakrishnan, Continuous Univariate Distributions 1, 2nd ed., Wiley, 1994,
    Sec. 13.10.1)

        mean = μ + σ (φ(α) − φ(β)) / Z,
        variance = σ² [1 + (α φ(α) − β φ(β)) / Z − ((φ(α) − φ(β)) / Z)²].

    Args: place_m (n, 2), as seen; sigma_m (n, 2), standard deviations; box_m (2, 2), lowest and highest x, y
    [all m].
    Returns: (n,) whether a place is known to any degree and may lie there; mean (n, 2) and standard
    deviations (n, 2) [m], NaN where not.
    """
    known = sigma_m > 0
    # As wide as many boxes is anywhere in one.
    sigma = jnp.clip(jnp.where(known, sigma_m, 1.0), None, _WIDE * (box_m[1] - box_m[0]))
    low, high = (box_m - place_m[:, None]).transpose(1, 0, 2) / sigma
    may = jnp.all(known & (low < _FAR) & (high > -_FAR), axis=1)
    # Beyond eight standard deviations a bound says nothing: its density would only underflow.
    low, high = (
        jnp.where(may[:, None], jnp.clip(bound, -8.0, 8.0), end) for bound, end in ((low, -8.0), (high, 8.0))
    )
    total = ndtr(high) - ndtr(low)
    at_low, at_high = (jnp.exp(-0.5 * bound**2) / jnp.sqrt(2 * jnp.pi) for bound in (low, high))
    shift = (at_low - at_high) / total
    spread = jnp.sqrt(1.0 + (low * at_low - high * at_high) / total - shift**2)
    mean, deviation = place_m + sigma * shift, sigma * spread
    return may, jnp.where(may[:, None], mean, jnp.nan), jnp.where(may[:, None], deviation, jnp.nan)
