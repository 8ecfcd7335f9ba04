"""Which things make an image of mutual capacitances: how many, where, and how strong each is.

One reading cannot tell how much of it is shielding and how much coupling (`mutual.model`), and on cells as
wide as a finger their shapes hardly differ: what came before must. So each source has one unknown strength
besides its place:

* one that hovers shields by s, k = 0;
* one in contact couples by k, and shields as it did when it was set down, `held` s*; s* = 0 is a thing that
  does not conduct. It presses or has gone (`lifted`): what pressed lightly is taken for gone when the wider
  image of what hovers fits better, what pressed firmly must press lightly first; and what would couple more
  than it can (`most`) has gone where hovering fits better at all.

Where coupling cancels shielding, an image hardly tells a place: what presses is expected where it was set
down, as well as that was told, until another place fits much better (`slid`).

Two fingers on neighbouring cells leave no valley between them, so that no local maximum tells them apart.
But one finger is neither as wide nor as strong: a further source is tried where it explains most of what is
left of the image (weighted least squares at places a quarter of a pitch apart), and instead of the source
that fits worst, two of them side by side. It stays when it mends the cost by `worth_sigma`², lies
`apart_pitches` from all others and is not weaker than `weakest` of its strongest neighbour. To what is
followed at most one is added in a frame. While nothing presses, an image tells everything by itself: then its
sources are sought afresh too, and taken where they explain it better, so that what was made of things far
away, whose images are broad, does not stay; not while they shield less than before, which may be coupling.
The cost is that of `mutual.cost`. Cells are split like a watershed: each belongs to the source that has the
largest part in it.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import solve
from jaxtyping import Array, Bool, Float, Int

from softfuse.sensors.mutual.cost import BEYOND, Guess, ImageCost, Known, image_cost
from softfuse.sensors.mutual.model import MutualModel, Sources, shield_shape, source_signals

_FINER = 4  # places tried per pitch
_UNSEEN = 1e-6  # of the largest weight
_HALF = 0.7  # of the strength of a source that becomes two
_NEIGHBOURS = 2.0  # pitches
_BETTER = 0.3  # by so much other sources must mend the cost, so that equals do not alternate
_NEEDED = 3.0  # standard deviations: what mends the cost by less, squared, is not one of those followed
_SIDES = np.array([[0.5, 0.0], [0.0, 0.5]])  # of a pitch


class Splitting(eqx.Module):
    """When a further source is believed; all fields but `iterations` are leaves."""

    worth_sigma: Float[Array, ""]
    """By so much, squared, a further source must mend the cost [standard deviations]."""
    apart_pitches: Float[Array, ""]
    """Least distance of a further source from each other [pitches]."""
    weakest: Float[Array, ""]
    """Least strength of a further source relative to its strongest neighbour."""
    faintest: Float[Array, ""]
    """Least strength of a further source [contact]."""
    lift_sigma: Float[Array, ""]
    """By so much, squared, hovering must fit better than contact to end it [standard deviations]."""
    slide_sigma: Float[Array, ""]
    """By so much, squared, another place must fit better than that where a thing was set down."""
    wander_m: Float[Array, ""]
    """Standard deviation of a place from where it was expected [m]."""
    iterations: int = eqx.field(static=True)
    """Number of Levenberg-Marquardt steps."""


class MutualFit(eqx.Module):
    """n sources, each in its slot."""

    sources: Sources
    """Places, shieldings and couplings; s = k = 0 in free slots."""
    place_sigma_m: Float[Array, "n 2"]
    """(n, 2) standard deviations of x, y [m]; of the order of a pitch in free slots."""
    there: Bool[Array, " n"]
    """(n,) the slot is taken."""
    contact: Bool[Array, " n"]
    """(n,) fitted as a thing in contact."""
    lifted: Bool[Array, " n"]
    """(n,) what was in contact here is not any more: the image is that of a thing that hovers."""
    slid: Bool[Array, " n"]
    """(n,) pressed, but not where it was set down."""
    afresh: Bool[Array, ""]
    """The image alone told all this."""
    label: Int[Array, "c r"]
    """(c, r) slot of the source to which a cell belongs, -1 for none."""
    common_counts: Float[Array, ""]
    """What all baselines are off by alike [counts]."""
    residual_counts: Float[Array, ""]
    """Root mean square residual of the valid cells [counts]."""


def nothing_known(model: MutualModel, slots: int) -> Known:
    """All slots free."""
    middle = jnp.stack([jnp.mean(model.column_x_m), jnp.mean(model.row_y_m)])
    no, zero, at = jnp.zeros(slots, bool), jnp.zeros(slots), jnp.tile(middle, (slots, 1))
    return Known(
        there=no,
        contact=no,
        firm=no,
        pressed=no,
        most=jnp.full(slots, jnp.inf, float),
        held=zero,
        place_m=at,
        set_down_m=at,
        set_down_sigma_m=jnp.broadcast_to(model.pitch_m, (slots, 2)),
        close=no,
        strength=zero,
        common_counts=jnp.zeros(()),
        common_sigma=model.common_error * model.contact_counts,
    )


def no_fit(model: MutualModel, slots: int) -> MutualFit:
    """The fit of an image in which nothing is."""
    known = nothing_known(model, slots)
    lines = model.column_x_m.shape[0], model.row_y_m.shape[0]
    return MutualFit(
        Sources(known.place_m, jnp.zeros(slots), jnp.zeros(slots)),
        jnp.broadcast_to(model.pitch_m, (slots, 2)),
        *([known.there] * 4),
        afresh=jnp.zeros((), bool),
        label=jnp.full(lines, -1),
        common_counts=jnp.zeros(()),
        residual_counts=jnp.zeros(()),
    )


def best_place(
    model: MutualModel, signal: Float[Array, " e"], weight: Float[Array, " e"]
) -> tuple[Float[Array, "2"], Float[Array, ""], Float[Array, ""]]:
    """Where one source explains most of an image.

    Args: signal (c r,) [counts]; weight (c r,) inverse standard deviations [1/counts], 0 where invalid.
    Returns: place (2,) [m]; net strength k − s there; by how much the weighted sum of squares falls.
    """
    lines = [
        jnp.linspace(
            line[0] - BEYOND * model.pitch_m,
            line[-1] + BEYOND * model.pitch_m,
            int(_FINER * (line.shape[0] - 1 + 2 * BEYOND)) + 1,
        )
        for line in (model.column_x_m, model.row_y_m)
    ]
    x, y = jnp.meshgrid(*lines, indexing="ij")
    places = jnp.stack([x.ravel(), y.ravel()], axis=1)
    shape = jax.vmap(lambda place: shield_shape(model, place, jnp.ones(())) * model.gain)(places)
    shape = shape.reshape(len(places), -1) * weight
    along = shape @ (signal * weight)
    # A place whose cells are all invalid has no say.
    length = jnp.sum(shape**2, axis=1) + _UNSEEN * jnp.max(weight) ** 2
    gain = along**2 / length
    best = jnp.argmax(gain)
    return places[best], along[best] / length[best] / model.contact_counts, gain[best]


def fit_sources(
    model: MutualModel,
    rule: Splitting,
    known: Known,
    signal: Float[Array, "c r"],
    valid: Bool[Array, "c r"],
) -> MutualFit:
    """All things in an image (c, r) of counts above the baseline, of which `valid` (c, r) take part."""
    image = image_cost(model, known, rule.wander_m, signal, valid)
    # How the minimum was found does not matter to its derivative: one step at it carries all of that.
    alone = image_cost(model, nothing_known(model, len(known.there)), rule.wander_m, signal, valid)
    frozen, free = jax.lax.stop_gradient((image, alone))
    z, cost, guess, lifted, slid = _follow(frozen, rule)
    z, _, guess, _ = _extend(frozen, rule, z, cost, guess, rule.worth_sigma**2)
    z, guess, afresh = jax.lax.cond(
        known.there.any() & ~(known.pressed | known.close).any(),
        lambda: _afresh(free, rule, known, z, guess),
        lambda: (z, guess, jnp.zeros((), bool)),
    )
    image = jax.tree.map(lambda told, held: jnp.where(afresh, told, held), alone, image)
    lifted = jnp.where(afresh, guess.there, lifted)
    matrix, gradient = image.normal_equations(z, guess)
    change = solve(jax.lax.stop_gradient(matrix), gradient, assume_a="pos").reshape(z.shape)
    z = z - (change - jax.lax.stop_gradient(change))
    sources = image.sources(z, guess)
    signals = source_signals(model, sources)
    strong = jnp.max(jnp.abs(signals), axis=0) > rule.worth_sigma * model.noise_counts
    misfit = jnp.where(image.weight > 0, jnp.sum(signals, axis=0) - image.signal, 0.0)
    # A misfit beyond the expected one widens the spread in proportion (Birge's ratio).
    freedom = jnp.maximum(jnp.sum(valid) - z.shape[1] * jnp.sum(guess.there), 1)
    ratio = jnp.maximum(1.0, jnp.sum(image.whitened(misfit) ** 2) / freedom)
    # An image is drawn to where things were in that before, which was off alike: that adds no knowledge.
    alone = image.information(z, eqx.tree_at(lambda g: g.expected, guess, guess.stays))
    variance = ratio * jnp.diagonal(jnp.linalg.inv(alone)).reshape(z.shape)
    return MutualFit(
        sources=sources,
        place_sigma_m=model.pitch_m * jnp.sqrt(variance[:, :2]),
        there=guess.there,
        contact=guess.contact & guess.there,
        lifted=lifted,
        slid=slid,
        afresh=afresh,
        label=jnp.where(strong, jnp.argmax(jnp.abs(signals), axis=0), -1).reshape(signal.shape),
        common_counts=image.common_counts(-misfit),
        residual_counts=jnp.sqrt(jnp.sum(misfit**2) / jnp.maximum(jnp.sum(valid), 1)),
    )


def _follow(image: ImageCost, rule: Splitting):
    """The known sources; each in contact is also tried as one that hovers, each that presses as slid."""
    known = image.known
    slots = known.there.shape[0]
    contact = known.there & known.contact
    # Row 0: as they were; row 1 + j: source j hovers; row 1 + slots + j: source j may be anywhere.
    none, each = jnp.zeros((slots, slots), bool), jnp.eye(slots, dtype=bool)
    hovers = jnp.concatenate([none[:1], each, none]) & contact
    slides = jnp.concatenate([none[:1], none, each]) & contact & known.pressed
    stays = contact & known.pressed & ~slides
    net = jnp.maximum(known.held - known.strength, 0.0)
    strength = jnp.where(hovers, net, known.strength)
    at = jnp.where(stays[..., None], known.set_down_m, known.place_m) / image.model.pitch_m
    guesses = jax.vmap(
        lambda over, on, off: Guess(known.there, contact & ~over, known.held, known.there & ~off, on)
    )(hovers, stays, slides)
    zs, costs = _minima(image, rule, jnp.concatenate([at, strength[..., None]], axis=-1), guesses)
    # To hover it must have shielded at all: what does not conduct ends by its strength.
    gain, moved = costs[0] - costs[1 : 1 + slots], costs[0] - costs[1 + slots :]
    beyond = (zs[0, :, 2] > known.most) & (gain > 0)
    lifted = ((gain > rule.lift_sigma**2) & ~known.firm | beyond) & contact & (known.held > 0)
    slid = (moved > rule.slide_sigma**2) & contact & known.pressed & ~lifted.any()
    best = jnp.where(slid.any(), 1 + slots + jnp.argmax(jnp.where(slid, moved, -jnp.inf)), 0)
    best = jnp.where(lifted.any(), 1 + jnp.argmin(jnp.where(lifted, costs[1 : 1 + slots], jnp.inf)), best)
    guess = jax.tree.map(lambda of: of[best], guesses)
    return zs[best], costs[best], guess, lifted, slides[best]


def _afresh(alone: ImageCost, rule: Splitting, before: Known, z, guess: Guess):
    """The sources of an image of which nothing is known, where they explain it better than those followed.

    What was made of things while they were further off, and their image broad, must not stay. That coupling
    hides no shielding is told by the image: all that shields together does not do so by less than it did.
    """
    known = alone.known
    followed = jnp.sum(guess.there)
    needed = _NEEDED**2

    def further(carry):
        z, cost, guess, _ = carry
        worth = jnp.where(jnp.sum(guess.there) < followed, needed, rule.worth_sigma**2)
        z, cost, guess, new = _extend(alone, rule, z, cost, guess, worth)
        return z, cost, guess, new.any() & ~guess.there.all()

    def price(z, guess):
        # Of the image alone: where something was expected has no say.
        free = eqx.tree_at(lambda g: (g.expected, g.stays), guess, (known.there, known.there))
        count = jnp.sum(guess.there)
        born = jnp.maximum(count - followed, 0)
        return alone.cost(z, free) + needed * (count - born) + rule.worth_sigma**2 * born

    none = jnp.zeros_like(z).at[:, :2].set(known.place_m / alone.model.pitch_m)
    nobody = Guess(known.there, known.contact, known.held, known.there, known.there)
    start = (none, alone.cost(none, nobody), nobody, jnp.ones((), bool))
    z_alone, _, guess_alone, _ = jax.lax.while_loop(lambda carry: carry[3], further, start)
    there = guess_alone.there
    shielded = jnp.sum(jnp.where(before.there, jnp.where(before.contact, before.held, before.strength), 0.0))
    taken = (
        (price(z, guess) - price(z_alone, guess_alone) > _BETTER)
        & ~(there & guess_alone.contact).any()
        & (jnp.sum(jnp.where(there, z_alone[:, 2], 0.0)) >= shielded)
    )
    # Which source is which track is told by their places alone.
    found = jax.tree.map(lambda after, now: jnp.where(taken, after, now), (z_alone, guess_alone), (z, guess))
    return *found, taken


def _extend(image: ImageCost, rule: Splitting, z, cost, guess: Guess, worth: Float[Array, ""]):
    """One source more, if one mends the cost by `worth` and a slot is free."""
    model = image.model
    new = jnp.arange(len(z)) == jnp.argmin(guess.there)
    left = image.left(z, guess)
    place, strength, _ = best_place(model, left, image.weight)
    signals = source_signals(model, image.sources(z, guess))
    worst = jnp.argmax(jnp.abs(signals) @ image.whitened(left) ** 2)
    is_worst = jnp.arange(len(z)) == worst
    net = jnp.where(guess.contact[worst], guess.held[worst] - z[worst, 2], z[worst, 2])
    half = _HALF * jnp.maximum(net, 0.0)
    alone = jnp.append(place / model.pitch_m, jnp.abs(strength))
    held = jnp.where(new, 0.0, guess.held)
    starts = [jnp.where(new[:, None], alone, z)]
    guesses = [
        Guess(
            guess.there | new,
            jnp.where(new, strength > 0, guess.contact),
            held,
            guess.expected & ~new,
            guess.stays,
        )
    ]
    for side in _SIDES:
        pair = [jnp.append(z[worst, :2] + sign * side, half) for sign in (-1.0, 1.0)]
        starts.append(jnp.where(is_worst[:, None], pair[0], jnp.where(new[:, None], pair[1], z)))
        # A source that becomes two is no longer where it was expected.
        free = new | is_worst
        guesses.append(
            Guess(guess.there | new, guess.contact & ~free, held, guess.expected & ~free, guess.stays & ~free)
        )
    guesses = jax.tree.map(lambda *each: jnp.stack(each), *guesses)
    zs, costs = _minima(image, rule, jnp.stack(starts), guesses)
    distinct = jax.vmap(lambda z: _distinct(rule, z, jnp.where(guess.contact, held, 0.0), guess.there, new))
    costs = jnp.where(distinct(zs), costs, jnp.inf)
    best = jnp.argmin(costs)
    taken = ~guess.there.all() & (cost - costs[best] > worth)
    found = jax.tree.map(lambda each, before: jnp.where(taken, each[best], before), guesses, guess)
    return jnp.where(taken, zs[best], z), jnp.where(taken, costs[best], cost), found, new & taken


def _minima(image: ImageCost, rule: Splitting, starts: Float[Array, "a n 3"], guesses: Guess):
    """Minima (a, n, 3) from `starts` under as many guesses, and their costs (a,)."""
    return jax.vmap(lambda start, guess: image.minimise(start, guess, rule.iterations))(starts, guesses)


def _distinct(rule: Splitting, z, held, there, new) -> Bool[Array, ""]:
    """Whether the new source lies apart from the others and is not faint."""
    others = there & ~new
    square = jnp.sum((z[:, :2] - new @ z[:, :2]) ** 2, axis=-1)
    apart = jnp.min(jnp.where(others, square, jnp.inf)) > rule.apart_pitches**2
    # What a neighbour's model misses looks like a weak source beside it.
    neighbours = others & (square < _NEIGHBOURS**2)
    strongest = jnp.max(jnp.where(neighbours, jnp.maximum(z[:, 2], held), 0.0))
    return apart & (new @ z[:, 2] > jnp.maximum(rule.weakest * strongest, rule.faintest))
