"""Measures of designs: what they are where that is known, and gradients through mesh and equilibrium."""

from dataclasses import replace
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body import Body
from softfuse.design.layout_model import model_at
from softfuse.design.limits import Limit
from softfuse.design.objective import (
    AbstractMeasure,
    Answers,
    Closing,
    ElectrodeError,
    ForceError,
    Ignorance,
    PairError,
    PlaceError,
    Sensitivity,
    ShapeError,
    Softness,
    Strain,
    Unevenness,
    WorstForceError,
    measured,
)
from softfuse.design.problem import Problem
from softfuse.functional.cavity import Cavity
from softfuse.functional.chart import facing
from softfuse.functional.contact import ContactSurface
from softfuse.functional.material_points import MaterialPoints
from softfuse.functional.pressure_cells import flat_punch
from softfuse.material import NeoHookean
from softfuse.mechanics.indenters import FlatIndenter
from softfuse.mechanics.model import Model
from softfuse.mechanics.multifrontal import Multifrontal
from softfuse.mechanics.reading import ShapeReading
from softfuse.mesh.block import Fineness, finer_to_the_top
from softfuse.mesh.surface import outer_surface
from softfuse.robot.layout.layout_mesh import layout_mesh

PRESSED_AT = [[0.015, 0.004, 0.0], [-0.012, -0.006, 0.0], [0.003, 0.008, 0.0], [-0.02, 0.01, 0.0]]
PLACES = jnp.asarray(facing(np.array(PRESSED_AT), (0, 0, -1)))
POINTS = np.array([[0.0, 0.0, 0.017], [0.01, 0.005, 0.016]])


class PlaceErrorWithDepth(AbstractMeasure):
    """The place's error where the depth, in mm, is a reading as well: two cavities alone tell no place."""

    name: ClassVar[str] = "place error with depth"
    unit: ClassVar[str] = "m"

    def __call__(self, answers):
        depth = jnp.array([answers.softness * 1e-6]).T
        by_force = jnp.concatenate([answers.by_force, depth], axis=1)
        by_place = jnp.pad(answers.by_place, ((0, 0), (0, 1), (0, 0)))
        noise = jnp.append(answers.noise, 1e-9)
        return PlaceError(5.0)(replace(answers, by_force=by_force, by_place=by_place, noise=noise))


MEASURES = (
    Unevenness(),
    Sensitivity(),
    Softness(),
    ForceError(5.0, 2e-4),
    WorstForceError(5.0, 2e-4),
    Ignorance(5.0, 2e-4),
    ShapeError(5.0, 2e-4),
    PairError(jnp.array([[0, 1], [2, 3]])),
    PlaceErrorWithDepth(),
    Closing(5.0),
    Strain(5.0),
)


def vented(mesh, theta) -> Model:
    made = mesh.mesh(theta)
    body = Body.from_mesh(made, [NeoHookean.from_young(0.6e6, 0.49)], made.nodes[:, 2] < 1e-9)
    surface = ContactSurface.facing(outer_surface(made).faces, made.nodes, np.array([0.0, 0.0, -1.0]))
    contact = FlatIndenter(surface, flat_punch((0.7, 1.0), (3, 6)), 0.008)
    readings = tuple(ShapeReading(Cavity(jnp.asarray(wall.faces))) for wall in mesh.walls)
    return Model(body, readings, (contact,), Multifrontal.plan(body))


@pytest.fixture(scope="module")
def problem(twins) -> Problem:
    """Two cavities, four presses."""
    return Problem(
        twins,
        Fineness(0.04, finer_to_the_top(0.018, 0.04)),
        vented,
        PLACES,
        np.full(2, 1e-9),
        Unevenness(),
        by_place=True,
        watch=lambda model: MaterialPoints.embedded(model.body, POINTS),
    )


