"""The virtual pad and the estimator's: alike at small forces, and the one's touches found by the other."""

from dataclasses import dataclass, replace
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.robot.file import load
from softfuse.config.build_device import build_device
from softfuse.config.build_tracker import build_tracker
from softfuse.experiment.build_virtual_pad import pad_plan
from softfuse.robot.settings import RobotSettings
from softfuse.estimation.limits import Limits
from softfuse.estimation.step import Observation
from softfuse.estimation.tracked import Frame
from softfuse.estimation.tracker import Tracker
from softfuse.experiment.channel_electronics import Readout
from softfuse.experiment.pad_electrodes import LineElectrodes
from softfuse.experiment.pad_programme import PadTiming, pad_programme
from softfuse.experiment.pad_touches import PadBed, pad_touches
from softfuse.experiment.virtual_pad import Touch
from softfuse.functional.chart import facing
from softfuse.functional.pressure_cells import flat_punch
from softfuse.mechanics.sparse import SparseLU
from softfuse.sensors.crossed.field import FieldSettings

ROOT = Path(__file__).parents[2]
SHEAR, POISSON = 0.6e6 / 2.98, 0.49
SMALL_N = 0.25
TOUCHES = tuple(Touch(at, (SMALL_N, 4.0, 8.0)) for at in ((15e-3, 12e-3), (-6e-3, -18e-3)))
RIMS, SECTORS = (0.7, 1.0), (4, 8)
LIMITS = Limits(jnp.zeros(1), jnp.array([25.0]), jnp.array([1e-12]))


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> RobotSettings:
    """The pad's on a mesh that is compiled soon."""
    text = (ROOT / "configs" / "pad.toml").read_text(encoding="utf-8")
    for old, new in (
        ('surface_size = "12 mm"', 'surface_size = "28 mm"'),
        ('base_size = "12 mm"', 'base_size = "28 mm"'),
        ('fine_depth = "3 mm"', 'fine_depth = "0 mm"'),
    ):
        assert old in text
        text = text.replace(old, new)
    path = tmp_path_factory.mktemp("config") / "coarse.toml"
    path.write_text(text, encoding="utf-8")
    return load(path)


@dataclass(frozen=True, eq=False)
class Found:
    """What was found: forces [N] and places [mm] at the samples, true and estimated; and the force [N] that
    the estimator finds, given the volumes and the place of each touch under its smallest force.
    """

    force: np.ndarray
    true_force: np.ndarray
    place: np.ndarray
    true_place: np.ndarray
    small_force: np.ndarray


@pytest.fixture(scope="module")
def found(config: RobotSettings) -> Found:
    """Everything as in a live device, but for coarse meshes, alike: what they miss is not at issue."""
    # More cells of pressure than these cannot be told apart on so coarse a mesh.
    cells = flat_punch(RIMS, SECTORS)
    device = eqx.tree_at(lambda d: d.contacts[0].disc.cells, build_device(config), cells)
    plan = pad_plan(config, config.body.source, SHEAR, POISSON)
    pad = replace(plan.settings, surface_size=28e-3, base_size=28e-3, growth=0.5, rims=RIMS, sectors=SECTORS)
    assert isinstance(plan.array, LineElectrodes)
    field = FieldSettings(radius=pad.radius, cuts=3, bottom_side=2e-3)
    electrodes = replace(plan.array, field=field)
    gaps = (0.0, 0.5e-3, 1e-3, 2e-3, 4e-3, 8e-3, 25e-3)
    touches = pad_touches(PadBed(pad, electrodes, gaps, plan=SparseLU.plan), TOUCHES)
    tracker = build_tracker(config, device)
    small = [_force_of(tracker, at, volume[1]) for at, volume in zip(touches.at, touches.volume, strict=True)]
    tracker.reset()
    programme = pad_programme(touches, PadTiming(), plan.parts, plan.flows, plan.electrodes)
    readout = Readout(programme, plan.electronics(1), (1, 2, 3))
    times = np.arange(0.0, programme.period_s, 0.01)
    values, truth = readout.read(times), programme.truth_at(times)
    sampled = truth["sample"] > 1
    rows = []
    for k, time_s in enumerate(times.tolist()):
        sensed = tracker.sense(Frame(time_s, (values[k, :4], values[k, 4:12], values[k, 12:])))
        # Often enough to follow.
        if k % 8 == 0 or sampled[k]:
            now = tracker.estimate(time_s, sensed)
            if sampled[k]:
                rows.append((now.force_N, *now.centre_m[:2]))
    estimated = np.array(rows)
    return Found(
        estimated[:, 0],
        truth["true_force_N"][sampled],
        1e3 * estimated[:, 1:],
        np.stack([truth["true_x_mm"], truth["true_y_mm"]], axis=1)[sampled],
        np.array(small),
    )


def _force_of(tracker: Tracker, at: np.ndarray, volume: np.ndarray) -> float:
    """What the estimator finds, iterated, for exact volumes (4,) m³ at a place (2,) m."""
    tracker.reset()
    place = facing(np.array([[*at, 0.0]]), (0, 0, -1))
    seen = Observation(jnp.asarray(volume), 1e9 * jnp.eye(4), jnp.asarray(place))
    for _ in range(4):
        drive = tracker.estimator.update(seen, LIMITS).drive
    return float(drive[0])


def test_at_small_force_the_models_agree(found: Found) -> None:
    np.testing.assert_allclose(found.small_force, SMALL_N, rtol=0.05)


def test_the_tracker_finds_where_it_is_touched(found: Found) -> None:
    assert found.true_force.tolist() == [4.0, 8.0, 4.0, 8.0]
    assert np.linalg.norm(found.place - found.true_place, axis=1).max() < 0.3


def test_the_tracker_finds_how_hard_it_is_touched(found: Found) -> None:
    np.testing.assert_allclose(found.force, found.true_force, rtol=0.08)
