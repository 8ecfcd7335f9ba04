"""Materials of their settings: laws by their constants, silicones by their names."""

from collections.abc import Callable
from pathlib import Path

import jax.numpy as jnp
import pytest

from softfuse.errors import ConfigError
from softfuse.material import silicone
from softfuse.robot.file import load

Write = Callable[..., Path]


@pytest.mark.parametrize(
    ("constants", "shear", "lame"),
    [
        ('law = "neo-hookean"\nyoung = "0.6 MPa"\npoisson = 0.25', 0.24e6, 0.24e6),
        ('law = "saint-venant-kirchhoff"\nyoung = "0.6 MPa"\npoisson = 0.25', 0.24e6, 0.24e6),
        ('law = "corotational"\nyoung = "0.6 MPa"\npoisson = 0.25', 0.24e6, 0.24e6),
        ('law = "mooney-rivlin"\nc10 = "80 kPa"\nc01 = "20 kPa"\nbulk = "1 MPa"', 0.2e6, 1e6 - 0.4e6 / 3),
        ('law = "yeoh"\nc1 = "92 kPa"\nc2 = "9 kPa"\nc3 = "-1 kPa"\npoisson = 0.4', 0.184e6, 0.736e6),
        ('law = "ogden"\nmu = ["50 kPa", "-10 kPa"]\nalpha = [2, -4]\npoisson = 0.25', 0.07e6, 0.07e6),
    ],
)
def test_materials_are_as_stiff_as_their_settings_say(
    write: Write, pad_text: str, constants: str, shear: float, lame: float
) -> None:
    start, end = pad_text.index("[[body.material]]"), pad_text.index("[body.fixed]")
    settings = load(write((pad_text[start:end], f"[[body.material]]\n{constants}\n")))
    (given,) = settings.body.materials
    material = settings.body.materials[0].material()
    assert given.shear_modulus == pytest.approx(shear)
    assert given.lame == pytest.approx(lame)
    assert float(material.shear_modulus()) == pytest.approx(shear)
    assert float(material.lame) == pytest.approx(lame)


def _of_material(write: Write, keys: str) -> Path:
    young = '# Dragon Skin 30; fit it to presses of known force\npoisson = 0.49\ndensity = "1080 kg/m^3"'
    return write((f'law = "neo-hookean"\nyoung = "0.6 MPa"                               {young}', keys))


def test_a_silicone_is_given_by_its_name(write: Write) -> None:
    settings = load(_of_material(write, 'silicone = "ecoflex 00-30"'))
    material = settings.body.materials[0].material()
    expected = silicone("Ecoflex 00-30", 0.49)
    f = jnp.diag(jnp.array([1.5, 0.8, 0.9]))
    assert float(material.energy(f)) == pytest.approx(float(expected.energy(f)), rel=1e-6)
    assert settings.body.materials[0].density == 1070.0
    other = load(_of_material(write, 'silicone = "Dragon Skin 10"\nc1 = "30 kPa"\nbulk = "9 MPa"'))
    (material,) = other.body.materials
    assert (material.law, material.c1, material.c2, material.bulk) == ("yeoh", 30e3, 3.04e3, 9e6)
    assert material.poisson is None


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ('silicone = "Playdough"', 'silicone: "Playdough" is not in the table: it has Ecoflex 00-30, '),
        ('silicone = "Ecoflex 00-30"\nlaw = "ogden"', 'silicone: names a Yeoh law: remove law = "ogden"'),
        ('silicone = "Ecoflex 00-30"\nyoung = "1 MPa"', "young: unknown key"),
    ],
)
def test_a_silicone_that_cannot_be_is_told(write: Write, keys: str, told: str) -> None:
    path = _of_material(write, keys)
    with pytest.raises(ConfigError) as caught:
        load(path)
    assert str(caught.value).startswith(f"{path}: body.material[0].{told}")
