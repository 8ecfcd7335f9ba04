"""The place of a contact over time: jitter, glitches and true moves."""

import numpy as np

from softfuse.estimation.smoothing.place_filter import PlaceStep, begun, gone_on, place
from softfuse.estimation.smoothing.process import Process

PROCESS = Process()
SIGMA = np.full(2, 1e-4)
DT = 0.01


def followed(seen: np.ndarray) -> list[PlaceStep]:
    steps = [begun(PROCESS, seen[0], SIGMA)]
    for each in seen[1:]:
        steps.append(gone_on(PROCESS, steps[-1], DT, each, SIGMA))
    return steps


def where(steps: list[PlaceStep]) -> np.ndarray:
    return np.array([place(each.step.known)[0] for each in steps])


def test_jitter_is_averaged_but_not_what_lasts() -> None:
    rng = np.random.default_rng(0)
    white = np.sqrt(PROCESS.white) * SIGMA * rng.normal(size=(300, 2))
    steps = followed(white)
    assert not any(each.outlier for each in steps)
    assert where(steps)[100:].std() < 0.6 * white[100:].std()
    sigma = place(steps[-1].step.known)[1]
    np.testing.assert_allclose(sigma, np.sqrt(1 - PROCESS.white) * SIGMA, rtol=0.05)


def test_a_glitch_is_not_believed() -> None:
    seen = np.zeros((50, 2))
    seen[20:23, 0] = 5e-3
    steps = followed(seen)
    assert [k for k, each in enumerate(steps) if each.outlier] == [20, 21, 22]
    assert np.abs(where(steps)).max() < 1e-5


def test_a_contact_that_went_elsewhere_is_followed() -> None:
    seen = np.zeros((50, 2))
    seen[20:, 1] = 5e-3
    found = where(followed(seen))[:, 1]
    late = 21 + round(PROCESS.patience_s / DT)
    assert np.abs(found[:20]).max() < 1e-5
    np.testing.assert_allclose(found[late:], 5e-3, atol=1e-4)


def test_a_contact_that_slides_is_followed() -> None:
    seen = np.zeros((100, 2))
    seen[20:, 0] = np.minimum(20e-3 * DT * np.arange(80), 10e-3)
    steps = followed(seen)
    assert not any(each.outlier for each in steps)
    np.testing.assert_allclose(where(steps)[30:, 0], seen[30:, 0], atol=1e-4)


def test_a_frame_that_sees_nothing_leaves_it_where_it_is() -> None:
    seen = np.zeros((10, 2))
    seen[5] = np.nan
    steps = followed(seen)
    np.testing.assert_allclose(where(steps), 0.0, atol=1e-12)
    assert place(steps[5].step.known)[1][0] >= place(steps[4].step.known)[1][0]
