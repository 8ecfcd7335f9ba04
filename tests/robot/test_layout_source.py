"""A body that is a layout: its settings, its mesh, and that it is nearly the pad with the pad's cavities."""

from collections.abc import Callable
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.errors import ConfigError
from softfuse.functional.cavity import Cavity
from softfuse.functional.chart import facing
from softfuse.mechanics.model import simulate
from softfuse.robot.file import load
from softfuse.robot.mesh import RobotMesh, build_mesh
from softfuse.robot.robot import build_robot

Layout = Callable[..., Path]

BOX = 'profile = "rounded-box"\nhalf = ["14 mm", "14 mm", "3 mm"]\nfillet = "0.3 mm"\n'
BEAN = 'profile = "superellipsoid"\nhalf = ["13 mm", "12 mm", "3 mm"]\nroundness = 0.4\n'
SOURCE = """[body.source]
type = "layout"
size = ["80 mm", "80 mm", "18 mm"]
surface_size = "30 mm"
growth = 0.5
base_size = "28 mm"
"""


@pytest.fixture
def layout(pad_text: str, tmp_path: Path) -> Layout:
    """layout(shape, ..., (old, new), ...): configs/pad.toml with a coarse layout of such shapes."""
    start, end = pad_text.index("[body.source]"), pad_text.index("# One material")

    def write(*parts: str | tuple[str, str]) -> Path:
        shapes = [f"[[body.source.shape]]\n{part}" for part in parts if isinstance(part, str)]
        text = pad_text[:start] + SOURCE + "\n".join(shapes) + "\n" + pad_text[end:]
        for old, new in (part for part in parts if not isinstance(part, str)):
            assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times in the configuration"
            text = text.replace(old, new)
        path = tmp_path / "layout.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def volumes(made: RobotMesh) -> np.ndarray:
    nodes = jnp.asarray(made.mesh.nodes)
    return np.array([float(Cavity(jnp.asarray(wall.faces))(nodes)) for wall in made.cavities])


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (
            [BOX] * 3,
            "body.source.shape: 3 shapes for 4 cavities: give one for each [[chamber]], in their order",
        ),
        ([], "body.source.shape: missing"),
        (
            [BOX.replace("rounded-box", "box"), *[BOX] * 3],
            'body.source.shape[0].profile: "box" is none of "rounded-box", "superellipsoid"',
        ),
        ([BOX, BOX.replace('fillet = "0.3 mm"', ""), BOX, BOX], "body.source.shape[1].fillet: missing"),
        (
            [BOX, BOX.replace("0.3 mm", "3.1 mm"), BOX, BOX],
            "body.source.shape[1].fillet: 3.1 mm has no room in half-sizes of 3 mm: make it smaller",
        ),
        (
            [BEAN + 'draft = "1 mm"\n', BOX, BOX, BOX],
            "body.source.shape[0].draft: unknown key, the known ones are half, turn, harmonics, profile, "
            "roundness",
        ),
        (
            [BEAN.replace("0.4", "1.2"), BOX, BOX, BOX],
            "body.source.shape[0].roundness: 1.2 must be less than or equal to 1",
        ),
        (
            [BOX.replace('"3 mm"', '"-3 mm"'), BOX, BOX, BOX],
            'body.source.shape[0].half[2]: "-3 mm" must be greater than 0',
        ),
        (
            [BOX + 'turn = ["0 deg", "0 deg", "1 mm"]\n', BOX, BOX, BOX],
            'body.source.shape[0].turn[2]: "1 mm" is a length, expected an angle such as "1 deg"',
        ),
        (
            [BOX + "harmonics = [0.1, 0, 0]\n", BOX, BOX, BOX],
            "body.source.shape[0].harmonics: 3 values are of no whole degree: give 5 (to degree 2)",
        ),
        (
            [BOX + "harmonics = [0, 0, 0, 0, 0, 0]\n", BOX, BOX, BOX],
            "body.source.shape[0].harmonics: 6 values are of no whole degree: give 5 (to degree 2) or 12 (to "
            "degree 3)",
        ),
        (
            [BOX + "harmonics = [0, 0, 0, 0, 9]\n", BOX, BOX, BOX],
            "body.source.shape[0].harmonics[4]: 9 must be less than or equal to 1",
        ),
    ],
)
def test_a_mistake_is_told_with_its_key(layout: Layout, wrong: list[str], told: str) -> None:
    path = layout(*wrong)
    with pytest.raises(ConfigError) as caught:
        load(path)
    assert str(caught.value) == f"{path}: {told}"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shape", "told"),
    [
        (
            BOX.replace('"14 mm", "14 mm"', '"14 mm", "21 mm"'),
            "no wall is left between cavity 0 and cavity 1 (they overlap by 1 mm): move the cavity away, or "
            "make it smaller",
        ),
        (
            BOX.replace('"3 mm"', '"9.5 mm"'),
            "no wall is left between cavity 0 and low z (they overlap by 0.5 mm): move the cavity away, or "
            "make it smaller",
        ),
        (BOX + 'turn = ["0 deg", "0 deg", "45 deg"]\n', "a tetrahedron near"),
        (BOX + 'turn = ["80 deg", "0 deg", "0 deg"]\n', "no wall is left between cavity 0 and low z"),
    ],
)
def test_a_layout_that_cannot_be_meshed_is_told(layout: Layout, shape: str, told: str) -> None:
    path = layout(shape, BOX, BOX, BOX)
    with pytest.raises(ConfigError) as caught:
        build_mesh(load(path))
    assert str(caught.value).startswith(f"{path}: body.source: {told}")


