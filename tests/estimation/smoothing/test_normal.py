"""Normal distributions in time, against all frames solved at once."""

import numpy as np
import pytest

from softfuse.estimation.smoothing.normal import Change, Normal, Reading, Step, smoothed

SIZE, FRAMES = 3, 12


def random_steps(rng: np.random.Generator) -> tuple[Normal, list[tuple[Change, Reading]]]:
    """A start, and changes and readings of some frames, one of which has no reading and one no noise."""
    root = rng.normal(size=(SIZE, SIZE))
    start = Normal(rng.normal(size=SIZE), root @ root.T)
    steps = []
    for k in range(FRAMES):
        noise = np.diag(rng.uniform(0.0, 0.5, SIZE)) if k != 4 else np.zeros((SIZE, SIZE))
        change = Change(np.eye(SIZE) + 0.2 * rng.normal(size=(SIZE, SIZE)), noise)
        numbers = 0 if k == 7 else 2
        rows = rng.normal(size=(numbers, SIZE))
        steps.append((change, Reading(rng.normal(size=numbers), rows, rng.uniform(0.1, 1.0, numbers))))
    return start, steps


def filtered(start: Normal, steps: list[tuple[Change, Reading]]) -> list[Step]:
    found, known = [], start
    for change, reading in steps:
        expected = known.gone_on(change)
        known = expected.updated(reading)
        found.append(Step(change, expected, known))
    return found


def at_once(start: Normal, steps: list[tuple[Change, Reading]]) -> tuple[np.ndarray, np.ndarray]:
    """Means (f, n) and covariances (f, n, n) of all frames by conditioning their joint distribution."""
    mean, blocks, now = [], np.zeros((FRAMES * SIZE, FRAMES * SIZE)), start
    for k, (change, _) in enumerate(steps):
        here = slice(k * SIZE, (k + 1) * SIZE)
        if k:
            before = slice((k - 1) * SIZE, k * SIZE)
            blocks[here, : k * SIZE] = change.transition @ blocks[before, : k * SIZE]
            blocks[: k * SIZE, here] = blocks[here, : k * SIZE].T
        now = now.gone_on(change)
        blocks[here, here] = now.covariance
        mean.append(now.mean)
    rows = np.zeros((sum(len(r.value) for _, r in steps), FRAMES * SIZE))
    value, sigma, at = [], [], 0
    for k, (_, reading) in enumerate(steps):
        rows[at : at + len(reading.value), k * SIZE : (k + 1) * SIZE] = reading.rows
        at += len(reading.value)
        value += reading.value.tolist()
        sigma += reading.sigma.tolist()
    whole = Normal(np.concatenate(mean), blocks).updated(Reading(np.array(value), rows, np.array(sigma)))
    covariances = [whole.covariance[k : k + SIZE, k : k + SIZE] for k in range(0, FRAMES * SIZE, SIZE)]
    return whole.mean.reshape(FRAMES, SIZE), np.array(covariances)


@pytest.mark.parametrize("seed", range(3))
def test_smoothing_is_what_all_readings_say_at_once(seed: int) -> None:
    start, steps = random_steps(np.random.default_rng(seed))
    found = smoothed(filtered(start, steps))
    mean, covariance = at_once(start, steps)
    np.testing.assert_allclose([each.mean for each in found], mean, atol=1e-9)
    np.testing.assert_allclose([each.covariance for each in found], covariance, atol=1e-9)


def test_what_is_considered_stays_but_matters() -> None:
    rng = np.random.default_rng(3)
    start, steps = random_steps(rng)
    reading = steps[0][1]
    told = start.updated(reading, considered=slice(2, 3))
    np.testing.assert_allclose(told.mean[2], start.mean[2])
    np.testing.assert_allclose(told.covariance[2, 2], start.covariance[2, 2])
    whole = start.updated(reading)
    # Less is learnt of the others than if it were, and more stays open than if it were known.
    assert np.all(np.linalg.eigvalsh(told.covariance - whole.covariance) > -1e-12)
    # The covariance is that of the errors that occur.
    truth = rng.multivariate_normal(start.mean, start.covariance, 200_000)
    value = truth @ reading.rows.T + reading.sigma * rng.normal(size=(len(truth), 2))
    across = start.covariance @ reading.rows.T
    gain = across @ np.linalg.inv(reading.rows @ across + np.diag(reading.sigma**2))
    gain[2] = 0.0
    off = start.mean + (value - start.mean @ reading.rows.T) @ gain.T - truth
    np.testing.assert_allclose(np.cov(off.T), told.covariance, atol=0.03 * np.abs(told.covariance).max())


def test_nothing_to_smooth() -> None:
    assert smoothed([]) == []
