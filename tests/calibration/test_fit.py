"""A fit finds what a robot was made with from presses of it, and says what presses cannot tell."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, repeat

import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body.body import Body
from softfuse.body.element import LINEAR
from softfuse.calibration.adjustment import Adjustments, Gains, Layer, Stiffening, Stiffness, Walls
from softfuse.calibration.fit import Fit, fit
from softfuse.calibration.presses import Adjustable, Applied, Presses
from softfuse.errors import SoftfuseError, SolveError
from softfuse.functional.cavity import Cavity
from softfuse.functional.chart import facing
from softfuse.functional.contact import ContactSurface
from softfuse.functional.pressure_cells import flat_punch
from softfuse.material import NeoHookean
from softfuse.mechanics.indenters import FlatIndenter
from softfuse.mechanics.model import Model
from softfuse.mechanics.multifrontal import Multifrontal
from softfuse.mechanics.reading import ShapeReading
from softfuse.mesh.pad import PadGeometry, pad_mesh
from softfuse.mesh.surface import cavities, outer_surface
from softfuse.mesh.tetmesh import TetMesh

GEOMETRY = PadGeometry(
    size=(0.07, 0.04, 0.018),
    cavity_size=(0.028, 0.028, 0.006),
    cavity_centres=((-0.017, 0.0), (0.017, 0.0)),
    cavity_z_bottom=0.006,
)
NAMES = ("left", "right")
NOISE = 0.3e-9
POINTS = 1e-3 * np.array([[-18, 4, 0], [16, -5, 0], [0, 2, 0], [-9, -6, 0], [22, 3, 0]])
PLACES = facing(POINTS, (0, 0, -1))
FORCES = (1.5, 3.0, 4.5)


@pytest.fixture(scope="module")
def mesh() -> TetMesh:
    return pad_mesh(GEOMETRY, 0.010, 0.014)


@pytest.fixture(scope="module")
def model(mesh: TetMesh) -> Model:
    """Two cavities under a disc of 6 mm."""
    body = Body.from_mesh(mesh, [NeoHookean.from_young(0.3e6, 0.3)], mesh.nodes[:, 2] < 1e-9, element=LINEAR)
    surface = ContactSurface.facing(outer_surface(mesh).faces, mesh.nodes, np.array([0.0, 0.0, -1.0]))
    disc = FlatIndenter(surface, flat_punch(), 0.006, 0.3e-9)
    walls = cavities(mesh, GEOMETRY.centres())
    readings = tuple(ShapeReading(Cavity(jnp.asarray(wall.faces))) for wall in walls)
    return Model(body, readings, (disc,), Multifrontal.plan(body))


@pytest.fixture(scope="module")
def adjustable(model: Model, mesh: TetMesh) -> Adjustable:
    walls = Walls.of(mesh, GEOMETRY.centres(), NAMES, shift=0.3e-3, growth=0.3e-3)
    groups = (Stiffness.within(0.3), Stiffening.within(0.3), layer(model), walls)
    return Adjustable(model, Adjustments(groups))


def applied(places: np.ndarray, forces: Sequence[float]) -> Applied:
    """All forces at each of some places, a press each."""
    count = len(forces)
    place = np.repeat(places, count, axis=0)[:, None]
    press = np.repeat(np.arange(len(places)), count)
    return Applied(place, np.tile(forces, len(places))[:, None], np.zeros((len(press), 0)), press)


def presses_of(adjustable: Adjustable, value: np.ndarray, *, seed: int = 1) -> Presses:
    done = applied(PLACES, FORCES)
    reading = adjustable.answer(value, done).reading
    noise = NOISE * np.random.default_rng(seed).normal(size=reading.shape)
    return Presses(done, reading + noise, np.full(reading.shape, NOISE), np.zeros(2, int))


@pytest.fixture(scope="module")
def made(adjustable: Adjustable) -> np.ndarray:
    """What the robot was made with: drawn from the prior."""
    sigma = np.asarray(adjustable.adjustments.sigma)
    return sigma * np.random.default_rng(7).normal(size=len(sigma)).clip(-1.5, 1.5)


@pytest.fixture(scope="module")
def presses(adjustable: Adjustable, made: np.ndarray) -> Presses:
    return presses_of(adjustable, made)


@pytest.fixture(scope="module")
def found(adjustable: Adjustable, presses: Presses) -> Fit:
    return fit(adjustable, presses)


def test_every_parameter_is_within_its_interval(found: Fit, made: np.ndarray) -> None:
    off = found.value - made
    assert np.all(np.abs(off) < 3 * found.sigma)
    # 99.8 % of what chi² of 15 parameters can be
    assert 3.5 < off @ np.linalg.solve(found.covariance, off) < 37.7


def test_what_the_presses_tell_is_told(found: Fit) -> None:
    told = dict(zip(found.names, found.told, strict=True))
    assert told["stiffness"] > 0.9
    assert told["left shift z"] > 0.5 and told["right shift z"] > 0.5
    assert np.all((found.told > -1e-9) & (found.told < 1))
    assert np.all(found.discrepancy.part < 2e-3)


def test_misfits_shrink_to_the_noise(found: Fit) -> None:
    before, after = (float(np.sqrt(np.mean(each**2))) for each in (found.before, found.after))
    assert before > 20 * NOISE and after < 1.2 * NOISE


def test_slopes_are_those_of_differences(adjustable: Adjustable, made: np.ndarray) -> None:
    done = applied(PLACES[:1], [3.0])
    slope = adjustable.answer(made, done).slope
    for k, step in enumerate(1e-3 * np.asarray(adjustable.adjustments.sigma)):
        ends = [adjustable.answer(made + side * step * np.eye(len(made))[k], done) for side in (-1, 1)]
        change = (ends[1].reading - ends[0].reading) / (2 * step)
        np.testing.assert_allclose(
            slope[..., k], change, atol=2e-5 * np.abs(slope[..., k]).max() + 1e-13 / step
        )


def test_presses_without_an_equilibrium_are_left_out_where_they_are_not_needed(
    adjustable: Adjustable, made: np.ndarray
) -> None:
    done = applied(PLACES[:2], [3.0])
    beyond = replace(done, force_N=np.array([[1e4], [3.0]]))
    with pytest.raises(SolveError, match="10000.00 N at .* has no equilibrium"):
        adjustable.answer(made, beyond)
    answer = adjustable.answer(made, beyond, needed=False)
    assert answer.sample.tolist() == [1] and len(answer.states) == 1
    np.testing.assert_allclose(answer.reading, adjustable.answer(made, done.only(answer.sample)).reading)
    with pytest.raises(SolveError, match="none of the presses"):
        adjustable.answer(made, beyond.only(np.array([0])), needed=False)


@dataclass(frozen=True, eq=False)
class Frail(Adjustable):
    """One that some of the parameters which are tried let collapse, in their order."""

    collapses: Iterator[bool]

    def answer(self, value, applied, **given):
        if next(self.collapses):
            raise SolveError("press 3 has no equilibrium")
        return super().answer(value, applied, **given)


def test_steps_are_shorter_where_a_robot_would_collapse(
    adjustable: Adjustable, presses: Presses, found: Fit
) -> None:
    frail = Frail(adjustable.model, adjustable.adjustments, chain([False, True], repeat(False)))
    assert np.all(np.abs(fit(frail, presses).value - found.value) < 0.3 * found.sigma)
    frail = Frail(adjustable.model, adjustable.adjustments, chain([False], repeat(True)))
    with pytest.raises(SolveError, match="press 3 has no equilibrium"):
        fit(frail, presses)


@pytest.mark.slow
def test_two_parameters_that_do_the_same_are_told(model: Model, presses: Presses) -> None:
    twice = Adjustments((Stiffness.within(0.3), replace_names(Stiffness.within(0.3), "again"), layer(model)))
    found = fit(Adjustable(model, twice), presses)
    assert found.correlation[0, 1] < -0.99
    assert np.all(found.told[:2] < 0.6)


def layer(model: Model) -> Layer:
    return Layer.of(0.3e-9, 0.006, model.body, 1.0)


def replace_names(group: Stiffness, name: str) -> Stiffness:
    return replace(group, names=(name,))


@pytest.mark.slow
def test_a_gain_is_found(model: Model, presses: Presses, adjustable: Adjustable, made: np.ndarray) -> None:
    groups = (*adjustable.adjustments.groups, Gains.of(NAMES, np.ones(2, bool), 0.02))
    gains = np.array([0.03, -0.02])
    read = replace(presses, reading=presses.reading * np.exp(gains))
    found = fit(Adjustable(model, Adjustments(groups)), read)
    off = found.value - np.concatenate([made, gains])
    assert found.names[-2:] == ("left gain", "right gain")
    assert off @ np.linalg.solve(found.covariance, off) < 40.8


def test_a_reading_that_is_wrong_counts_little(
    adjustable: Adjustable, presses: Presses, made: np.ndarray
) -> None:
    reading = presses.reading.copy()
    reading[4, 1] *= 1.5
    found = fit(adjustable, replace(presses, reading=reading))
    assert found.weight[4, 1] < 0.1 * np.median(found.weight)
    off = found.value - made
    assert np.all(np.abs(off) < 3 * found.sigma) and off @ np.linalg.solve(found.covariance, off) < 37.7


@pytest.mark.slow
def test_what_says_nothing_is_left_out(adjustable: Adjustable, presses: Presses, found: Fit) -> None:
    sigma, reading = presses.sigma.copy(), presses.reading.copy()
    sigma[0, 1], reading[0, 1], reading[3, 0] = np.inf, 1.0, np.nan
    less = fit(adjustable, replace(presses, sigma=sigma, reading=reading))
    assert np.all(np.abs(less.value - found.value) < 2 * found.sigma)
    assert less.weight[0, 1] == less.weight[3, 0] == 0
    with pytest.raises(SoftfuseError, match="no sample"):
        fit(adjustable, replace(presses, sigma=np.full_like(sigma, np.inf)))
