"""Touches on a virtual grid of mutual capacitances, through a model whose constants touches gave it.

Both start from the field of strips in the half space; what the model does not know are crosstalk, the soft
layers under a disc's edge, drift, noise and the converter's steps.
"""

from collections.abc import Callable
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made_sensors import mutual_grid

from softfuse.errors import ConfigError
from softfuse.experiment.paper.mutual_bed import MutualBed
from softfuse.sensors.mutual.field import MutualField, Thing
from softfuse.sensors.mutual.fit import fit_sources, nothing_known
from softfuse.sensors.mutual.grid import MutualGrid, MutualReading, mutual_init, mutual_update
from softfuse.sensors.mutual.model import MutualModel, Sources, mutual_signal, source_signals
from softfuse.sensors.mutual.settings import MutualSplittingSettings
from softfuse.sensors.mutual.touch_tracks import TouchTracks, optimal_assignment, tracks_init

MM = 1e-3
ALL = jnp.ones((4, 4), bool)
SPLITTING = MutualSplittingSettings().splitting()
Things = Callable[[float], list[Thing]]


def grid_of(model: MutualModel) -> MutualGrid:
    """A grid with that model and else the usual."""
    return replace(mutual_grid(model.column_x_m, model.row_y_m), model=model)


BED = MutualBed()


@pytest.fixture(scope="module")
def model(calibrated_grid) -> MutualModel:
    """Of the usual bed and finger."""
    return calibrated_grid(BED, 8 * MM)


@pytest.fixture(scope="module")
def grid(model: MutualModel) -> MutualGrid:
    """With that model."""
    return grid_of(model)


@jax.jit
def _all_frames(grid: MutualGrid, counts):
    def frame(state, now):
        return mutual_update(grid, state, jnp.asarray(0.01), now)

    return jax.lax.scan(frame, mutual_init(grid), counts)[1]


def seen_by(grid: MutualGrid, bed: MutualBed, things: Things, change=lambda c: c) -> MutualReading:
    """What a grid says in 3 s at 100 Hz under the things of each time [s]."""
    time = 0.01 * np.arange(300)
    counts = bed.counts(time, [things(t) for t in time]).astype(float)
    return _all_frames(grid, jnp.asarray(change(counts)))


@pytest.fixture(scope="module")
def seen_under(grid: MutualGrid) -> Callable[..., MutualReading]:
    """seen_under(things): what the usual grid says."""
    return lambda *given: seen_by(grid, BED, *given)


def pressed(place, at, force, **kind) -> Things:
    """Comes down from 20 mm at `at`, lies for 0.2 s, presses for 0.7 s, lies for 0.2 s, leaves."""
    times = at + np.array([0.0, 0.3, 0.5, 0.7, 1.2, 1.4, 1.6, 1.9])
    heights, forces = (20e-3, 0, 0, 0, 0, 0, 0, 20e-3), (0, 0, 0, force, force, 0, 0, 0)

    def now(t):
        if not times[0] <= t <= times[-1]:
            return []
        height, press = (float(np.interp(t, times, each)) for each in (heights, forces))
        return [Thing(place, height, press, **kind)]

    return now


def of_frame(tracks: TouchTracks, k: int) -> list[tuple[int, str]]:
    """Numbers and kinds of all that is seen in frame k."""
    kinds = np.where(tracks.firm[k], "firm", np.where(tracks.touching[k], "light", "near"))
    return sorted((int(tracks.number[k, j]), str(kinds[j])) for j in np.flatnonzero(tracks.there[k]))


def places_of(tracks: TouchTracks, k: int) -> dict[int, np.ndarray]:
    """Places [mm] of what touches in frame k, by number."""
    touching = np.flatnonzero(tracks.touching[k])
    return {int(tracks.number[k, j]): 1e3 * np.asarray(tracks.place_m[k, j]) for j in touching}


@pytest.mark.parametrize("place", [(-8 * MM, -8 * MM), (3 * MM, -5 * MM), (-22 * MM, 10 * MM)])
def test_proximity_light_and_firm_touch_of_a_finger_are_told_apart(place, seen_under) -> None:
    tracks = seen_under(pressed(place, 0.5, 6.0)).tracks
    assert of_frame(tracks, 40) == []
    assert {kind for _, kind in of_frame(tracks, 68)} == {"near"}
    for k, kind in ((95, "light"), (150, "firm"), (200, "light")):
        found = [number for number, each in of_frame(tracks, k) if each == kind]
        assert len(found) == 1 and len(places_of(tracks, k)) == 1
        (at,) = places_of(tracks, k).values()
        # A hundredth of the signal, the model's error, is 0.2 mm where the image is steep.
        np.testing.assert_allclose(at, 1e3 * np.array(place), atol=0.6)
    assert of_frame(tracks, 290) == []
    # Light before and after: the same touch.
    assert places_of(tracks, 95).keys() == places_of(tracks, 150).keys() == places_of(tracks, 200).keys()


