"""Homogeneous tension against closed forms, compressible and in the incompressible limit."""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import root_scalar

from softfuse.material import (
    AbstractMaterial,
    Corotational,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    SaintVenantKirchhoff,
    Yeoh,
)

Evaluate = Callable[[AbstractMaterial, np.ndarray], tuple[float, np.ndarray]]
MU, NEARLY = 2.0e5, 0.499999995
C10, C01 = 0.35 * MU, 0.15 * MU
C1, C2, C3 = 0.5 * MU, 0.1 * MU, -0.002 * MU
MODULI, EXPONENTS = np.array([1.1 * MU, -0.1 * MU]), np.array([1.7, -2.3])
LAME = 2 * MU * NEARLY / (1 - 2 * NEARLY)


def yeoh_slope(first: float) -> float:
    return 2 * (C1 + 2 * C2 * (first - 3) + 3 * C3 * (first - 3) ** 2)


# Nominal stress of an incompressible solid in uniaxial tension and in equibiaxial tension at the stretch s.
CASES: dict[str, tuple[AbstractMaterial, Callable[[float], float], Callable[[float], float]]] = {
    "neo_hookean": (
        NeoHookean.from_young(2 * MU * (1 + NEARLY), NEARLY),
        lambda s: MU * (s - s**-2),
        lambda s: MU * (s - s**-5),
    ),
    "mooney_rivlin": (
        MooneyRivlin(C10, C01, LAME),
        lambda s: 2 * (s - s**-2) * (C10 + C01 / s),
        lambda s: 2 * (s - s**-5) * (C10 + C01 * s**2),
    ),
    "yeoh": (
        Yeoh(C1, C2, C3, LAME),
        lambda s: (s - s**-2) * yeoh_slope(s**2 + 2 / s),
        lambda s: (s - s**-5) * yeoh_slope(2 * s**2 + s**-4),
    ),
    "ogden": (
        Ogden(MODULI, EXPONENTS, LAME),
        lambda s: float(MODULI @ (s ** (EXPONENTS - 1) - s ** (-EXPONENTS / 2 - 1))),
        lambda s: float(MODULI @ (s ** (EXPONENTS - 1) - s ** (-2 * EXPONENTS - 1))),
    ),
}


@pytest.fixture(scope="session")
def principal_stress(energy_and_stress: Evaluate) -> Callable[..., np.ndarray]:
    """Nominal principal stresses (3,) [Pa] of a law at three principal stretches [-]."""

    def evaluate(law: AbstractMaterial, *stretches: float) -> np.ndarray:
        return np.diag(energy_and_stress(law, np.diag(np.array(stretches)))[1])

    return evaluate


def stress_free_stretch(stress: Callable[[float], float], guess: float) -> float:
    """The stretch [-] within 0.01 % of the guess at which the stress [Pa] vanishes."""
    bracket = (guess * (1 - 1e-4), guess * (1 + 1e-4))
    return root_scalar(stress, bracket=bracket, method="brentq", xtol=1e-15).root


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("stretch", [0.4, 0.8, 1.3, 2.5])
def test_uniaxial_tension_of_an_almost_incompressible_solid(
    name: str, stretch: float, principal_stress: Callable[..., np.ndarray]
) -> None:
    law, uniaxial, _ = CASES[name]
    lateral = stress_free_stretch(lambda s: principal_stress(law, stretch, s, s)[1], stretch**-0.5)
    assert principal_stress(law, stretch, lateral, lateral)[0] == pytest.approx(uniaxial(stretch), rel=1e-5)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("stretch", [0.6, 1.2, 2.0])
def test_equibiaxial_tension_of_an_almost_incompressible_solid(
    name: str, stretch: float, principal_stress: Callable[..., np.ndarray]
) -> None:
    law, _, equibiaxial = CASES[name]
    lateral = stress_free_stretch(lambda s: principal_stress(law, stretch, stretch, s)[2], stretch**-2)
    stresses = principal_stress(law, stretch, stretch, lateral)
    assert stresses[0] == pytest.approx(equibiaxial(stretch), rel=1e-5)
    assert stresses[0] == pytest.approx(stresses[1], rel=1e-9)


@pytest.mark.parametrize("stretch", [0.8, 1.0, 1.5])
def test_saint_venant_kirchhoff_tension_has_a_closed_form(
    stretch: float, principal_stress: Callable[..., np.ndarray]
) -> None:
    young, poisson = 3.0e5, 0.3
    green = (stretch**2 - 1) / 2
    lateral = np.sqrt(1 - 2 * poisson * green)
    stresses = principal_stress(SaintVenantKirchhoff.from_young(young, poisson), stretch, lateral, lateral)
    np.testing.assert_allclose(stresses, [young * green * stretch, 0, 0], atol=1e-9 * young)


@pytest.mark.parametrize("stretch", [0.5, 1.0, 1.8])
def test_corotational_tension_is_linear(stretch: float, principal_stress: Callable[..., np.ndarray]) -> None:
    young, poisson = 3.0e5, 0.3
    lateral = 1 - poisson * (stretch - 1)
    stresses = principal_stress(Corotational.from_young(young, poisson), stretch, lateral, lateral)
    np.testing.assert_allclose(stresses, [young * (stretch - 1), 0, 0], atol=1e-9 * young)


@pytest.mark.parametrize("stretches", [(1.3, 0.9, 0.7), (0.5, 1.0, 1.0), (2.0, 2.0, 0.6)])
def test_compressible_principal_stresses(
    stretches: tuple[float, float, float], principal_stress: Callable[..., np.ndarray]
) -> None:
    s = np.array(stretches)
    lame, log_volume = 7.0e5, np.log(np.prod(s))
    pressure = lame * log_volume / s
    first = np.sum(s**2) - 3 - 2 * log_volume
    slope = 2 * (C1 + 2 * C2 * first + 3 * C3 * first**2)
    expected = [
        (NeoHookean(jnp.asarray(MU), jnp.asarray(lame)), MU * (s - 1 / s)),
        (MooneyRivlin(C10, C01, lame), 2 * C10 * (s - 1 / s) + 2 * C01 * (1 / s - s**-3)),
        (Yeoh(C1, C2, C3, lame), slope * (s - 1 / s)),
        (Ogden(MODULI, EXPONENTS, lame), (s[:, None] ** EXPONENTS - 1) @ MODULI / s),
    ]
    for law, distortional in expected:
        np.testing.assert_allclose(
            principal_stress(law, *stretches), distortional + pressure, rtol=1e-11, atol=1e-5
        )
