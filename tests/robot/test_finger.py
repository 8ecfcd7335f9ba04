"""The finger's configuration: what is read, the mesh that follows, and how mistakes are told."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from softfuse.errors import ConfigError
from softfuse.mesh.quality import mesh_quality
from softfuse.mesh.surface import centroid, enclosed_volume
from softfuse.mesh.tetmesh import volumes
from softfuse.robot.file import load
from softfuse.robot.mesh import build_mesh

Write = Callable[..., Path]

TIP_LEFT = '["90 mm", "5 mm", "12.5 mm"]'
TIP_RIGHT = '["90 mm", "-5 mm", "12.5 mm"]'


def test_the_finger_is_that_of_the_design(write_finger: Write) -> None:
    config = load(write_finger())
    source = config.body.source
    assert source.type == "finger"
    assert (source.size, source.cavity_size) == ((0.12, 0.02, 0.02), (0.008, 0.006, 0.01))
    assert (source.neck_x, source.neck_length, source.neck_height) == ((0.03, 0.06, 0.09), 0.012, 0.015)
    assert [(c.name, c.centre) for c in config.chambers] == [
        (f"{neck} {side}", (x, y, 0.0125))
        for neck, x in (("base", 0.03), ("middle", 0.06), ("tip", 0.09))
        for side, y in (("left", 0.005), ("right", -0.005))
    ]
    (material,) = config.body.materials
    assert (material.law, material.density) == ("neo-hookean", 1080.0)
    assert material.lame == pytest.approx(0.6e6 * 0.49 / (1.49 * 0.02))
    assert config.body.element == "taylor-hood"
    assert config.environment.gravity == (0.0, 0.0, 0.0)


def test_the_mesh_has_its_cavities_in_order_and_is_held_at_its_base(write_finger: Write) -> None:
    config = load(write_finger())
    model = build_mesh(config)
    mesh = model.mesh
    assert mesh.order == 2
    assert len(mesh.nodes) <= 7500
    assert mesh_quality(mesh).mean_ratio.least > 0.15
    assert volumes(mesh).sum() == pytest.approx(41_520e-9)
    for cavity, settings in zip(model.cavities, config.chambers, strict=True):
        assert enclosed_volume(mesh.nodes, cavity.faces) == pytest.approx(480e-9)
        np.testing.assert_allclose(centroid(mesh.nodes, cavity.faces), settings.centre, atol=1e-12)
    np.testing.assert_array_equal(model.fixed, mesh.nodes[:, 0] < 1e-9)


def test_cavities_may_be_listed_in_any_order_and_lie_at_any_height(write_finger: Write) -> None:
    swap = (TIP_LEFT, '["90 mm", "-5 mm", "13.5 mm"]'), (TIP_RIGHT, '["90 mm", "5 mm", "11.5 mm"]')
    config = load(write_finger(*swap))
    model = build_mesh(config)
    found = [centroid(model.mesh.nodes, cavity.faces) for cavity in model.cavities]
    np.testing.assert_allclose(found, [c.centre for c in config.chambers], atol=1e-12)


def test_sizes_and_growth_reach_the_mesh(write_finger: Write) -> None:
    def count(*changes: tuple[str, str]) -> int:
        return len(build_mesh(load(write_finger(*changes))).mesh.nodes)

    default = count()
    assert count(("growth = 2.0 ", "")) == default
    assert count(("growth = 2.0", "growth = 0.5")) > default
    assert count(('wall_size = "10 mm"', 'wall_size = "6 mm"')) > default
    assert count(('base_size = "8 mm"', 'base_size = "6 mm"')) > default


def test_a_solid_finger_needs_no_cavities(write_finger: Write, finger_text: str) -> None:
    model = build_mesh(load(write_finger((finger_text[finger_text.index("[[chamber]]\nname") :], ""))))
    assert model.cavities == ()
    assert volumes(model.mesh).sum() == pytest.approx(44_400e-9)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (
            'neck_x = ["30 mm", "60 mm", "90 mm"]',
            "neck_x = []",
            "neck_x: the list is empty: give at least one",
        ),
        ('neck_x = ["30 mm"', 'neck_x = ["30 s"', 'neck_x[0]: "30 s" is a time, expected a length such as'),
        ('neck_length = "12 mm"', 'neck_length = "0 mm"', 'neck_length: "0 mm" must be greater than 0'),
        ("growth = 2.0", "growth = -1.0", "growth: -1.0 must be greater than or equal to 0"),
        ("neck_height =", "neck_hight =", 'neck_hight: unknown key, did you mean "neck_height"?'),
        (
            'type = "finger"',
            'type = "thumb"',
            'type: "thumb" is none of "pad", "finger", "surface", "mesh", "layout"',
        ),
    ],
)
def test_a_mistake_is_told_with_its_key(write_finger: Write, old: str, new: str, told: str) -> None:
    path = write_finger((old, new))
    with pytest.raises(ConfigError) as caught:
        load(path)
    assert any(line.startswith(f"{path}: body.source.{told}") for line in str(caught.value).split("\n"))


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('neck_height = "15 mm"', 'neck_height = "25 mm"', "the necks are 25 mm high, the finger 20 mm"),
        ('neck_length = "12 mm"', 'neck_length = "30 mm"', "necks 0 and 1 leave no segment between them"),
        (TIP_LEFT, '["90 mm", "5 mm", "10 mm"]', "cavity 4 at [90.0, 5.0, 10.0] mm cuts the notch from"),
        (TIP_LEFT, '["90 mm", "8 mm", "12.5 mm"]', "cavity 4 at [90.0, 8.0, 12.5] mm reaches the surface"),
        (TIP_LEFT, '["90 mm", "0 mm", "12.5 mm"]', "cavities 4 and 5 touch: leave a wall between them"),
    ],
)
def test_an_impossible_finger_is_told_with_its_key(
    write_finger: Write, old: str, new: str, told: str
) -> None:
    config = load(write_finger((old, new)))
    with pytest.raises(ConfigError) as caught:
        build_mesh(config)
    assert str(caught.value).startswith(f"{config.path}: body.source: {told}")