def test_what_does_not_conduct_is_seen_through_coupling_only(seen_under) -> None:
    tracks = seen_under(pressed((-8 * MM, 5 * MM), 0.5, 4.0, permittivity=3.0)).tracks
    assert not np.asarray(tracks.touching[:100]).any()
    (j,) = np.flatnonzero(tracks.touching[150])
    assert not tracks.conducts[150, j] and float(tracks.shield[150, j]) == 0.0
    assert bool(tracks.firm[150, j])
    np.testing.assert_allclose(1e3 * tracks.place_m[150, j], [-8, 5], atol=1.0)
    assert of_frame(tracks, 290) == []


def test_two_touches_on_neighbouring_cells_at_unequal_strength_are_two(seen_under) -> None:
    one, other = pressed((-8 * MM, -8 * MM), 0.4, 0.5), pressed((8 * MM, -8 * MM), 0.6, 5.0)
    seen = seen_under(lambda t: one(t) + other(t))
    places = places_of(seen.tracks, 155)
    assert len(places) == 2
    found = np.array(sorted(map(tuple, places.values())))
    # The weak one couples a tenth of what the strong one does, so the same error weighs ten times as much.
    np.testing.assert_allclose(found, [[-8, -8], [8, -8]], atol=1.5)
    weaker, stronger = sorted(np.asarray(seen.tracks.coupling[155])[np.asarray(seen.tracks.touching[155])])
    assert stronger > 2 * weaker
    # Each has the cell under it.
    label = np.asarray(seen.fit.label[155])
    assert label[1, 1] != label[2, 1] and {label[1, 1], label[2, 1]} == set(
        np.flatnonzero(seen.tracks.touching[155])
    )


def crossing(t: float) -> list[Thing]:
    """Two light touches that set down at 0.5 s and from 0.8 s on cross each other's path at 80 mm/s."""
    if t < 0.3:
        return []
    height, way = max(0.0, 0.5 - t) * 60 * MM, min(max(t - 0.8, 0.0) * 80 * MM, 40 * MM)
    return [
        Thing((-20 * MM + way, -12 * MM), height, 0.0, 7 * MM),
        Thing((20 * MM - way, 12 * MM), height, 0.0, 7 * MM),
    ]


def spaced(pitch: float) -> tuple[float, ...]:
    """Four lines."""
    return tuple(pitch * (k - 1.5) for k in range(4))


OTHER_BEDS = {
    "fine": (
        MutualBed(
            MutualField(spaced(10 * MM), spaced(10 * MM), 3.5 * MM, 1 * MM, fringe=0.35, spacer_Pa=9e4)
        ),
        6 * MM,
    ),
    "coarse": (
        MutualBed(MutualField(spaced(20 * MM), spaced(20 * MM), 9 * MM, 3 * MM, fringe=0.15), seed=8),
        10 * MM,
    ),
}


@pytest.mark.parametrize("bed_name", OTHER_BEDS)
def test_another_grid_and_finger_need_no_more_than_touches_at_known_places(bed_name, calibrated_grid) -> None:
    bed, radius = OTHER_BEDS[bed_name]
    grid = grid_of(calibrated_grid(bed, radius))
    pitch = bed.field.column_x[1] - bed.field.column_x[0]
    one, other = np.array([-0.7, -0.4]) * pitch, np.array([0.6, 0.9]) * pitch
    first = pressed(tuple(one), 0.3, 0.0, radius=radius)
    second = pressed(tuple(other), 0.5, 4.0, radius=radius)
    tracks = seen_by(grid, bed, lambda t: first(t) + second(t)).tracks
    found = sorted(places_of(tracks, 145).values(), key=lambda place: place[0])
    assert len(found) == 2
    # Rests of crosstalk and parts, and cells so wide that a disc moves within one unseen: in pitches.
    np.testing.assert_allclose(found, 1e3 * np.array([one, other]), atol=0.06 * 1e3 * pitch)
    assert {kind for _, kind in of_frame(tracks, 145)} == {"light", "firm"}
    assert of_frame(tracks, 295) == []


def test_numbers_survive_crossing_paths(seen_under) -> None:
    tracks = seen_under(crossing).tracks
    before, after = places_of(tracks, 78), places_of(tracks, 150)
    assert len(before) == 2 and before.keys() == after.keys()
    for number, place in before.items():
        np.testing.assert_allclose(after[number], place * [-1, 1], atol=3.0)


