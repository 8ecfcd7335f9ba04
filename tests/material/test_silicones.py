"""Silicones against the tensile tests that their constants were fitted to."""

import jax
import jax.numpy as jnp
import pytest

from softfuse.errors import ConfigError
from softfuse.material import SILICONES, silicone, silicone_of_stiffness

# Nominal stress [kPa] at 50, 100 and 200 % strain, read off the tests of the Soft Robotics Materials
# Database.
MEASURED = {
    "ecoflex 00-30": (16.9, 29.7, 52.4),
    "ecoflex 00-50": (22.8, 41.0, 79.0),
    "dragon skin 10": (53.0, 113.0, 272.8),
    "dragon skin 20": (151.1, 318.4, 722.3),
    "dragon skin 30": (213.9, 437.1, 959.5),
}


@pytest.mark.parametrize("name", SILICONES)
def test_tension_follows_the_tensile_test(name: str) -> None:
    law = silicone(name, 0.49)
    for stretch, measured in zip((1.5, 2.0, 3.0), MEASURED[name], strict=True):
        stress = jax.grad(law.distortion)(jnp.diag(jnp.array([stretch, stretch**-0.5, stretch**-0.5])))
        nominal = stress[0, 0] - stress[1, 1] * stretch**-1.5
        assert float(nominal) == pytest.approx(1e3 * measured, rel=0.03)


def test_names_ignore_case_and_poisson_sets_the_bulk() -> None:
    law = silicone("Dragon Skin 30", 0.45)
    mu = float(law.shear_modulus())
    assert mu == pytest.approx(184e3)
    assert float(law.lame) == pytest.approx(2 * mu * 0.45 / 0.1, rel=1e-12)


def test_an_unknown_silicone_is_refused() -> None:
    with pytest.raises(ConfigError, match="Ecoflex 00-30"):
        silicone("playdough", 0.49)


def test_a_silicone_of_a_stiffness_keeps_its_shape_of_stress() -> None:
    soft, drawn = silicone_of_stiffness("dragon skin 30", 46e3, 0.49), silicone("dragon skin 30", 0.49)
    assert float(soft.shear_modulus()) == pytest.approx(46e3)
    f = jnp.diag(jnp.array([1.8, 0.7, 0.8]))
    assert float(soft.energy(f) / drawn.energy(f)) == pytest.approx(0.25, rel=1e-12)
