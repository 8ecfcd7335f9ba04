"""The live estimator: right forces from volumes, never compiled again, and honest when it is lost."""

import jax.numpy as jnp
import numpy as np
import pytest
from compilations import compilations, heard

from softfuse.estimation.estimator import Estimator, StepSettings
from softfuse.estimation.step import Observation
from softfuse.functional.chart import facing

AT = jnp.asarray(facing(np.array([[14e-3, -2e-3, 0.0]]), (0, 0, -1)))


@pytest.fixture(scope="module")
def estimator(model, one) -> Estimator:
    return Estimator(model, one, AT)


@pytest.fixture(scope="module")
def press(model, volumes_under) -> list[Observation]:
    """A press from 0 to 9 N in 40 frames, with the volumes of the equilibria."""
    force = np.minimum(np.linspace(0, 12, 40), 9.0)
    whitening = 1e9 * jnp.eye(2)
    return [Observation(volumes_under(model, AT, jnp.array([f])), whitening, AT) for f in force]


def test_it_follows_a_press(estimator: Estimator, press: list[Observation]) -> None:
    estimator.reset()
    found = [estimator.update(seen) for seen in press]
    force = np.array([e.drive[0] for e in found])
    np.testing.assert_allclose(force[-1], 9.0, rtol=1e-6)
    np.testing.assert_allclose(force, np.minimum(np.linspace(0, 12, 40), 9.0), atol=0.05)
    assert not any(e.lost for e in found)
    assert float(found[-1].report.unbalanced) < 1e-6


def test_nothing_is_compiled_while_it_runs(estimator: Estimator, press: list[Observation]) -> None:
    estimator.reset()
    estimator.update(press[0])
    with compilations() as events:
        for seen in press:
            estimator.update(seen)
    assert events == [] and heard()


def test_a_reset_forgets(estimator: Estimator, press: list[Observation]) -> None:
    estimator.reset()
    first = [estimator.update(seen).drive[0] for seen in press[:10]]
    estimator.update(press[-1])
    estimator.reset()
    assert [estimator.update(seen).drive[0] for seen in press[:10]] == first


def test_volumes_that_no_force_explains_leave_a_finite_state(estimator: Estimator, press) -> None:
    estimator.reset()
    for change in (jnp.full(2, -1e-3), jnp.full(2, jnp.nan), jnp.full(2, 1e-3)):
        found = estimator.update(Observation(change, 1e9 * jnp.eye(2), AT))
        assert found.lost or np.all(np.isfinite(found.drive))
        assert bool(jnp.all(jnp.isfinite(estimator.state.z)))
    estimator.reset()
    for seen in press:
        found = estimator.update(seen)
    np.testing.assert_allclose(found.drive[0], 9.0, rtol=1e-6)


def test_a_place_that_is_no_number_is_given_up(estimator: Estimator, press) -> None:
    estimator.reset()
    found = estimator.update(press[-1]._replace(places=jnp.full_like(AT, jnp.nan)))
    assert found.lost and np.all(np.isfinite(found.drive)) and bool(jnp.all(jnp.isfinite(estimator.state.z)))


def test_more_steps_a_frame_follow_closer(model, one, press: list[Observation]) -> None:
    patient = Estimator(model, one, AT, StepSettings(steps_per_frame=3))
    force = np.array([patient.update(seen).drive[0] for seen in press])
    np.testing.assert_allclose(force, np.minimum(np.linspace(0, 12, 40), 9.0), atol=1e-3)


@pytest.mark.slow
def test_shortened_steps_are_told_and_caught_up(model, one, press: list[Observation]) -> None:
    """The whole press within one frame: a step of a tenth of the motion is told, thirty of them arrive."""
    full = Estimator(model, one, AT, StepSettings(steps_per_frame=10))
    full.update(press[-1])
    moved = float(jnp.max(jnp.abs(full.state.z[: model.body.n_displacements])))
    bound = one._replace(motion=jnp.asarray(moved / 10))
    single = Estimator(model, bound, AT)
    found = single.update(press[-1])
    assert float(found.report.taken) < 0.2
    assert float(jnp.max(jnp.abs(single.state.z[: model.body.n_displacements]))) < 0.2 * moved
    caught = Estimator(model, bound, AT, StepSettings(steps_per_frame=2, catch_up_steps=30)).update(press[-1])
    assert float(caught.report.taken) == 1.0
    np.testing.assert_allclose(caught.drive[0], 9.0, rtol=0.02)