def test_a_layout_of_the_pads_boxes_is_nearly_the_pad(layout: Layout) -> None:
    made = build_mesh(load(layout(*[BOX] * 4)))
    skin = made.mesh.nodes[made.mesh.nodes[:, 2] == 0.018]
    assert made.mesh.order == 2 and np.ptp(skin, axis=0)[:2] == pytest.approx([0.08, 0.08], abs=1e-15)
    np.testing.assert_array_equal(made.fixed, made.mesh.nodes[:, 2] < 1e-9)
    # Nodes on the rims lie (1 - 1/√2) of a fillet inside the box's edges, and faces go on from there without
    # a kink: less than so much of every face's border is lost, over faces of 2240 mm².
    lost = (1 - np.sqrt(0.5)) * 0.3e-3 * 2240e-6
    assert (volumes(made) < 4704e-9).all() and (volumes(made) > 4704e-9 - lost).all()
    np.testing.assert_allclose(volumes(made), volumes(made)[0], rtol=1e-6)


@pytest.mark.slow
def test_a_layout_of_the_pads_boxes_answers_nearly_as_the_pad(layout: Layout, write: Layout) -> None:
    coarse = (
        ('surface_size = "12 mm"', 'surface_size = "30 mm"'),
        ('base_size = "12 mm"', 'base_size = "28 mm"'),
    )
    at, force = jnp.asarray(facing(np.array([[10e-3, -6e-3, 0.0]]), (0, 0, -1))), jnp.array([1.0])

    def answer(path: Path) -> np.ndarray:
        model = build_robot(load(path)).model
        return np.asarray(model.reading(simulate(model, at, force).state, at))

    pad = answer(write(*coarse, ('fine_depth = "3 mm"', 'fine_depth = "0 mm"')))
    # A roof is clamped along the rim, which a fillet moves inwards by (1 - 1/√2) of it on both sides: a span
    # of 28 mm shrinks by 0.63 %. The volume under a clamped plate goes with the fourth to sixth power of its
    # span (a point's force to equal pressure), 2.5 to 3.7 %.
    apart = np.abs(answer(layout(*[BOX] * 4)) - pad).max() / np.abs(pad).max()
    assert 0.02 < apart < 0.04
    smaller = [BOX.replace("0.3 mm", "0.1 mm")] * 4
    assert np.abs(answer(layout(*smaller)) - pad).max() / np.abs(pad).max() < 0.5 * apart


def test_curved_cavities_are_as_they_were_made(layout: Layout) -> None:
    turned = BEAN + 'turn = ["0 deg", "0 deg", "5 deg"]\n'
    drawn = build_mesh(load(layout(BOX, turned, BOX, BEAN)))
    differs = 'shift = ["0.4 mm", "-0.2 mm", "0.3 mm"]\ngrowth = ["0.1 mm", "0 mm", "-0.5 mm"]'
    made = build_mesh(load(layout(BOX, turned, BOX, BEAN, ('name = "(-,+)"', f'name = "(-,+)"\n{differs}'))))
    np.testing.assert_array_equal(made.mesh.tets, drawn.mesh.tets)
    walls = [np.unique(wall.faces) for wall in drawn.cavities]
    before, after = drawn.mesh.nodes[walls[1]], made.mesh.nodes[walls[1]]
    low, high = before.min(axis=0), before.max(axis=0)
    middle, stretch = 0.5 * (low + high), 1 + np.array([0.1e-3, 0.0, -0.5e-3]) / (high - low)
    # All nodes of the wall, those in the middle of its curved edges too.
    moved = middle + [0.4e-3, -0.2e-3, 0.3e-3] + (before - middle) * stretch
    np.testing.assert_allclose(after, moved, atol=1e-14)
    assert volumes(made)[1] == pytest.approx(volumes(drawn)[1] * stretch.prod(), rel=1e-9)
    np.testing.assert_allclose(np.delete(volumes(made), 1), np.delete(volumes(drawn), 1), rtol=1e-12)
