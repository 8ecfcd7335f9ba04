"""One of every law, all with the same shear modulus and Lamé's λ at rest."""

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
    "ogden": Ogden([MU, -0.2 * MU / 1.1], [1.6, -2.2], LAME),
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
