"""From settings to the mesh of a body: chambers, held nodes, and what files give."""

from collections.abc import Callable
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from manifold3d import Manifold

from softfuse.errors import ConfigError
from softfuse.functional.cavity import Cavity
from softfuse.mesh.files import write_mesh, write_surface
from softfuse.mesh.overlap import outline
from softfuse.mesh.shell import Shell, shell_of
from softfuse.mesh.surface import centroid, enclosed_volume
from softfuse.mesh.tetmesh import linear, tet_mesh, volumes
from softfuse.robot.file import load
from softfuse.robot.mesh import build_mesh

Write = Callable[..., Path]

COARSE = (
    ('surface_size = "12 mm"', 'surface_size = "30 mm"'),
    ('base_size = "12 mm"', 'base_size = "28 mm"'),
)


def test_the_pad_has_its_cavities_in_order(write: Write) -> None:
    config = load(write())
    made = build_mesh(config)
    mesh = made.mesh
    assert mesh.order == 2
    assert len(mesh.nodes) <= 5000
    assert volumes(mesh).sum() == pytest.approx(0.08 * 0.08 * 0.018 - 4 * 0.028**2 * 0.006)
    for cavity, settings in zip(made.cavities, config.chambers, strict=True):
        assert enclosed_volume(mesh.nodes, cavity.faces) == pytest.approx(0.028**2 * 0.006)
        np.testing.assert_allclose(centroid(mesh.nodes, cavity.faces), settings.centre, atol=1e-12)
    np.testing.assert_array_equal(made.fixed, mesh.nodes[:, 2] < 1e-9)


def test_the_order_of_the_config_is_that_of_the_volumes(write: Write) -> None:
    swap = (
        ('["-17 mm", "-17 mm", "9 mm"]', '["17 mm", "17 mm", "9.0 mm"]'),
        ('["17 mm", "17 mm", "9 mm"]', '["-17 mm", "-17 mm", "9 mm"]'),
    )
    config = load(write(*COARSE, *swap))
    made = build_mesh(config)
    found = [centroid(made.mesh.nodes, cavity.faces) for cavity in made.cavities]
    np.testing.assert_allclose(found, [c.centre for c in config.chambers], atol=1e-12)


def test_cavities_are_as_they_were_made(write: Write) -> None:
    made = (
        'name = "(-,+)"',
        'name = "(-,+)"\nshift = ["0.4 mm", "-0.2 mm", "0.3 mm"]\ngrowth = ["0.1 mm", "0 mm", "-0.5 mm"]',
    )
    config = load(write(*COARSE, made))
    made = build_mesh(config)
    boxes = np.array([np.ptp(made.mesh.nodes[c.faces].reshape(-1, 3), axis=0) for c in made.cavities])
    middles = [centroid(made.mesh.nodes, c.faces) for c in made.cavities]
    drawn = np.array([cavity.centre for cavity in config.chambers])
    np.testing.assert_allclose(boxes[1], [28.1e-3, 28e-3, 5.5e-3], atol=1e-12)
    np.testing.assert_allclose(boxes[[0, 2, 3]], np.full((3, 3), [28e-3, 28e-3, 6e-3]), atol=1e-12)
    np.testing.assert_allclose(middles[1], drawn[1] + [0.4e-3, -0.2e-3, 0.3e-3], atol=1e-12)
    np.testing.assert_allclose(middles[2], drawn[2], atol=1e-12)


def test_a_cavity_that_does_not_fit_as_made_is_told(write: Write) -> None:
    path = write(*COARSE, ('name = "(-,+)"', 'name = "(-,+)"\nshift = ["0 mm", "0 mm", "15 mm"]'))
    with pytest.raises(ConfigError) as caught:
        build_mesh(load(path))
    assert str(caught.value).startswith(
        f"{path}: chamber: the cavities are shifted too far or grown too much"
    )


def test_linear_elements_get_a_linear_mesh(write: Write) -> None:
    config = load(write(*COARSE, ('element = "taylor-hood" ', 'element = "linear" ')))
    assert build_mesh(config).mesh.order == 1


