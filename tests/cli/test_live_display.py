"""What the terminal and the live view say of an estimate, with what frames up to it say beside it."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from rich.console import Console

from softfuse.cli.live_display import LiveDisplay
from softfuse.estimation.smoothing.smoother import Smoothed
from softfuse.estimation.stream import Estimate
from softfuse.estimation.tracked import Tracked
from softfuse.functional.chart import facing
from softfuse.hardware.live.pipeline import Pipeline
from softfuse.hardware.live.session import Published, Session
from softfuse.hardware.stream import HostClock
from softfuse.mechanics.solution import State
from softfuse.report.columns import smoothed_columns, smoothed_values
from softfuse.report.live import in_words
from softfuse.sensors.status import Status

NOTHING, CALM = np.zeros(4), np.zeros(4, bool)


def smoothed(forces: list[float], sigmas: list[float], places_mm: list[list[float]]) -> Smoothed:
    """Contacts with such forces, of these standard deviations, at such places, known to 0.04 mm."""
    location = 1e-3 * np.array(places_mm)
    outlying = np.zeros(len(forces), bool)
    return Smoothed(
        0.0,
        np.array(forces),
        np.diag(np.square(sigmas)),
        location,
        np.where(np.isnan(location), np.nan, 4e-5),
        *(NOTHING, NOTHING, CALM, outlying),
    )


@pytest.fixture
def published() -> Published:
    place = np.array([[1e-2, -6e-3, 0.018]])
    tracked = Tracked(
        0.0,
        np.array([True]),
        place,
        np.full((1, 2), 1e-4),
        np.array([4.9]),
        np.array([[0.04]]),
        facing(place, (0.0, 0.0, -1.0)),
        np.zeros((1, 1)),
        *(np.zeros(0), NOTHING, NOTHING, ~CALM, NOTHING, None, None, (Status.ok,), 0.0),
    )
    state = State(*[jnp.zeros(0)] * 4)
    estimate = Estimate(tracked, smoothed([4.97], [0.12], [[10.1, -6.0, 18.0]]), state)
    return Published(0, 0.0, {}, estimate, {}, 0.0)


def shown(newest: Published) -> str:
    class Idle:
        def follow(self, frames): ...

        def fields(self, now): ...

    clock = HostClock()
    display = LiveDisplay(clock, ("thumb",))
    session = Session(Pipeline((), []), Idle(), clock)  # type: ignore[arg-type]
    display.publish(newest)
    console = Console(width=120)
    with console.capture() as captured:
        console.print(display.drawn(session))
    return captured.get()


def test_filtered_frames_are_beside_the_single_one(published: Published) -> None:
    text = shown(published)
    assert "thumb" in text and "4.90 N at (10.0, -6.0, 18.0) mm" in text
    told = "4.97 ± 0.12 N at (10.1 ± 0.0, -6.0 ± 0.0, 18.0 ± 0.0) mm"
    assert told in text
    assert in_words(published, ("thumb",)) == f"ok\nthumb, filtered: {told}"


def test_frames_that_say_nothing_together_show_nothing_of_it(published: Published) -> None:
    alone = replace(published, estimate=published.estimate._replace(smoothed=None))
    assert "filtered" not in shown(alone) and in_words(alone, ("thumb",)) == "ok"


def test_columns_are_those_of_each_contact_and_values_follow_them() -> None:
    both = smoothed([3.0, 0.0], [0.1, 0.0], [[1.0, 2.0, 3.0], [np.nan] * 3])
    names = [column.name for column in smoothed_columns(("a0", "a1"), "filtered_")]
    told = dict(zip(names, smoothed_values(both, 2), strict=True))
    assert told["filtered_a0_force_sigma_N"] == pytest.approx(0.1)
    assert told["filtered_a0_y_mm"] == pytest.approx(2.0)
    assert told["filtered_a0_x_sigma_mm"] == pytest.approx(0.04)
    assert told["filtered_a1_force_N"] == 0.0 and np.isnan(told["filtered_a1_x_mm"])
    assert [column.name for column in smoothed_columns(("a",), "")][:4] == ["x_mm", "y_mm", "z_mm", "force_N"]
    assert np.isnan(smoothed_values(None, 1)).all() and len(smoothed_values(None, 1)) == 8
