"""Touches followed from image to image: each keeps its number, and is near, light or firm.

Every track expects its source at p + v dt, and the sources of an image (`mutual.fit`) are assigned to the
tracks so that the sum of squared distances, none counted beyond `gate_m`², is the least of all permutations.
A track without a source is remembered for `memory_s`: what comes back there is the same touch. What no track
expects is a new one, with the next number.

* proximity: something shields, by less than `contact_on` of contact.
* light touch: by more for `on_frames`; or something couples that does not shield, for as long. From then on
  its shielding is held and what changes is coupling (`mutual.fit`), until the image is that of a thing that
  hovers, and shields by less, for `off_frames`.
* firm touch: coupling above `firm_on` for `on_frames`, until below `firm_off` for `off_frames`.

Where the body's cavities tell that nothing presses harder, no coupling can have grown by more than `firm_on`:
an image that says so is that of a thing that has gone.
"""

from itertools import permutations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from softfuse.errors import ConfigError
from softfuse.sensors.mutual.cost import Known
from softfuse.sensors.mutual.fit import MutualFit
from softfuse.sensors.mutual.model import MutualModel

MOST_TRACKS = 5
"""All their permutations are tried."""

_CLOSE = 0.8  # pitches
_COASTING_S = 0.5
_SLIP_M_PER_ROOT_S = 0.3e-3  # how far a thing that presses may slip unseen
_STILL_M_S = 20e-3  # slower is rest: errors of places must not add up to a motion


class TouchFollower(eqx.Module):
    """Thresholds, see above: of shielding and coupling; distances, times and frames in a row. All fields are
    leaves.

    `coupling_on`, `coupling_off`: when something that does not shield touches, and does no longer; `faint`:
    shielding below which something that hovers is gone; `speed_s`: time over which speeds are averaged;
    `longest_touch_s`: after which a touch is taken for a change of the array.
    """

    contact_on: Float[Array, ""]
    coupling_on: Float[Array, ""]
    coupling_off: Float[Array, ""]
    faint: Float[Array, ""]
    firm_on: Float[Array, ""]
    firm_off: Float[Array, ""]
    gate_m: Float[Array, ""]
    memory_s: Float[Array, ""]
    speed_s: Float[Array, ""]
    longest_touch_s: Float[Array, ""]
    on_frames: Int[Array, ""]
    off_frames: Int[Array, ""]


class TouchTracks(eqx.Module):
    """n tracks."""

    there: Bool[Array, " n"]
    """(n,) something is seen."""
    number: Int[Array, " n"]
    """(n,) its number, from 1; 0 before the first."""
    place_m: Float[Array, "n 2"]
    """(n, 2) x, y [m]."""
    place_sigma_m: Float[Array, "n 2"]
    """(n, 2) their standard deviations [m], NaN where nothing is seen."""
    set_down_m: Float[Array, "n 2"]
    """(n, 2) where it was before it pressed [m]."""
    set_down_sigma_m: Float[Array, "n 2"]
    """(n, 2) standard deviations of where it may be since [m]."""
    velocity_m_s: Float[Array, "n 2"]
    """(n, 2) its speed [m/s]."""
    touching: Bool[Array, " n"]
    """(n,) it touches."""
    firm: Bool[Array, " n"]
    """(n,) it touches firmly."""
    conducts: Bool[Array, " n"]
    """(n,) it shields, or did when it was set down."""
    shield: Float[Array, " n"]
    """(n,) shielding s, held while it touches."""
    coupling: Float[Array, " n"]
    """(n,) coupling k, 0 while it hovers."""
    least: Float[Array, " n"]
    """(n,) the least coupling since something pressed harder."""
    touch_frames: Int[Array, " n"]
    firm_frames: Int[Array, " n"]
    touched_s: Float[Array, " n"]
    lost_s: Float[Array, " n"]
    common_counts: Float[Array, ""]
    """What all baselines are off by alike, as the last image told that had nothing pressed in it [counts]."""
    last_number: Int[Array, ""]