def test_fixed_ranges_are_joined_by_and(write: Write) -> None:
    held = build_mesh(
        load(write(*COARSE, ('z = ["0 mm", "0 mm"]', 'x = ["-40 mm", "0 mm"]\nz = ["0 mm", "6 mm"]')))
    )
    x, z = held.mesh.nodes[:, 0], held.mesh.nodes[:, 2]
    np.testing.assert_array_equal(held.fixed, (x < 1e-9) & (z < 6e-3 + 1e-9))


@pytest.mark.parametrize(
    ("fixed", "told"),
    [
        ('z = ["-2 mm", "-1 mm"]', "no node of the mesh is in these ranges (and group); it reaches from"),
        ('z = ["0 mm", "18 mm"]', "all nodes of the mesh are held: narrow the ranges"),
    ],
)
def test_a_wrong_fixed_region_is_told(write: Write, fixed: str, told: str) -> None:
    path = write(*COARSE, ('z = ["0 mm", "0 mm"]', fixed))
    with pytest.raises(ConfigError) as caught:
        build_mesh(load(path))
    assert str(caught.value).startswith(f"{path}: body.fixed: {told}")


def test_a_wrong_pad_is_told_with_its_key(write: Write) -> None:
    path = write(('cavity_size = ["28 mm", "28 mm", "6 mm"]', 'cavity_size = ["28 mm", "40 mm", "6 mm"]'))
    with pytest.raises(ConfigError) as caught:
        build_mesh(load(path))
    assert str(caught.value).startswith(f"{path}: body.source: cavities 0 and 1 touch")


def _from_file(pad_text: str, folder: Path, source: str) -> Path:
    start, end = pad_text.index("[body.source]"), pad_text.index("# One material")
    path = folder / "robot.toml"
    path.write_text(pad_text[:start] + "[body.source]\n" + source + pad_text[end:], encoding="utf-8")
    return path


def test_a_mesh_from_a_file_is_the_same_body(write: Write, tmp_path: Path, pad_text: str) -> None:
    pad = build_mesh(load(write(*COARSE))).mesh
    write_mesh(tmp_path / "pad.vtu", tet_mesh(1e3 * pad.nodes, pad.tets, region=7 + pad.region))
    config = load(_from_file(pad_text, tmp_path, 'type = "mesh"\nfile = "pad.vtu"\nunit = "mm"\n'))
    made = build_mesh(config)
    np.testing.assert_allclose(made.mesh.nodes, pad.nodes, atol=1e-15)
    np.testing.assert_array_equal(made.mesh.region, 0)
    assert len(made.cavities) == 4


def test_regions_without_a_material_are_told(write: Write, tmp_path: Path, pad_text: str) -> None:
    pad = build_mesh(load(write(*COARSE))).mesh
    region = np.where(pad.nodes[pad.corners].mean(axis=1)[:, 0] > 0.0, 5, 2)
    write_mesh(tmp_path / "pad.vtu", tet_mesh(pad.nodes, pad.tets, region=region))
    path = _from_file(pad_text, tmp_path, 'type = "mesh"\nfile = "pad.vtu"\nunit = "m"\n')
    with pytest.raises(ConfigError) as caught:
        build_mesh(load(path))
    assert str(caught.value) == (
        f"{path}: body.material: 1 materials for the 2 regions [2, 5] of the mesh: "
        "give one [[body.material]] for each"
    )


def test_another_number_of_cavities_is_told(write: Write, tmp_path: Path, pad_text: str) -> None:
    pad = build_mesh(load(write(*COARSE))).mesh
    write_mesh(tmp_path / "pad.vtu", pad)
    path = _from_file(pad_text, tmp_path, 'type = "mesh"\nfile = "pad.vtu"\nunit = "m"\n')
    extra = '[[chamber]]\nname = "fifth"\ncentre = ["0 mm", "0 mm", "9 mm"]\n\n[[contact]]'
    path.write_text(path.read_text().replace("[[contact]]", extra))
    with pytest.raises(ConfigError) as caught:
        build_mesh(load(path))
    told = f"{path}: chamber: config names 5 cavities, the mesh has 4 closed inner surfaces"
    assert str(caught.value).startswith(told)