def test_a_short_dropout_keeps_the_number_and_a_long_one_does_not(seen_under) -> None:
    touch = pressed((5 * MM, 5 * MM), 0.2, 0.0)
    for gap, same in ((0.15, True), (0.5, False)):
        tracks = seen_under(lambda t, gap=gap: [] if 0.8 <= t < 0.8 + gap else touch(t)).tracks
        before, during, after = (places_of(tracks, k) for k in (75, 89, 140))
        assert len(before) == 1 and not during and len(after) == 1
        assert (before.keys() == after.keys()) == same


def test_a_missing_cell_does_not_stop_it(seen_under) -> None:
    def broken(counts):
        counts = counts.copy()
        counts[:, 5] = np.nan
        return counts

    seen = seen_under(pressed((-3 * MM, -5 * MM), 0.5, 1.0), broken)
    assert not bool(seen.valid[95, 1, 1]) and int(np.sum(~np.asarray(seen.valid[95]))) == 1
    ((_, place),) = places_of(seen.tracks, 95).items()
    np.testing.assert_allclose(place, [-3, -5], atol=3.0)


@pytest.mark.slow
def test_noise_and_drift_alone_are_no_touch_in_100_000_frames(grid) -> None:
    time = 0.01 * np.arange(100_000)
    counts = jnp.asarray(BED.counts_of(time, np.zeros((100_000, 4, 4))), float)

    @jax.jit
    def run(counts):
        def frame(state, given):
            state, seen = mutual_update(grid, state, jnp.asarray(0.01), given)
            return state, (jnp.sum(seen.tracks.touching), jnp.sum(seen.tracks.there))

        return jax.lax.scan(frame, mutual_init(grid), counts)[1]

    touching, there = run(counts)
    assert int(touching.sum()) == 0
    assert int(there.sum()) == 0


def test_the_baseline_is_frozen_while_something_touches(seen_under) -> None:
    seen = seen_under(lambda t: [Thing((0.0, 0.0), 0.0)] if t > 0.5 else [])
    first, last = np.asarray(seen.image[60]), np.asarray(seen.image[285])
    assert np.abs(first).max() > 500
    np.testing.assert_allclose(first, last, atol=60)


@pytest.mark.slow
def test_gradients_are_finite_and_those_of_the_fit(grid, model) -> None:
    truth = Sources(jnp.array([[3 * MM, -5 * MM]]), jnp.array([0.9]), jnp.array([0.0]))

    def place(at):
        signal = mutual_signal(model, Sources(at[None], truth.shield, truth.coupling))
        return fit_sources(model, SPLITTING, nothing_known(model, 2), signal, ALL).sources.place_m[0]

    for jacobian in (jax.jacfwd, jax.jacrev):
        shift = jax.jit(jacobian(place))(truth.place_m[0])
        np.testing.assert_allclose(shift, np.eye(2), atol=1e-3)

    def total(counts):
        _, seen = mutual_update(grid, settled, jnp.asarray(0.01), counts)
        return jnp.sum(seen.tracks.place_m) + jnp.sum(seen.tracks.shield)

    rest = BED.counts_of(0.01 * np.arange(50), np.zeros((50, 4, 4))).astype(float)
    settled = mutual_init(grid)
    settled = eqx.tree_at(
        lambda s: (s.array.baseline_counts, s.array.baseline_frames),
        settled,
        (jnp.asarray(rest.mean(axis=0)), jnp.full(16, 50)),
    )
    under = BED.counts_of(np.zeros(1), BED.field.change([Thing((2 * MM, 1 * MM))])[None])[0].astype(float)
    for counts in (rest[-1], under):
        assert np.all(np.isfinite(jax.jit(jax.grad(total))(jnp.asarray(counts))))


def test_a_frame_is_compiled_once(grid) -> None:
    traced = []

    @jax.jit
    def update(state, counts):
        traced.append(1)
        return mutual_update(grid, state, jnp.asarray(0.01), counts)[0]

    state = mutual_init(grid)
    for things in ([], [], [Thing((0.0, 0.0))], [Thing((0.0, 0.0), 0.0, 3.0)], []):
        state = update(state, jnp.asarray(BED.counts(np.zeros(1), [things])[0], float))
    assert len(traced) == 1


def test_the_assignment_is_the_best_of_all() -> None:
    from scipy.optimize import linear_sum_assignment

    rng = np.random.default_rng(0)
    for _ in range(20):
        cost = rng.random((4, 4))
        np.testing.assert_array_equal(optimal_assignment(jnp.asarray(cost)), linear_sum_assignment(cost)[1])
    with pytest.raises(ConfigError, match="9 touches at once: give a number from 1 to 5"):
        tracks_init(9)