@pytest.mark.slow
def test_every_measure_has_the_gradient_of_re_solves_in_every_parameter(problem, twins) -> None:
    twin_mesh = layout_mesh(twins, twins.start, problem.fineness)
    model = vented(twin_mesh, twins.start)
    watched = problem.watched(model, twin_mesh.walls)

    @jax.jit
    def values(theta):
        return measured(MEASURES, problem.answers(model_at(model, twin_mesh, theta), watched, theta))

    theta = jnp.asarray(twins.start)
    slope = jax.jit(jax.jacrev(values))(theta)
    for k, step in enumerate(2e-3 * twins.scale):

        def central(h, k=k):
            return (values(theta.at[k].add(h)) - values(theta.at[k].add(-h))) / (2 * h)

        difference = (4 * central(step / 2) - central(step)) / 3
        size = np.abs(np.asarray(values(theta))) / twins.scale[k]
        off = np.abs(np.asarray(slope[:, k] - difference))
        assert np.all(off <= 1e-4 * np.abs(difference) + 1e-7 * size), (twins.names[k], off, difference)


@pytest.mark.slow
def test_across_a_mesh_of_the_same_tetrahedra_measures_hardly_jump(problem, twins) -> None:
    theta = twins.start + 0.7 * twins.scale * np.cos(2.0 + np.arange(len(twins.names)))
    plain = replace(problem, by_place=False, limits=(Limit(Sensitivity()), Limit(Softness())))
    first = plain.on_mesh(twins.start)
    second = first.remade(theta)
    assert second.mesh.tets is first.mesh.tets
    np.testing.assert_allclose(second.measures(theta), first.measures(theta), rtol=0.02)


@pytest.fixture
def known() -> Answers:
    """Two presses on one of two readings each."""
    by_force = jnp.array([[3.0, 0.0], [0.0, 4.0]])
    by_place = jnp.zeros((2, 2, 2))
    suffered = jnp.array([0.1, 0.2]), jnp.array([0.05, 0.03])
    noise, touched = jnp.array([0.3, 0.4]), jnp.stack([1e6 * jnp.eye(2), 4e6 * jnp.eye(2)])
    return Answers(by_force, by_place, jnp.array([1.0, 2.0]), jnp.ones((2, 5, 3)), *suffered, noise, touched)


def test_measures_of_known_answers(known) -> None:
    # Readings tell nothing of places: σ_F is the noise over the sensitivity, 0.1 N for both.
    assert Unevenness()(known) == pytest.approx(0.5 / 3.5)
    assert Sensitivity()(known) == pytest.approx(3.5)
    assert Softness()(known) == pytest.approx(1.5)
    assert Closing(2.0)(known) == pytest.approx(0.4)
    assert Strain(2.0)(known) == pytest.approx(0.1)
    assert ForceError(2.0, 1e-3)(known) == pytest.approx(0.1)
    assert WorstForceError(2.0, 1e-3)(known) == pytest.approx(0.1)
    # 0.1 N and twice a millimetre.
    assert Ignorance(2.0, 1e-3)(known) == pytest.approx(np.log(0.1))
    assert PairError(jnp.array([[0, 1]]))(known) == pytest.approx(0.1)
    assert ShapeError(2.0, 1e-3)(known) == pytest.approx(0.1 * np.sqrt(3.0))
    # Electrodes tell one place to 1 mm, the other to half of that, along x and y alike.
    assert ElectrodeError()(known) == pytest.approx(1e-3 * np.sqrt(0.5 * (2.0 + 0.5)))
    assert Ignorance(2.0, None)(known) == pytest.approx(np.log(0.1) + 0.5 * np.log(1.0 * 0.25))


def test_electrodes_know_places_as_a_length_does(known) -> None:
    told = replace(
        known, by_place=known.by_place + 0.5, touched=jnp.broadcast_to(1e6 * jnp.eye(2), (2, 2, 2))
    )
    np.testing.assert_allclose(told.covariance(2.0, None), told.covariance(2.0, 1e-3), rtol=1e-12)


def test_the_place_error_is_that_of_readings_alone() -> None:
    # Three readings, of the force, of x and of y under 2 N.
    by_force = jnp.array([[1.0, 0.0, 0.0]])
    by_place = jnp.array([[[0.0, 0.0], [5.0, 0.0], [0.0, 5.0]]])
    answers = Answers(
        by_force,
        by_place,
        jnp.ones(1),
        jnp.zeros((1, 0, 3)),
        *jnp.ones((2, 1)),
        jnp.ones(3),
        jnp.zeros((1, 2, 2)),
    )
    assert PlaceError(2.0)(answers) == pytest.approx(np.sqrt(2.0) / 10.0)