def test_a_surface_is_filled(write: Write, tmp_path: Path, pad_text: str) -> None:
    pad = build_mesh(load(write(*COARSE))).mesh
    write_surface(tmp_path / "pad.stl", shell_of(pad), scale=1e3)
    source = 'type = "surface"\nfile = "pad.stl"\nunit = "mm"\nedge_length = "15 mm"\n'
    made = build_mesh(load(_from_file(pad_text, tmp_path, source)))
    assert len(made.cavities) == 4
    assert volumes(made.mesh).sum() == pytest.approx(volumes(pad).sum(), rel=2e-2)
    path = _from_file(pad_text, tmp_path, source.replace('"mm"', '"m"'))
    with pytest.raises(ConfigError, match="body.source: the edge length 15 mm does not suit a body of"):
        build_mesh(load(path))


def test_nodes_are_held_by_a_group_of_the_file(write: Write, tmp_path: Path, pad_text: str) -> None:
    pad = build_mesh(load(write(*COARSE))).mesh
    low = (pad.nodes[:, 2] < 1e-9).astype(np.int32)
    write_mesh(tmp_path / "pad.vtu", linear(pad), point_data={"base": low[: pad.n_corners]})
    source = 'type = "mesh"\nfile = "pad.vtu"\nunit = "m"\n'
    path = _from_file(pad_text, tmp_path, source)
    text = path.read_text()

    def held(fixed: str) -> np.ndarray:
        path.write_text(text.replace('z = ["0 mm", "0 mm"]', fixed))
        return build_mesh(load(path)).fixed

    np.testing.assert_array_equal(held('group = "base"'), low)
    both = held('group = ["base"]\nx = ["-40 mm", "0 mm"]')
    np.testing.assert_array_equal(both, low * (pad.nodes[:, 0] < 1e-9))
    with pytest.raises(ConfigError) as caught:
        held('group = "top"')
    assert str(caught.value) == (
        f'{path}: body.fixed.group: the mesh has no group "top", its groups are: "base"'
    )


CHAMBERED = """
robot.name = "bar"
body.source = {{type = "{type}", file = "{file}", unit = "mm"{edge}}}
body.fixed = {{x = ["0 mm", "0 mm"]}}
body.material = [{{silicone = "Dragon Skin 30"}}]

[[chamber]]
name = "closed"
centre = ["22 mm", "6 mm", "6 mm"]
file = "closed.stl"

[[chamber]]
name = "open"
centre = ["4 mm", "6 mm", "6 mm"]
mouth = {{at = ["0 mm", "6 mm", "6 mm"], outwards = [-1, 0, 0]}}
"""


def test_chambers_come_from_files_and_may_be_open(tmp_path: Path) -> None:
    block = Manifold.cube([30, 12, 12])
    inlet, hole = (
        Manifold.cube([10, 4, 4]).translate([-1, 4, 4]),
        Manifold.cube([8, 6, 6]).translate([18, 3, 3]),
    )
    for name, of in (("body", block - inlet), ("closed", hole)):
        nodes, faces = outline(of)
        write_surface(tmp_path / f"{name}.stl", Shell(nodes, faces))
    path = tmp_path / "bar.toml"
    path.write_text(CHAMBERED.format(type="surface", file="body.stl", edge=', edge_length = "6 mm"'))
    made = build_mesh(load(path))
    of_file = [float(Cavity.of(each.faces)(jnp.asarray(made.mesh.nodes))) for each in made.cavities]
    assert of_file[0] == pytest.approx(288e-9, rel=5e-3)
    # Its rim is only within the mesher's envelope, 0.3 mm of its 9 mm.
    assert of_file[1] == pytest.approx(144e-9, rel=0.03)
    # The same body as a volume mesh, in which the file tells which void is meant.
    write_mesh(tmp_path / "body.vtu", tet_mesh(1e3 * made.mesh.nodes, made.mesh.tets))
    path.write_text(CHAMBERED.format(type="mesh", file="body.vtu", edge=""))
    again = build_mesh(load(path))
    for one, other in zip(made.cavities, again.cavities, strict=True):
        assert {*map(tuple, np.sort(one.faces))} == {*map(tuple, np.sort(other.faces))}
    moved = outline(hole.translate([0, 2, 0]))
    write_surface(tmp_path / "closed.stl", Shell(*moved))
    with pytest.raises(ConfigError, match=r"chamber: the void of 288 mm³ .* is up to 2 mm off it"):
        build_mesh(load(path))
