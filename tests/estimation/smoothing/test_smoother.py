"""Frames smoothed over time: forces that are held, moved and let go while the zeros of four sensors drift.

Readings are linear in the force here, with errors of the model and of the sensors drawn as promised, so that
what must come out is known.
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from compilations import compilations
from made_sensors import d6f_p0001a1
from made_touches import DRIFT, DT, Made, W, frame, made, of, placed, smoother

from softfuse.errors import SoftfuseError
from softfuse.estimation.smoothing.force_filter import ForceFilter
from softfuse.estimation.smoothing.process import Process
from softfuse.estimation.smoothing.smoother import Smoothed, Smoother, smoothed_recording
from softfuse.estimation.tracked import Tracked
from softfuse.functional.chart import moved
from softfuse.functional.workspace import framed
from softfuse.sensors.zero_drift import DriftModel, ReadingDrift

SENSOR = d6f_p0001a1(4)

HELD = np.concatenate([np.linspace(0.2, 3.0, 15), np.full(450, 3.0), np.zeros(6)])
"""A force that rises, is held for 45 s, and let go."""


@pytest.fixture(scope="module")
def held() -> list[tuple[Made, list[Smoothed], list[Smoothed]]]:
    """Forty such touches, filtered and smoothed."""
    rng = np.random.default_rng(0)
    return [
        (each, *smoothed_recording(smoother(), each.found)) for each in (made(HELD, rng) for _ in range(40))
    ]


def test_held_forces_are_told_better_the_more_frames_tell(held) -> None:
    # How the force has gone since the hold began, which it has not.
    begun, ended = 30, 460

    def gone(frames) -> float:
        return float(np.sqrt(np.mean([(of(each)[ended] - of(each)[begun]) ** 2 for each in frames])))

    single, filtered, whole = (
        gone(frames)
        for frames in ([m.found for m, *_ in held], [j for _, j, _ in held], [w for *_, w in held])
    )
    assert filtered < 0.8 * single and whole < 0.8 * filtered

    def off(frames) -> float:
        return float(np.sqrt(np.mean([(of(each)[ended] - 3.0) ** 2 for each in frames])))

    single, filtered, whole = (
        off(frames)
        for frames in ([m.found for m, *_ in held], [j for _, j, _ in held], [w for *_, w in held])
    )
    assert whole < filtered < single


@pytest.mark.parametrize("at", [100, 300, 460])
def test_forces_are_as_sure_as_promised(held, at: int) -> None:
    for frames in ([j for _, j, _ in held], [w for *_, w in held]):
        off = np.array([(each[at].force_N - 3.0) / each[at].force_sigma_N for each in frames])
        # Of 40 touches to 99 % below 1.29; and low, as they might have moved a little, which they did not.
        assert 0.5 <= np.sqrt(np.mean(off**2)) <= 1.29


def test_drift_is_as_sure_as_promised(held) -> None:
    off = np.array([(w[460].drift - m.drift[460]) / w[460].drift_sigma for m, _, w in held])
    assert 0.8 <= np.mean(np.abs(off) < 1.645) <= 0.99
    sigma = np.array(
        [[each[460].drift_sigma for each in frames] for frames in zip(*[h[1:] for h in held], strict=True)]
    )
    assert np.all(sigma[1] < 0.7 * sigma[0])


@pytest.fixture(scope="module")
def seen_elsewhere() -> list[tuple[Made, list[Smoothed], list[Smoothed]]]:
    """Thirty touches of contacts that are seen a bit elsewhere, filtered and smoothed."""
    rng = np.random.default_rng(13)
    touches = [placed(made(HELD[:150], rng), rng) for _ in range(30)]
    return [(each, *smoothed_recording(smoother(), each.found)) for each in touches]


@pytest.mark.parametrize("at", [40, 140])
def test_places_that_are_not_known_make_forces_unsure(seen_elsewhere, at: int) -> None:
    for frames in ([j for _, j, _ in seen_elsewhere], [w for *_, w in seen_elsewhere]):
        off = np.array([(each[at].force_N - 3.0) / each[at].force_sigma_N for each in frames])
        # Of 30 touches to 99 % below 1.30.
        assert 0.5 <= np.sqrt(np.mean(off**2)) <= 1.30
    known = smoothed_recording(smoother(), made(HELD[:150], np.random.default_rng(14)).found)[0]
    sigma = np.mean([j[at].force_sigma_N for _, j, _ in seen_elsewhere])
    assert sigma > 1.03 * known[at].force_sigma_N


def test_places_that_are_seen_to_and_fro_do_not_move_a_force(seen_elsewhere) -> None:
    for each, filtered, _ in seen_elsewhere[:5]:
        evidence = [now.evidence for now in each.found[100:140]]
        taken = [e.compliance[0, 0] * e.drive[0] + e.misfit[0] for e in evidence if e is not None]
        # From frame to frame, as a part of the force and of its reading.
        gone = np.std(np.diff(of(filtered)[100:140])) / 3.0
        assert gone < 0.2 * np.std(np.diff(taken)) / 75e-9


def test_the_same_error_of_the_model_tells_drift_once() -> None:
    # Taken for wrong in a new way at each of many levels, the model would tell drift again and again.
    levels = np.repeat(np.linspace(3.0, 5.0, 16), 11)
    held_at_once, rng = np.full(levels.shape, levels[-1]), np.random.default_rng(15)
    sigmas = []
    for force in (levels, held_at_once):
        risen = np.append(np.linspace(0.2, 2.9, 10), force)
        ends = [smoothed_recording(smoother(), made(risen, rng).found[:-1])[0][-1] for _ in range(4)]
        sigmas.append(np.mean([each.drift_sigma for each in ends], axis=0))
    assert np.all(sigmas[0] > 0.99 * sigmas[1])


def test_a_force_that_moves_is_followed_at_once() -> None:
    force = np.concatenate(
        [np.linspace(0.2, 2.0, 10), np.full(50, 2.0), np.linspace(2.1, 6.0, 20), np.full(5, 6.0)]
    )
    each = made(force, np.random.default_rng(1))
    filtered, _ = smoothed_recording(smoother(), each.found)
    np.testing.assert_allclose(of(filtered)[:-1], of(each.found)[:-1], rtol=0.05, atol=0.1)


def test_a_reading_that_jumps_is_an_outlier_and_moves_no_force() -> None:
    jumps = np.zeros((len(HELD), 4))
    jumps[200, 3] = 40e-9
    each = made(HELD, np.random.default_rng(2), jumps)
    filtered, whole = smoothed_recording(smoother(), each.found)
    assert [k for k, f in enumerate(filtered) if f.outlier.any()] == [200]
    assert filtered[200].outlier.tolist() == [False, False, False, True]
    before = filtered[199].force_N
    assert abs(filtered[205].force_N - before) < 0.05
    assert abs(each.found[205].force_N - before) > 0.1
    assert abs(whole[150].force_N - whole[250].force_N) < 0.05


def test_a_reading_that_jumps_while_the_force_moves_is_off_by_what_the_others_leave() -> None:
    jumps = np.zeros((len(HELD), 4))
    # As much as the force has made of it, so that it reads nothing.
    jumps[10, 3] = -W[3, 0] * HELD[10]
    each = made(HELD, np.random.default_rng(16), jumps)
    filtered, _ = smoothed_recording(smoother(), each.found)
    assert [k for k, f in enumerate(filtered[:40]) if f.outlier.any()] == [10]
    sigma = filtered[10].drift_sigma[3]
    assert 0.5 < sigma / -jumps[10, 3] < 2.0
    assert abs(filtered[10].drift[3] - each.drift[10, 3]) < 2 * sigma


def test_what_says_nothing_is_borne() -> None:
    each = made(HELD[:100], np.random.default_rng(3))
    clean, _ = smoothed_recording(smoother(), each.found)
    faulty = list(each.found)
    silent = faulty[50].evidence
    assert silent is not None
    faulty[50] = replace(faulty[50], evidence=replace(silent, misfit=np.full(4, np.nan)))
    faulty[60] = replace(faulty[60], evidence=None)
    acting = np.zeros(1, bool)
    faulty[70] = replace(faulty[70], evidence=replace(silent, acting=acting, drive=np.zeros(1)))
    faulty[80] = replace(faulty[80], time_s=np.nan)
    filtered, whole = smoothed_recording(smoother(), faulty)
    # Without evidence a force is not known, but no longer than that.
    for frames in (filtered, whole):
        assert np.flatnonzero(np.isnan(of(frames))).tolist() == [60, 70]
        assert np.isnan(frames[60].force_sigma_N)
    np.testing.assert_allclose(of(filtered)[81:100], of(clean)[81:100], atol=0.1)
    # Nor is the model taken for exact thereafter.
    assert filtered[61].force_sigma_N > 0.95 * clean[61].force_sigma_N


def test_a_contact_that_is_lost_sight_of_is_no_release() -> None:
    each = made(HELD, np.random.default_rng(8))
    lost = list(each.found)
    unseen = lost[200].evidence
    assert unseen is not None
    still = unseen.drift._replace(calm=np.ones(4, bool))
    lost[200] = frame(lost[200].time_s, lost[200].reading, np.zeros((4, 4)), still, 0.0)
    filtered, whole = smoothed_recording(smoother(), lost)
    for frames in (filtered, whole):
        assert frames[200].force_N == 0.0
        np.testing.assert_allclose(of(frames)[201:400], of(each.found)[201:400], atol=0.4)
        np.testing.assert_allclose(of(frames)[150:199], 3.0, atol=0.4)


def test_a_touch_that_follows_at_once_begins_anew() -> None:
    rng = np.random.default_rng(9)
    first, second = made(HELD, rng), made(HELD[:150], rng)
    # The last frame of the first, in which the sensors began anew, was not estimated.
    follows = [replace(f, time_s=f.time_s + DT * len(HELD)) for f in second.found]
    filtered, _ = smoothed_recording(smoother(), [*first.found[:-1], *follows])
    alone, _ = smoothed_recording(smoother(), second.found)
    np.testing.assert_allclose(of(filtered)[len(HELD) :], of(alone), atol=1e-6)


def test_a_creeping_force_is_told_from_drift() -> None:
    # Too slow for any single frame to contradict stillness, but much faster than zeros drift.
    creep = np.concatenate([np.linspace(0.2, 2.0, 10), 2.0 + 0.2 * DT * np.arange(200)])
    each = made(creep, np.random.default_rng(10))
    filtered, whole = smoothed_recording(smoother(process=Process(still_N=0.2)), each.found)
    np.testing.assert_allclose(of(filtered)[100:-1], of(each.found)[100:-1], rtol=0.08)
    np.testing.assert_allclose(of(whole)[100:-1], of(each.found)[100:-1], rtol=0.08)


def test_a_contact_at_an_unknown_place_is_not_told() -> None:
    both = Smoother(ForceFilter(Process(), DRIFT, np.eye(2), np.full(2, 25.0)), keep=True)
    each = made(HELD[:50], np.random.default_rng(11)).found

    def two(now: Tracked, acts: bool) -> Tracked:
        assert now.evidence is not None
        wide = np.repeat(now.evidence.compliance, 2, axis=1) * [1.0, 0.5]
        evidence = replace(
            now.evidence,
            compliance=wide,
            drive=np.append(now.evidence.drive, 0.0),
            acting=np.array([True, acts]),
            place_m=np.tile(now.evidence.place_m, 2),
            by_place=np.tile(now.evidence.by_place, 2),
            seen_m=np.tile(now.evidence.seen_m, 2),
            seen_sigma_m=np.tile(now.evidence.seen_sigma_m, 2),
        )
        pairs = {
            name: np.repeat(getattr(now, name), 2, axis=0)
            for name in ("location_m", "location_sigma_m", "places")
        }
        return replace(now, touching=np.array([True, True]), evidence=evidence, **pairs)

    filtered = [both.update(two(now, k != 30)) for k, now in enumerate(each[:-1])]
    assert np.isnan(filtered[30].contact_force_N).all()
    assert all(np.isfinite(f.contact_force_N).all() for k, f in enumerate(filtered) if k != 30)


def test_live_frames_are_joined_as_recorded_ones() -> None:
    each = made(HELD[:200], np.random.default_rng(4))
    live = smoother(keep=False)
    found = [live.update(now) for now in each.found]
    filtered, _ = smoothed_recording(smoother(), each.found)
    np.testing.assert_array_equal(of(found), of(filtered))
    assert live.ended == [] and live.finish() == []


def test_nothing_is_compiled_while_frames_come() -> None:
    each = made(HELD[:40], np.random.default_rng(12)).found
    jax.clear_caches()
    live = smoother(keep=False)
    with compilations() as events:
        # Times may be any kind of number.
        for k, now in enumerate(each):
            live.update(replace(now, time_s=np.float64(now.time_s)) if k % 2 else now)
    assert events == []


def test_nothing_touches() -> None:
    each = made(np.zeros(5), np.random.default_rng(5))
    filtered, whole = smoothed_recording(smoother(), each.found)
    assert not of(filtered).any() and not of(whole).any()
    assert all(np.isnan(f.location_m).all() for f in filtered)


def test_readings_that_do_not_drift_tell_of_the_force_all_the_same() -> None:
    """A fifth reading, of another unit, that is as noisy as it says; gas that was sealed in is no unknown."""
    each, rng = made(HELD, np.random.default_rng(17)), np.random.default_rng(18)
    slope, sigma = 1e3, 30.0
    drift = DriftModel.joined([DRIFT, None], [4, 1])
    ranges = np.array([25.0, 0.0])
    both = Smoother(ForceFilter(Process(), drift, np.ones((1, 1)), ranges), keep=True)
    assert both.drifting.tolist() == [True] * 4 + [False]
    frames = []
    for force, now in zip(each.force, each.found, strict=True):
        evidence = now.evidence
        assert evidence is not None
        said = slope * force + sigma * rng.normal()
        drive = np.append(evidence.drive, 101325.0)
        row = np.array([[slope if force > 0 else 0.0, 0.01]])
        wide = np.append(np.append(evidence.compliance, np.zeros((4, 1)), axis=1), row, axis=0)
        told = ReadingDrift(
            jnp.append(evidence.drift.covariance, jnp.zeros((1, 3, 3)), axis=0),
            jnp.append(evidence.drift.calm, False),
            evidence.drift.period_s,
        )
        more = replace(
            evidence,
            misfit=np.append(evidence.misfit, said - slope * evidence.drive[0]),
            sigma=np.append(evidence.sigma, sigma),
            drive=drive,
            compliance=wide,
            by_place=np.append(evidence.by_place, np.zeros((1, 2)), axis=0),
            acting=np.append(evidence.acting, False),
            model=np.pad(evidence.model, ((0, 1), (0, 1))),
            drift=told,
        )
        reading = np.append(now.reading, said)
        frames.append(replace(now, evidence=more, reading=reading, attached=drive[1:]))
    alone, _ = smoothed_recording(smoother(), each.found)
    filtered, whole = smoothed_recording(both, frames)
    held = slice(100, 460)
    assert all(
        now.force_sigma_N < 0.5 * one.force_sigma_N
        for now, one in zip(filtered[held], alone[held], strict=True)
    )
    # Of 3 N; of 360 readings a standard deviation of 30 / 1000 N is left by the model's small error alone.
    np.testing.assert_allclose(of(whole)[held], 3.0, atol=0.05)
    assert all(now.drift[4] == 0 and now.drift_sigma[4] == 0 for now in whole)
    assert sum(now.outlier.any() for now in filtered) < 5


def test_a_place_on_a_slope_is_followed_in_its_plane() -> None:
    normal = np.array([1.0, 0.0, 1.0]) / np.sqrt(2)
    (base,) = framed(np.array([[5e-3, 0.0, 1e-2]]), normal[None])
    rng, frames = np.random.default_rng(19), []
    for now in made(HELD[:60], np.random.default_rng(20)).found[:-1]:
        at = base[0] + 1e-4 * rng.normal(size=2) @ base[1:]
        frames.append(replace(now, location_m=at[None], places=moved(base, np.zeros(2))[None]))
    found, _ = smoothed_recording(smoother(), frames)
    last = found[50]
    assert abs((last.location_m[0] - base[0]) @ normal) < 1e-9
    assert np.linalg.norm(last.location_m[0] - base[0]) < 1e-4
    # Along x and z it is the same slope.
    np.testing.assert_allclose(last.location_sigma_m[0, 0], last.location_sigma_m[0, 2], rtol=1e-6)
    assert last.location_sigma_m[0, 1] > 0


def test_a_robot_whose_readings_do_not_drift_is_refused() -> None:
    class Pressed:
        drift = None

    with pytest.raises(SoftfuseError, match="nothing to smooth"):
        Smoother.of(Pressed())  # type: ignore[arg-type]