def test_shielding_lowers_and_coupling_raises_one_reading(model) -> None:
    model = eqx.tree_at(lambda m: m.crosstalk, model, jnp.zeros(()))
    at = jnp.array([[-8 * MM, -8 * MM]] * 2)
    drop, rise = np.asarray(source_signals(model, Sources(at, jnp.array([1.0, 0.0]), jnp.array([0.0, 1.0]))))
    whole = float(model.contact_counts * model.gain[1, 1])
    assert drop.min() == pytest.approx(-whole) and rise.max() == pytest.approx(whole)
    # Shielding reaches further, and further still from a distance.
    assert np.all(np.abs(drop) >= rise)
    far = np.asarray(source_signals(model, Sources(at[:1], jnp.array([0.3]), jnp.zeros(1))))[0]
    assert far.min() == pytest.approx(0.3 * drop.min()) and np.all(far <= 0.3 * drop + 1e-9)


def test_crosstalk_is_what_cells_show_of_the_others_on_their_lines(model) -> None:
    assert float(model.crosstalk) == pytest.approx(BED.field.crosstalk, rel=0.05)
    thing = Sources(jnp.array([[3 * MM, -5 * MM]]), jnp.ones(1), jnp.zeros(1))
    alike = eqx.tree_at(lambda m: m.gain, model, jnp.ones((4, 4)))
    own = eqx.tree_at(lambda m: m.crosstalk, alike, jnp.zeros(()))
    shown = replace(BED.field, crosstalk=float(model.crosstalk)).with_crosstalk(
        np.asarray(mutual_signal(own, thing))
    )
    np.testing.assert_allclose(mutual_signal(alike, thing), shown)


def both_at_once(height: float) -> Things:
    """Two fingers 20 mm apart that wait at a height, come down together, and press with 6 and 3 N."""

    def now(t: float) -> list[Thing]:
        gap = float(np.interp(t, [0.5, 1.2], [height, 0.0]))
        press = float(np.interp(t, [1.5, 2.5], [0.0, 1.0]))
        return [
            Thing((-10 * MM, 5 * MM), gap, 6.0 * press),
            Thing((10 * MM, 5 * MM), gap, 3.0 * press),
        ]

    return now


@pytest.mark.parametrize("height", [20e-3, 60e-3])
def test_two_that_come_down_together_and_press_stay_apart(height, seen_under) -> None:
    """They look like one from above; from 60 mm they are part of the baselines already."""
    tracks = seen_under(both_at_once(height)).tracks
    for k in (150, 200, 250, 290):
        places = places_of(tracks, k)
        assert len(places) == 2
        found = np.array(sorted(map(tuple, places.values())))
        np.testing.assert_allclose(found, [[-10, 5], [10, 5]], atol=1.0)
        (pressed,) = np.nonzero(np.asarray(tracks.touching[k]))
        sigma = 1e3 * np.asarray(tracks.place_sigma_m[k])[pressed]
        assert np.all(sigma > 0.1) and np.all(sigma < 1.5)


def test_a_firm_touch_that_slides_is_followed(seen_under) -> None:
    def sliding(t: float) -> list[Thing]:
        press = pressed((0.0, 0.0), 0.3, 4.0)(t)
        way = float(np.interp(t, [1.05, 1.45], [0.0, 12.0])) * MM
        return [Thing((-6 * MM + way, 6 * MM), each.distance, each.force) for each in press]

    tracks = seen_under(sliding).tracks
    for k, x in ((100, -6.0), (149, 6.0)):
        ((_, place),) = places_of(tracks, k).items()
        np.testing.assert_allclose(place, [x, 6.0], atol=1.5)


def test_the_spread_of_a_place_is_that_of_its_noise(model) -> None:
    """Of images that differ from the model by nothing but noise of the size that is promised."""
    place = jnp.array([[3 * MM, -5 * MM]])
    exact = source_signals(model, Sources(place, jnp.ones(1), jnp.zeros(1)))[0].reshape(4, 4)
    noise = float(jnp.hypot(model.noise_counts, model.model_error * jnp.max(jnp.abs(exact))))
    rng = np.random.default_rng(3)
    fit = jax.jit(lambda image: fit_sources(model, SPLITTING, nothing_known(model, 4), image, ALL))
    off, sigma = [], []
    for _ in range(60):
        found = fit(exact + noise * rng.normal(size=(4, 4)))
        (there,) = np.flatnonzero(found.there)
        off.append(found.sources.place_m[there] - place[0])
        sigma.append(found.place_sigma_m[there])
    ratio = np.std(np.array(off), axis=0) / np.mean(np.array(sigma), axis=0)
    assert np.all((ratio > 0.7) & (ratio < 1.3)), ratio
