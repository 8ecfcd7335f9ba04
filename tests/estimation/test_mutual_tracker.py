"""Two fingers on a pad under a grid of mutual capacitances, from counts and volts to two forces.

Counts are those of a virtual grid, volts those of the flow that the volumes of the same coarse body drive
out: tested is the way from readings to contacts, not the mesh.
"""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from compilations import compilations
from made_sensors import d6f_p0001a1

from softfuse.estimation.tracked import Frame, Tracked
from softfuse.estimation.tracker import Tracker
from softfuse.experiment.paper.mutual_bed import MutualBed
from softfuse.functional.chart import facing
from softfuse.mechanics.dense import Dense
from softfuse.mechanics.model import Model, simulate
from softfuse.mechanics.solution import RESULTS
from softfuse.robot.file import load
from softfuse.robot.robot import build_robot
from softfuse.sensors.mutual.field import Thing
from softfuse.sensors.status import Status

CONFIG = Path(__file__).parents[2] / "configs" / "pad_mutual.toml"
COARSE = (
    ('surface_size = "12 mm"', 'surface_size = "30 mm"'),
    ('base_size = "12 mm"', 'base_size = "28 mm"'),
    ('fine_depth = "3 mm"', 'fine_depth = "0 mm"'),
    ('element = "taylor-hood" ', 'element = "linear" '),
    # With a high Poisson's ratio linear elements lock.
    ("poisson = 0.49", "poisson = 0.3"),
    # The cells of a punch are smaller than the triangles of this mesh.
    ('model = "punch"  ', 'model = "uniform"  '),
)
MM = 1e-3
ONE, OTHER = np.array([-14.0, -19.0]), np.array([18.0, 12.0])
FORCES_N = (3.0, 4.0)
TIME = 0.01 * np.arange(740)


def heights_and_forces() -> tuple[np.ndarray, np.ndarray]:
    """Of both fingers (n, 2) in m and N: one stays; one hovers at 5 mm, touches, presses, leaves slowly."""
    one = np.interp(TIME, [0.8, 1.1], [40, 0]), np.interp(TIME, [1.4, 2.0], [0, FORCES_N[0]])
    other = (
        np.interp(TIME, [2.1, 2.2, 2.5, 2.6, 4.7, 6.7], [40, 5, 5, 0, 0, 40]),
        np.interp(TIME, [2.8, 3.4, 3.6, 4.6], [0, FORCES_N[1], FORCES_N[1], 0]),
    )
    return MM * np.stack([one[0], other[0]], axis=1), np.stack([one[1], other[1]], axis=1)


def volumes_of(model: Model, forces: np.ndarray) -> np.ndarray:
    """Volume changes (n, k) [m³] under both forces of each frame (n, 2)."""
    places = jnp.asarray(facing(MM * np.array([[*ONE, 0.0], [*OTHER, 0.0]]), (0, 0, -1)))
    levels, state = np.linspace(0.0, 1.0, 5), model.rest_state(places)

    def under(one, other):
        nonlocal state
        solution = simulate(model, places, jnp.array([one, other]), state)
        assert solution.result == RESULTS.converged
        state = solution.state
        return np.asarray(model.reading(state))

    alone = np.array([under(s * FORCES_N[0], 0.0) for s in levels])
    both = np.array([under(FORCES_N[0], s * FORCES_N[1]) for s in levels])
    part = forces / np.array(FORCES_N)
    return np.stack(
        [
            np.where(
                part[:, 1] > 0,
                np.interp(part[:, 1], levels, both[:, k]),
                np.interp(part[:, 0], levels, alone[:, k]),
            )
            for k in range(both.shape[1])
        ],
        axis=1,
    )


@pytest.fixture(scope="module")
def tracker(tmp_path_factory: pytest.TempPathFactory, calibrated_grid: Callable) -> Tracker:
    model = calibrated_grid(MutualBed(), 8 * MM)
    shape = {
        "contact_counts = 2000.0": f"contact_counts = {float(model.contact_counts)}",
        'depth = "1.5 mm"': f'depth = "{float(model.depth_m)} m"',
        'finger_radius = "8 mm"': f'finger_radius = "{float(model.finger_radius_m)} m"',
        "# gain = [...]": f"gain = {np.asarray(model.gain).T.ravel().tolist()}",
        "model_error = 0.015": f"model_error = {float(model.model_error)}",
    }
    text = CONFIG.read_text(encoding="utf-8")
    for old, new in (*COARSE, *shape.items()):
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path = tmp_path_factory.mktemp("pad") / "coarse.toml"
    path.write_text(text, encoding="utf-8")
    robot = build_robot(load(path))
    # Small as it is, a dense solver compiles soonest.
    model = replace(robot.model, linear=Dense.plan(robot.model.body))
    return Tracker(replace(robot, model=model))