def tracks_init(tracks: int) -> TouchTracks:
    """Nothing has been seen.

    Raises ConfigError unless 1 <= tracks <= MOST_TRACKS.
    """
    if not 1 <= tracks <= MOST_TRACKS:
        raise ConfigError(f"{tracks} touches at once: give a number from 1 to {MOST_TRACKS}")
    no, zero, none = jnp.zeros(tracks, bool), jnp.zeros(tracks), jnp.zeros(tracks, int)
    two = jnp.zeros((tracks, 2))
    unknown, never = jnp.full((tracks, 2), jnp.nan, float), jnp.full(tracks, jnp.inf, float)
    return TouchTracks(
        no, none, two, unknown, two, unknown, two, no, no, no, zero, zero, zero, none, none, zero, never,
        jnp.zeros(()), jnp.zeros((), int),
    )  # fmt: skip


def expected(
    model: MutualModel,
    follower: TouchFollower,
    tracks: TouchTracks,
    dt_s: Float[Array, ""],
    squeezed: Bool[Array, ""],
) -> Known:
    """What the next image, dt_s [s] later, should show; `squeezed`: something may just press harder."""
    low = jnp.stack([model.column_x_m[0], model.row_y_m[0]]) - 0.5 * model.pitch_m
    high = jnp.stack([model.column_x_m[-1], model.row_y_m[-1]]) + 0.5 * model.pitch_m
    square = jnp.sum(tracks.velocity_m_s**2, axis=1, keepdims=True)
    velocity = jnp.where(square > _STILL_M_S**2, tracks.velocity_m_s, 0.0)
    place = jnp.clip(tracks.place_m + dt_s * velocity, low, high)
    # Baselines rest while something touches; then coupling looks like what they are off by.
    touched = tracks.touching.any()
    pressed = tracks.touching & tracks.conducts & (tracks.coupling > follower.coupling_off)
    return Known(
        there=tracks.there,
        contact=tracks.touching | (tracks.there & ~tracks.conducts),
        firm=tracks.firm,
        pressed=pressed & jnp.all(jnp.isfinite(tracks.set_down_sigma_m), axis=1),
        most=jnp.where(squeezed, jnp.inf, tracks.least + follower.firm_on),
        held=jnp.where(tracks.conducts, tracks.shield, 0.0),
        place_m=place,
        set_down_m=tracks.set_down_m,
        set_down_sigma_m=tracks.set_down_sigma_m,
        close=_close(tracks.there & tracks.touching, place, _CLOSE * model.pitch_m),
        strength=jnp.where(tracks.touching | ~tracks.conducts, tracks.coupling, tracks.shield),
        common_counts=jnp.where(touched, tracks.common_counts, 0.0),
        common_sigma=jnp.where(touched, model.noise_counts, model.common_error * model.contact_counts),
    )


def _close(touching: Bool[Array, " n"], place_m: Float[Array, "n 2"], least_m: Float[Array, ""]):
    """Touches (n,) nearer than that to another one."""
    square = jnp.sum((place_m[:, None] - place_m[None]) ** 2, axis=-1)
    others = touching[:, None] & touching[None, :] & ~jnp.eye(touching.shape[0], dtype=bool)
    return jnp.any(others & (square < least_m**2), axis=1)


def optimal_assignment(cost: Float[Array, "n n"]) -> Int[Array, " n"]:
    """The column of each row (n,), no two the same, for which the sum of `cost` (n, n) is least."""
    count = cost.shape[0]
    every = jnp.asarray(np.array(list(permutations(range(count)))))
    total = jnp.sum(cost[jnp.arange(count), every], axis=1)
    return every[jnp.argmin(total)]


