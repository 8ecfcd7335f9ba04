"""One of every law, all with the same shear modulus and Lamé's λ at rest."""

from collections.abc import Callable

import jax
import numpy as np
import pytest

from softfuse.material import (
    AbstractMaterial,
    Corotational,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    SaintVenantKirchhoff,
    Yeoh,
    lame_constants,
)

YOUNG, POISSON = 6.0e5, 0.4
LAME, MU = (float(value) for value in lame_constants(YOUNG, POISSON))
LAWS = {
    "neo_hookean": NeoHookean.from_young(YOUNG, POISSON),
    "saint_venant_kirchhoff": SaintVenantKirchhoff.from_young(YOUNG, POISSON),
    "corotational": Corotational.from_young(YOUNG, POISSON),
    "mooney_rivlin": MooneyRivlin.from_young(YOUNG, POISSON, second_share=0.3),
    "yeoh": Yeoh.from_poisson(MU / 2, 0.2 * MU, 0.01 * MU, POISSON),
    "ogden": Ogden(np.array([MU, -0.2 * MU / 1.1]), np.array([1.6, -2.2]), LAME),
}


@pytest.fixture(params=LAWS, scope="session")
def law(request: pytest.FixtureRequest) -> AbstractMaterial:
    """A law of Young's modulus 0.6 MPa and Poisson's ratio 0.4 at rest."""
    return LAWS[request.param]


@pytest.fixture(scope="session")
def mu() -> float:
    """Shear modulus at rest of every law [Pa]."""
    return MU


@pytest.fixture(scope="session")
def lame() -> float:
    """Lamé's λ at rest of every law [Pa]."""
    return LAME


@jax.jit
def _energy_and_stress(law: AbstractMaterial, f: jax.Array) -> tuple[jax.Array, jax.Array]:
    return jax.value_and_grad(law.energy)(f)


@pytest.fixture(scope="session")
def energy_and_stress() -> Callable[[AbstractMaterial, np.ndarray], tuple[float, np.ndarray]]:
    """Energy density [J/m³] and nominal stress (3, 3) [Pa] at one state (3, 3), compiled once per law."""

    def evaluate(law: AbstractMaterial, f: np.ndarray) -> tuple[float, np.ndarray]:
        energy, stress = _energy_and_stress(law, f)
        return float(energy), np.asarray(stress)

    return evaluate
