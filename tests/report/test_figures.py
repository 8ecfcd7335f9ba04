"""What is drawn of a body in space, and over time."""

import warnings

import numpy as np

from softfuse.experiment.accuracy import Spread
from softfuse.mesh.pad import PadGeometry, pad_mesh
from softfuse.mesh.surface import outer_surface
from softfuse.report.figures import Panel, drift_over_time, electrode_image, over_time, points_over_depth
from softfuse.report.page import picture, spread_table
from softfuse.report.shape_figures import Shape, shapes, sharp_edges
from softfuse.sensors.base import Image

MM = 1e-3
MESH = pad_mesh(
    PadGeometry((70 * MM, 40 * MM, 18 * MM), (26 * MM, 28 * MM, 6 * MM), ((-17 * MM, 0.0),), 6 * MM),
    40 * MM,
    40 * MM,
)
FACES = outer_surface(MESH).faces


def test_the_sharp_edges_of_a_block_are_those_of_its_box() -> None:
    edges = MESH.nodes[sharp_edges(MESH.nodes, FACES)]
    ends = np.abs(edges - [0, 0, 9 * MM]) / [35 * MM, 20 * MM, 9 * MM]
    # Both ends lie on the same two sides of the box, and there is nothing else.
    assert ((np.isclose(ends, 1).all(axis=1)).sum(axis=1) == 2).all()
    length = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1).sum()
    np.testing.assert_allclose(length, 4 * (70 + 40 + 18) * MM)


def test_shapes_are_drawn_with_and_without_forces_and_truth() -> None:
    nothing, point = np.zeros((0, 3)), np.array([[0.0, 0.0, 18 * MM]])
    still = Shape("at rest", MESH.nodes, nothing, None, nothing, nothing)
    pushed = Shape("pushed", 1.1 * MESH.nodes, point, point * np.nan, point, np.array([[0.0, 0.0, -2.0]]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for seen in ([still], [still, pushed]):
            assert "data:image/png" in picture(shapes(MESH.nodes, FACES, seen), "shapes")


def test_each_push_has_its_lines() -> None:
    press, depth = np.array([0, 0, 1]), np.array([5.0, 10.0, 5.0])
    moved = np.zeros((3, 2, 3))
    figure = points_over_depth(press, depth, press > 0, moved, moved + 1, ["a", "b"], "depth [mm]")
    assert len(figure.axes) == 6 and all(len(axes.lines) == 4 for axes in figure.axes)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["push 0, without cable", "push 1, with cable"]


def test_panels_are_drawn_with_and_without_what_is_beneath() -> None:
    time, lines = np.arange(3.0), np.ones((3, 2))
    figure = over_time(
        time,
        [Panel("force [N]", ["a", "b"], lines), Panel("tension [N]", ["a", "b"], lines, np.nan * lines)],
    )
    above, below = figure.axes
    assert len(above.lines) == 2 and len(below.lines) == 4
    assert above.get_title() == "wide: true, thin: estimated" and below.get_xlabel() == "time [s]"
    assert "data:image/png" in picture(figure, "forces")


def test_drift_has_bands_in_its_unit() -> None:
    figure = drift_over_time(np.arange(3.0), np.ones((3, 1)), np.ones((3, 1)), ["a"], "mm³")
    (axes,) = figure.axes
    assert axes.get_ylabel() == "drift [mm³]" and len(axes.collections) == 1


def test_an_image_with_both_signs_has_colours_of_both() -> None:
    for values, name in ((np.ones((2, 3)), "viridis"), (np.array([[1.0, -1, 0], [0, 0, 0]]), "RdBu_r")):
        image = Image(values, MM * np.arange(3), MM * np.arange(2))
        assert electrode_image(image).axes[0].collections[0].get_cmap().name == name


def test_a_group_without_estimates_is_told_as_unknown():
    html = spread_table("mm", {"all": Spread(float("nan"), float("nan"), 0), "level_1": Spread(1.0, 0.25, 3)})
    assert "<td>all</td><td>–</td><td>–</td><td>0</td>" in html
    assert "<td>level_1</td><td>1.00</td><td>0.25</td><td>3</td>" in html