def follow_touches(
    follower: TouchFollower,
    tracks: TouchTracks,
    dt_s: Float[Array, ""],
    known: Known,
    fit: MutualFit,
    squeezed: Bool[Array, ""],
) -> TouchTracks:
    """Tracks after an image, dt_s after the last [s]: `known` was expected, `fit` found.

    `squeezed`: something may just press harder.
    """
    # What is faint and in no contact is not there any more.
    strength = jnp.maximum(fit.sources.shield, fit.sources.coupling)
    seen = fit.there & (strength > follower.faint)
    remembered = tracks.there | (tracks.lost_s < follower.memory_s)
    apart = jnp.linalg.norm(fit.sources.place_m[None] - known.place_m[:, None], axis=-1)
    gate = follower.gate_m
    far = jnp.where(remembered[:, None] | seen[None, :], gate**2, 0.0)
    both = remembered[:, None] & seen[None, :]
    to = optimal_assignment(jnp.where(both, jnp.minimum(apart**2, gate**2), far))
    count = jnp.arange(to.shape[0])
    there = seen[to]
    same = there & remembered & (apart[count, to] < gate)
    born = there & ~same
    place = jnp.where(there[:, None], fit.sources.place_m[to], known.place_m)
    shield, coupling, contact = fit.sources.shield[to], fit.sources.coupling[to], fit.contact[to]

    touching = tracks.touching & same & tracks.there
    # What shields like contact has not gone: it had not arrived when it was taken to touch, or lies looser.
    lifted = fit.lifted[to] & touching
    hovers = lifted & (shield < follower.contact_on)
    gone = hovers | (touching & ~tracks.conducts & (coupling < follower.coupling_off))
    begins = jnp.where(contact, coupling > follower.coupling_on, shield > follower.contact_on)
    counts = jnp.where(touching, gone, begins & there)
    frames = jnp.where(counts, jnp.where(same, tracks.touch_frames, 0) + 1, 0)
    flip = frames >= jnp.where(touching, follower.off_frames, follower.on_frames)
    now = touching ^ flip
    held = touching & now & (~lifted | hovers)
    conducts = jnp.where(touching, tracks.conducts, ~contact)
    pressed = jnp.where(contact, coupling, jnp.where(held, jnp.maximum(tracks.shield - shield, 0.0), 0.0))

    firm = tracks.firm & now & same
    beyond = jnp.where(firm, pressed < follower.firm_off, pressed > follower.firm_on) & now
    firm_frames = jnp.where(beyond, jnp.where(same, tracks.firm_frames, 0) + 1, 0)
    turn = firm_frames >= jnp.where(firm, follower.off_frames, follower.on_frames)

    step = jnp.where(dt_s > 0, dt_s, 1.0)
    share = jnp.where(dt_s > 0, -jnp.expm1(-dt_s / follower.speed_s), 0.0)
    moved = (place - tracks.place_m) / step - tracks.velocity_m_s
    # The places of two that cross say nothing of their speeds.
    follows = (same & tracks.there)[:, None]
    share = jnp.where(known.close, 0.0, share)[:, None]
    kept = jnp.where(known.close, jnp.exp(-dt_s / _COASTING_S), 1.0)[:, None]
    # Once it presses, its coupling hides from an image where its shielding is.
    anew = (born | ~known.pressed | fit.slid[to])[:, None]
    sigma = jnp.where(there[:, None], fit.place_sigma_m[to], jnp.nan)
    number = jnp.where(born, tracks.last_number + jnp.cumsum(born), tracks.number)
    return TouchTracks(
        there=there,
        number=number,
        place_m=place,
        place_sigma_m=sigma,
        set_down_m=jnp.where(anew, place, tracks.set_down_m),
        set_down_sigma_m=jnp.where(
            anew, sigma, jnp.sqrt(tracks.set_down_sigma_m**2 + _SLIP_M_PER_ROOT_S**2 * dt_s)
        ),
        velocity_m_s=jnp.where(follows, kept * tracks.velocity_m_s + share * moved, jnp.zeros_like(moved)),
        touching=now,
        firm=firm ^ turn,
        conducts=conducts & there,
        shield=jnp.where(there, jnp.where(held, tracks.shield, shield), 0.0),
        coupling=jnp.where(there, pressed, 0.0),
        least=jnp.where(there & now, jnp.where(squeezed, pressed, jnp.minimum(tracks.least, pressed)), 0.0),
        touch_frames=jnp.where(flip, 0, frames),
        firm_frames=jnp.where(turn, 0, firm_frames),
        touched_s=jnp.where(now, jnp.where(same, tracks.touched_s, 0.0) + dt_s, 0.0),
        lost_s=jnp.where(there, 0.0, jnp.where(remembered, tracks.lost_s + dt_s, jnp.inf)),
        common_counts=jnp.where(tracks.touching.any() & ~fit.afresh, tracks.common_counts, fit.common_counts),
        last_number=tracks.last_number + jnp.sum(born),
    )
