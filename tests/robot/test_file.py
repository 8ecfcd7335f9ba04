"""Configuration files: what is read, and how mistakes are told."""

from collections.abc import Callable
from pathlib import Path

import pytest

from softfuse.errors import ConfigError
from softfuse.robot.file import load
from softfuse.sensors.crossed.settings import CrossedSettings
from softfuse.sensors.flow import FlowSettings

Write = Callable[..., Path]

YOUNG = 'young = "0.6 MPa"'
LAW = 'law = "neo-hookean"\n' + YOUNG


def test_the_pad_is_that_of_the_design(write: Write) -> None:
    config = load(write())
    source = config.body.source
    assert source.type == "pad"
    assert (source.size, source.cavity_size) == ((0.08, 0.08, 0.018), (0.028, 0.028, 0.006))
    assert [c.centre for c in config.chambers] == [
        (x, y, 0.009) for x in (-0.017, 0.017) for y in (-0.017, 0.017)
    ]
    (material,) = config.body.materials
    assert (material.law, material.lame) == ("neo-hookean", pytest.approx(0.6e6 * 0.49 / (1.49 * 0.02)))
    assert config.body.element == "taylor-hood"
    assert (config.contact().model, config.contact("indenter").radius) == ("punch", 0.01)
    (array,) = config.sensors_of(CrossedSettings)
    assert array.row_y == array.column_x == tuple(1e-3 * (-28 + 8 * k) for k in range(8))
    assert (array.row_depth, array.column_depth) == (1.5e-3, 1e-3)
    (flow,) = config.sensors_of(FlowSettings)
    assert flow.sensitivity == pytest.approx(20.0 / (1e-3 / 60.0))
    assert config.channels == (
        *(f"flow{k}_V" for k in range(4)),
        *(f"row{k}" for k in range(8)),
        *(f"col{k}" for k in range(8)),
    )