@pytest.fixture(scope="module")
def found(tracker: Tracker) -> dict[int, Tracked]:
    """Every frame sensed, every tenth estimated; nothing is compiled meanwhile."""
    heights, forces = heights_and_forces()
    volume = volumes_of(tracker.estimator.model, forces)
    flow = -np.gradient(volume, TIME, axis=0)
    noise = np.random.default_rng(2).normal(0.0, 2e-3, flow.shape)
    sensor = d6f_p0001a1(len(flow.T))
    volts = np.asarray(sensor.zero_V) + np.asarray(sensor.sensitivity_Vs_m3) * flow + noise
    assert volts.max() < 2.5 and volts.min() > 0.0
    places = (tuple(MM * ONE), tuple(MM * OTHER))
    things = [
        [Thing(at, h, f) for at, h, f in zip(places, hs, fs, strict=True) if h < 40 * MM]
        for hs, fs in zip(heights, forces, strict=True)
    ]
    counts = MutualBed().counts(TIME, things).astype(float)
    tracked: dict[int, Tracked] = {}
    with ExitStack() as listening:
        waiting, events = listening.enter_context(compilations(beside=False)), []
        for k, t in enumerate(TIME):
            sensed = tracker.sense(Frame(t, np.concatenate([volts[k], counts[k]])))
            if k % 10 == 0:
                tracked[k] = tracker.estimate(t, sensed)
            if k == 150:  # one touch has been estimated, two have not: nothing is prepared beside any more
                events = listening.enter_context(compilations())
    assert waiting == [] and events == []
    return tracked


def numbers(now: Tracked) -> dict[int, int]:
    """Contact of each number that touches."""
    grid, slots = now.details["grid"].tracks, now.details["grid"].slots
    return {int(grid.number[slots.electrode[c]]): int(c) for c in np.flatnonzero(now.touching)}


def near(now: Tracked) -> list[np.ndarray]:
    """Places [mm] of what hovers."""
    grid = now.details["grid"].tracks
    return [1e3 * grid.place_m[j] for j in np.flatnonzero(grid.there & ~grid.touching)]


def test_a_hovering_finger_is_near_but_has_no_force(found: dict[int, Tracked]) -> None:
    assert found[70].statuses == (Status.no_contact,) and not near(found[70])
    for k in (230, 240, 250):
        now = found[k]
        (place,) = near(now)
        # A hovering finger's image is wider than it is modelled, by a few per cent.
        np.testing.assert_allclose(place, OTHER, atol=2.0)
        assert now.contacts == 1 and now.statuses == (Status.ok,)
        assert now.contact_force_N[1] == 0.0 and np.isnan(now.location_m[1]).all()


def test_light_touch_has_a_place_and_no_force(found: dict[int, Tracked]) -> None:
    now = found[130]
    assert now.contacts == 1
    np.testing.assert_allclose(1e3 * now.location_m[0, :2], ONE, atol=0.4)
    # A wandering zero of 0.4 mV integrates to 1 mm³ in 3 s; 3 N displace 130 mm³.
    np.testing.assert_allclose(now.force_N, 0.0, atol=0.05)


def test_two_fingers_have_two_places_and_two_forces(found: dict[int, Tracked]) -> None:
    for k in (340, 350, 360):
        now = found[k]
        assert now.contacts == 2 and now.statuses == (Status.ok,)
        # At 3 N coupling all but cancels shielding: what tells the place is a fifth of the effects, and the
        # model's error of 1.5 % of these is 7 % of it, on a flank that is 16 mm wide.
        np.testing.assert_allclose(1e3 * now.location_m[:, :2], [ONE, OTHER], atol=1.5)
        # 1 mm³ of drift, and 1 mm of place over cavities 28 mm wide.
        np.testing.assert_allclose(now.contact_force_N, FORCES_N, rtol=0.03)


def test_who_leaves_slowly_is_not_taken_for_one_who_presses(found: dict[int, Tracked]) -> None:
    # On the image alone, less shielding is more coupling: only that nothing flows tells them apart.
    for k in range(480, 740, 10):
        assert found[k].contact_force_N[1] < 0.05
    assert [found[k].contacts for k in (470, 560, 720)] == [2, 1, 1]
    assert len(near(found[560])) == 1 and near(found[720]) == []


def test_who_stays_keeps_number_and_contact(found: dict[int, Tracked]) -> None:
    alone, both, after = (numbers(found[k]) for k in (200, 350, 720))
    assert len(alone) == len(after) == 1 and len(both) == 2
    assert alone == after and alone.items() <= both.items()
    now = found[720]
    np.testing.assert_allclose(1e3 * now.location_m[0, :2], ONE, atol=1.5)
    # The place by as much over a cavity 28 mm wide, and the flow's zero by 2 mm³ in 6 s.
    np.testing.assert_allclose(now.contact_force_N, [FORCES_N[0], 0.0], rtol=0.05)
