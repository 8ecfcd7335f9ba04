"""What the terminal and the live view say of an estimate, with what frames say together beside it."""

from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from softfuse.cli.joined_readout import joined_columns, joined_values
from softfuse.cli.live_display import LiveDisplay
from softfuse.estimation.tracked import Tracked
from softfuse.fusion.fusion import Fused
from softfuse.hardware.live.pipeline import Pipeline
from softfuse.hardware.live.session import Published, Session
from softfuse.hardware.stream import HostClock
from softfuse.sensors.status import Status

NOTHING, CALM = np.zeros(4), np.zeros(4, bool)


def fused(forces: list[float], sigmas: list[float], places_mm: list[list[float]]) -> Fused:
    """Contacts with such forces, of these standard deviations, at such places, known to 0.04 mm."""
    location = 1e-3 * np.array(places_mm)
    outlying = np.zeros(len(forces), bool)
    return Fused(
        0.0,
        np.array(forces),
        np.diag(np.square(sigmas)),
        location,
        np.where(np.isnan(location), np.nan, 4e-5),
        *(NOTHING, NOTHING, CALM, outlying),
    )


@pytest.fixture
def published() -> Published:
    tracked = Tracked(
        0.0,
        np.array([True]),
        np.array([[1e-2, -6e-3, 0.018]]),
        np.full((1, 2), 1e-4),
        np.array([4.9]),
        np.array([[0.04]]),
        np.zeros((1, 3, 3)),
        np.zeros((1, 1)),
        *(np.zeros(0), NOTHING, NOTHING, NOTHING, None, None, (Status.ok,), 0.0),
    )
    return Published(0, 0.0, {}, tracked, fused([4.97], [0.12], [[10.1, -6.0]]), {}, 0.0)


def shown(newest: Published) -> str:
    class Idle:
        def sense(self, frame, start_s): ...

        def estimate(self): ...

    clock = HostClock()
    display, session = LiveDisplay(clock), Session(Pipeline((), []), Idle(), clock)  # type: ignore[arg-type]
    display.publish(newest)
    console = Console(width=120)
    with console.capture() as captured:
        console.print(display.drawn(session))
    return captured.get()


def test_joined_frames_are_beside_the_single_one(published: Published) -> None:
    text = shown(published)
    assert "4.90 N at (10.0, -6.0, 18.0) mm" in text
    assert "4.97 ± 0.12 N at (10.1 ± 0.0, -6.0 ± 0.0) mm" in text


def test_frames_that_say_nothing_together_show_nothing_of_it(published: Published) -> None:
    assert "joined" not in shown(replace(published, joined=None))


def test_columns_are_those_of_each_contact_and_values_follow_them() -> None:
    both = fused([3.0, 0.0], [0.1, 0.0], [[1.0, 2.0], [np.nan, np.nan]])
    names = [column.name for column in joined_columns(2, "joined_")]
    told = dict(zip(names, joined_values(both), strict=True))
    assert told["joined_contact0_force_sigma_N"] == pytest.approx(0.1)
    assert told["joined_contact0_y_mm"] == pytest.approx(2.0)
    assert told["joined_contact0_x_sigma_mm"] == pytest.approx(0.04)
    assert told["joined_contact1_force_N"] == 0.0 and np.isnan(told["joined_contact1_x_mm"])
    assert [column.name for column in joined_columns(1)][:3] == ["force_N", "force_sigma_N", "x_mm"]