def test_what_simulation_does_not_need_may_be_left_out(write: Write, pad_text: str) -> None:
    config = load(write((pad_text[pad_text.index("[[contact]]") :], "")))
    assert config.contacts == config.sensors == config.cables == config.channels == ()
    assert config.estimator.steps_per_frame == 1


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (
            '["80 mm", "80 mm", "18 mm"]',
            '["80 kg", "80 mm", "18 mm"]',
            'body.source.size[0]: "80 kg" is a mass, expected a length such as "64 mm"',
        ),
        ('["80 mm", "80 mm", "18 mm"]', '["80 mm", "80 mm"]', "body.source.size[2]: missing"),
        (
            '["80 mm", "80 mm", "18 mm"]',
            '["80 mm", "80 mm", "18 mm", "1 mm"]',
            "body.source.size: 4 values, expected at most 3",
        ),
        ('["80 mm", "80 mm", "18 mm"]', '"80 mm"', 'body.source.size: "80 mm" must be a list'),
        (
            '["80 mm", "80 mm", "18 mm"]',
            '["80 mm", "-80 mm", "18 mm"]',
            'body.source.size[1]: "-80 mm" must be greater than 0',
        ),
        (
            YOUNG,
            "young = 0.6",
            'body.material[0].young: 0.6 has no unit, expected a pressure such as "0.3 MPa"',
        ),
        (YOUNG, 'young = "-0.6 MPa"', 'body.material[0].young: "-0.6 MPa" must be greater than 0'),
        (
            "poisson = 0.49",
            "poisson = 0.5",
            "body.material[0].poisson: 0.5 must lie between -1 and 0.5, both excluded; "
            "silicone rubber has 0.49 to 0.499",
        ),
        (
            "poisson = 0.49",
            "poisson = -1",
            "body.material[0].poisson: -1.0 must lie between -1 and 0.5, both excluded; "
            "silicone rubber has 0.49 to 0.499",
        ),
        ("poisson = 0.49", "poisson = nan", "body.material[0].poisson: nan must be a finite number"),
        (
            "poisson = 0.49",
            'poisson = "0.49"',
            'body.material[0].poisson: "0.49" must be a valid number',
        ),
        (
            "poisson = 0.49",
            "poisson = -0.2",
            "body.material[0]: Lamé's λ is -1.071e+05 Pa: a Taylor-Hood element needs a positive one; "
            'raise poisson or bulk, or set body.element = "quadratic"',
        ),
        ("poisson = 0.49\n", "\n", "body.material[0].poisson: missing"),
        (
            'law = "neo-hookean"',
            'law = "neo-hookian"',
            'body.material[0].law: "neo-hookian" is none of "neo-hookean", "saint-venant-kirchhoff", '
            '"corotational", "mooney-rivlin", "yeoh", "ogden"',
        ),
        (
            'law = "neo-hookean"',
            "",
            'body.material[0].law: missing, give one of "neo-hookean", "saint-venant-kirchhoff", '
            '"corotational", "mooney-rivlin", "yeoh", "ogden"',
        ),
        (
            'element = "taylor-hood" ',
            'element = "taylor" ',
            'body.element: "taylor" is none of "taylor-hood", "quadratic", "linear"',
        ),
        (
            "[body.fixed]",
            "[body.stiffness_field]\nquux = 0.1\n[body.fixed]",
            "body.stiffness_field.quux: unknown key, the known ones are x, y, z, xy, xz, yz, xx, yy, zz",
        ),
        (
            "[body.fixed]",
            '[body.stiffness_field]\nx = "2 %"\n[body.fixed]',
            'body.stiffness_field.x: "2 %" must be a valid number',
        ),
        (
            "[body.fixed]",
            "[body.stiffness_field]\nx = 20.0\n[body.fixed]",
            "body.stiffness_field.x: 20.0 must be less than or equal to 3",
        ),
        ("[body.fixed]", "[body.fix]\n[body.fixed]", 'body.fix: unknown key, did you mean "fixed"?'),
        (
            "surface_size =",
            'surface_sise = "1 mm"\nsurface_size =',
            'body.source.surface_sise: unknown key, did you mean "surface_size"?',
        ),
        (
            "[contact.workspace]",
            "[contact.workspace]\nquux = 1",
            "contact[0].workspace.quux: unknown key, the known ones are x, y",
        ),
        ("[robot]", "[robots]\n[robot]", 'robots: unknown key, did you mean "robot"?'),
        (
            'name = "(-,+)"\ncentre',
            'name = "(-,+)"\ncenter = []\ncentre',
            'chamber[1].center: unknown key, did you mean "centre"?',
        ),
        (
            'name = "(-,+)"',
            'name = "(-,-)"',
            'chamber[1].name: the name "(-,-)" is taken by chamber[0]',
        ),
        (
            '["-17 mm", "17 mm", "9 mm"]',
            '["-17 mm", "17 mm", "8 mm"]',
            "chamber[1].centre[2]: the cavities of a pad are all at one height",
        ),
        (
            'channels = ["flow0_V", ',
            "channels = [",
            "sensor[0].channels: 3 for 4 chambers",
        ),
        (
            '"row0", "row1"',
            '"row1"',
            "sensor[1].channels: 15 for 16 lines of row_y and column_x",
        ),
        ('"row0", "row1"', '"row0", "col7"', 'sensor[1].channels: "col7" is named twice'),
        (
            '"row0", "row1"',
            '"row0", "flow0_V"',
            'sensor: "flow0_V" is the column of two sensors or commands: give each its own',
        ),
        (
            'row_y = ["-28 mm", "-20 mm"',
            'row_y = ["-28 mm", "-30 mm"',
            "sensor[1].row_y: the values must ascend",
        ),
        (
            'zero = "0.5 V"',
            'zero = "3 V"',
            "sensor[0]: zero = 3 must lie between low = 0.002 and high = 2.5",
        ),
        (
            'zero = "0.5 V"',
            'zero = "0.5 N"',
            'sensor[0].zero: "0.5 N" is a force, expected a voltage such as "0.5 V"',
        ),
        (
            "near_off_sigma = 6.0",
            "near_off_sigma = 9.0",
            "sensor[1].touch.near_off_sigma: must not exceed near_on_sigma = 8",
        ),
        ("steps_per_frame = 1", "steps_per_frame = 0", "estimator.steps_per_frame: 0 must be greater than 0"),
        (
            "steps_per_frame = 1",
            "steps_per_frame = 1.0",
            "estimator.steps_per_frame: 1.0 must be a valid integer",
        ),
        (
            "direction = [0, 0, -1]",
            "direction = [0, 0, 0]",
            "contact[0].direction: the direction has no length; use [0, 0, -1] for downwards",
        ),
        (
            'x = ["-30 mm", "30 mm"]',
            'x = ["30 mm", "-30 mm"]',
            "contact[0].workspace.x: the values must ascend",
        ),
        (
            'z = ["0 mm", "0 mm"]',
            'z = ["1 mm", "0 mm"]',
            "body.fixed.z: the first value must not exceed the second",
        ),
        (
            'z = ["0 mm", "0 mm"]',
            "",
            'body.fixed: give a range of x, y or z, such as z = ["0 mm", "0 mm"], or a group',
        ),
        (
            "[contact.workspace]",
            "[contact.works]",
            'contact[0].works: unknown key, did you mean "workspace"?',
        ),
    ],
)
def test_a_mistake_is_told_with_its_key(write: Write, old: str, new: str, told: str) -> None:
    path = write((old, new))
    with pytest.raises(ConfigError) as caught:
        load(path)
    assert f"{path}: {told}" in str(caught.value).split("\n")


