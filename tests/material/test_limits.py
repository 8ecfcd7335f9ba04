"""Laws that must agree: special cases of each other, the polar decomposition, and powers of the stretches."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import polar
from scipy.stats import special_ortho_group

from softfuse.material import AbstractMaterial, Corotational, MooneyRivlin, NeoHookean, Ogden, Yeoh

Evaluate = Callable[[AbstractMaterial, np.ndarray], tuple[float, np.ndarray]]
EvaluateMany = Callable[[AbstractMaterial, np.ndarray], tuple[np.ndarray, np.ndarray]]
MU, LAME = 2.0e5, 1.3e6


def random_gradients(*, count: int, seed: int, spread: float) -> np.ndarray:
    """Deformation gradients (count, 3, 3) whose principal stretches lie in [1/spread, spread]."""
    rng = np.random.default_rng(seed)
    stretches = spread ** rng.uniform(-1, 1, (count, 3))
    left, right = (special_ortho_group.rvs(3, size=count, random_state=seed + k) for k in (1, 2))
    return np.einsum("nij,nj,njk->nik", left, stretches, right)


@pytest.fixture(scope="session")
def evaluate(energy_and_stress: Evaluate) -> EvaluateMany:
    """Energies (n,) [J/m³] and nominal stresses (n, 3, 3) [Pa] of a law at many states (n, 3, 3)."""

    def each(law: AbstractMaterial, gradients: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        energies, stresses = zip(*(energy_and_stress(law, f) for f in gradients), strict=True)
        return np.array(energies), np.array(stresses)

    return each


@pytest.mark.parametrize(
    ("special", "general"),
    [
        (NeoHookean(jnp.asarray(MU), jnp.asarray(LAME)), Yeoh(MU / 2, 0.0, 0.0, LAME)),
        (NeoHookean(jnp.asarray(MU), jnp.asarray(LAME)), MooneyRivlin(MU / 2, 0.0, LAME)),
        (
            NeoHookean(jnp.asarray(MU), jnp.asarray(LAME)),
            Ogden(np.array([0.7 * MU, 0.3 * MU]), np.array([2.0, 2.0]), LAME),
        ),
        (
            MooneyRivlin(0.3 * MU, 0.2 * MU, LAME),
            Ogden(np.array([0.6 * MU, -0.4 * MU]), np.array([2.0, -2.0]), LAME),
        ),
    ],
    ids=["yeoh", "mooney_rivlin", "ogden", "ogden_mooney_rivlin"],
)
def test_special_cases_agree(
    special: AbstractMaterial, general: AbstractMaterial, evaluate: EvaluateMany
) -> None:
    gradients = random_gradients(count=200, seed=7, spread=3.0)
    for one, other in zip(evaluate(special, gradients), evaluate(general, gradients), strict=True):
        np.testing.assert_allclose(other, one, rtol=1e-10, atol=1e-11 * np.abs(one).max())


def test_mooney_rivlin_at_constant_volume_is_mooneys_law(evaluate: EvaluateMany) -> None:
    gradients = random_gradients(count=50, seed=11, spread=2.0)
    gradients /= np.cbrt(np.linalg.det(gradients))[:, None, None]
    c = np.einsum("nki,nkj->nij", gradients, gradients)
    first = np.trace(c, axis1=1, axis2=2)
    second = (first**2 - np.trace(c @ c, axis1=1, axis2=2)) / 2
    energies, _ = evaluate(MooneyRivlin(3.0, 2.0, 0.0), gradients)
    np.testing.assert_allclose(energies, 3 * (first - 3) + 2 * (second - 3), rtol=1e-11)


def test_corotational_uses_the_polar_factor(evaluate: EvaluateMany) -> None:
    gradients = random_gradients(count=300, seed=13, spread=5.0)
    gradients[:50] = random_gradients(count=50, seed=14, spread=1.001)
    energies, stresses = evaluate(Corotational(MU, LAME), gradients)
    for f, energy, stress in zip(gradients, energies, stresses, strict=True):
        rotation, stretch = polar(f)
        growth = np.trace(stretch) - 3
        expected = MU * np.sum((f - rotation) ** 2) + LAME / 2 * growth**2
        assert float(energy) == pytest.approx(expected, rel=1e-10, abs=1e-8)
        np.testing.assert_allclose(
            stress, 2 * MU * (f - rotation) + LAME * growth * rotation, rtol=1e-10, atol=1e-10 * LAME
        )


def test_corotational_takes_the_nearest_rotation_when_inverted(evaluate: EvaluateMany) -> None:
    gradients = random_gradients(count=300, seed=17, spread=2.0) @ np.diag([1.0, 1.0, -1.0])
    left, singular, right = np.linalg.svd(gradients)
    kept = singular[:, 1] > 1.1 * singular[:, 2]
    signed = singular * np.array([1.0, 1.0, -1.0])
    rotations = np.einsum("nij,j,njk->nik", left, [1.0, 1.0, -1.0], right)
    energies, stresses = evaluate(Corotational(MU, LAME), gradients)
    growth = signed.sum(1) - 3
    expected = MU * ((signed - 1) ** 2).sum(1) + LAME / 2 * growth**2
    expected_stress = 2 * MU * (gradients - rotations) + LAME * growth[:, None, None] * rotations
    assert kept.sum() > 200
    np.testing.assert_allclose(energies[kept], expected[kept], rtol=1e-8)
    np.testing.assert_allclose(stresses[kept], expected_stress[kept], atol=1e-8 * LAME)


@settings(max_examples=60)
@given(
    stretches=st.lists(st.floats(0.2, 5.0), min_size=3, max_size=3),
    alpha=st.floats(-10.0, 10.0).filter(lambda a: abs(a) > 0.05),
)
def test_ogden_is_the_sum_of_powers(
    energy_and_stress: Evaluate, stretches: list[float], alpha: float
) -> None:
    s = np.array(stretches)
    powers = np.sum(s**alpha)
    energy, stress = energy_and_stress(Ogden(np.array([1.0, 0.0]), np.array([alpha, 2.0]), 0.0), np.diag(s))
    scale = powers + 3 + abs(alpha * np.sum(np.log(s)))
    expected = (powers - 3 - alpha * np.sum(np.log(s))) / alpha
    assert energy == pytest.approx(expected, abs=1e-11 * scale / abs(alpha))
    np.testing.assert_allclose(np.diag(stress) * s, s**alpha - 1, atol=1e-10 * scale)


def test_ogden_slope_with_respect_to_its_exponent() -> None:
    s, alpha = np.array([1.8, 0.7, 0.7]), 1.3
    slope = jax.grad(lambda a: Ogden([1.0], a[None], 0.0).distortion(jnp.diag(jnp.asarray(s))))(
        jnp.asarray(alpha)
    )
    powers = s**alpha
    expected = np.sum(powers * np.log(s)) / alpha - np.sum(powers - 1) / alpha**2
    assert float(slope) == pytest.approx(expected, rel=1e-11)