def test_a_single_mistake_is_one_line(write: Write) -> None:
    with pytest.raises(ConfigError) as caught:
        load(write(("poisson = 0.49", "poisson = 0.5")))
    assert "\n" not in str(caught.value)


def test_every_mistake_has_its_line(write: Write) -> None:
    path = write(
        ("poisson = 0.49", "poisson = 0.5"), ('radius = "10 mm"', 'radius = "10 s"'), ("[robot]\n", "")
    )
    with pytest.raises(ConfigError) as caught:
        load(path)
    lines = str(caught.value).split("\n")
    assert [line.removeprefix(f"{path}: ").split(":")[0] for line in lines] == [
        "robot",
        "body.material[0].poisson",
        "contact[0].radius",
        "name",
    ]


@pytest.mark.parametrize(
    ("constants", "told"),
    [
        (
            'law = "yeoh"\nc1 = "92 kPa"\nc2 = "9 kPa"\nc3 = "-0.4 kPa"',
            "body.material[0]: give either poisson or bulk, the stiffness against change of volume",
        ),
        (
            'law = "mooney-rivlin"\nc10 = "9 kPa"\nc01 = "-20 kPa"\npoisson = 0.49',
            "body.material[0]: the constants give the shear modulus -2.2e+04 Pa: it must be positive",
        ),
        (
            'law = "mooney-rivlin"\nc10 = "9 kPa"\nc01 = "20 kPa"\nbulk = "10 kPa"',
            "body.material[0]: Lamé's λ is -2.867e+04 Pa: a Taylor-Hood element needs a positive one; "
            'raise poisson or bulk, or set body.element = "quadratic"',
        ),
        (
            'law = "ogden"\nmu = ["9 kPa"]\nalpha = [2, -2]\npoisson = 0.49',
            "body.material[0].alpha: 2 exponents for 1 values of mu: give one of each per term",
        ),
        (
            'law = "ogden"\nmu = ["9 kPa"]\nalpha = [0]\npoisson = 0.49',
            "body.material[0].alpha: an exponent of 0 has no energy: remove the term",
        ),
        (
            'law = "neo-hookean"\nyoung = "1 MPa"\npoisson = 0.4\nc1 = "9 kPa"',
            "body.material[0].c1: unknown key, the known ones are density, young, poisson, law",
        ),
    ],
)
def test_wrong_constants_are_told(write: Write, pad_text: str, constants: str, told: str) -> None:
    start, end = pad_text.index("[[body.material]]"), pad_text.index("[body.fixed]")
    path = write((pad_text[start:end], f"[[body.material]]\n{constants}\n"))
    with pytest.raises(ConfigError) as caught:
        load(path)
    assert str(caught.value) == f"{path}: {told}"


def test_files_are_found_from_the_folder_of_the_config(tmp_path: Path, pad_text: str) -> None:
    start, end = pad_text.index("[body.source]"), pad_text.index("# One material")
    source = '[body.source]\ntype = "mesh"\nfile = "meshes/body.vtu"\nunit = "mm"\n'
    path = tmp_path / "robot.toml"
    path.write_text(pad_text[:start] + source + pad_text[end:], encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        load(path)
    body = tmp_path / "meshes" / "body.vtu"
    assert str(caught.value) == (
        f"{path}: body.source.file: there is no file {body}; "
        "paths are relative to the folder of the configuration"
    )
    body.parent.mkdir()
    body.touch()
    found = load(path).body.source
    assert found.type == "mesh" and found.file == body and found.unit == 1e-3


def test_what_is_no_toml_is_told_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text('[robot]\nname = "a\n')
    with pytest.raises(ConfigError, match=rf"^{path}: not valid TOML: .*\(at line 2, column 10\)$"):
        load(path)
    path.write_bytes(b"name = '\xff'")
    with pytest.raises(ConfigError, match=rf"^{path}: not valid TOML: it is not UTF-8 text$"):
        load(path)


def test_a_file_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=rf"^{tmp_path}/no.toml: cannot be read: No such file"):
        load(tmp_path / "no.toml")
    with pytest.raises(ConfigError, match=rf"^{tmp_path}: cannot be read: Is a directory"):
        load(tmp_path)


def test_settings_do_not_change_after_loading(write: Write) -> None:
    config = load(write())
    with pytest.raises(ValueError, match="frozen"):
        config.body.materials[0].density = 1.0
