"""Cells cover their workspace, each place is in one of them, and a place near an edge stays where it was."""

import numpy as np
import pytest

from softfuse.functional.chart import FlatChart, facing, moved
from softfuse.rom.cells import Cells

CELLS = Cells.over((-0.03, -0.01), (0.03, 0.01), 8e-3)


def place(x: float, y: float) -> np.ndarray:
    """A place (3, 3) [m]."""
    return facing(np.array([x, y, 0.0]), (0, 0, -1))


def test_cells_fill_the_workspace_and_none_is_larger_than_asked() -> None:
    assert CELLS.counts == (8, 3) and len(CELLS) == 24
    corners = np.concatenate([cell.at(np.array([[-1.0, -1.0], [1.0, 1.0]]))[:, 0] for cell in CELLS])
    np.testing.assert_allclose(corners.min(axis=0), [-0.03, -0.01, 0.0], atol=1e-15)
    np.testing.assert_allclose(corners.max(axis=0), [0.03, 0.01, 0.0], atol=1e-15)
    assert sum(np.prod(2 * cell.half) for cell in CELLS) == pytest.approx(0.06 * 0.02)
    assert Cells.over((0.0, 0.0), (0.02, 0.01), 0.01).counts == (2, 1)  # not one more by rounding


def test_each_place_is_in_the_cell_that_it_is_found_in() -> None:
    random = np.random.default_rng(0)
    for x, y in random.uniform((-0.03, -0.01), (0.03, 0.01), (50, 2)):
        number = CELLS.find(place(x, y))
        assert number is not None
        cell = CELLS[number]
        assert np.all(np.abs(np.array([x, y]) - cell.centre[:2]) <= cell.half * (1 + 1e-12))


def test_a_place_that_has_hardly_left_its_cell_stays_in_it() -> None:
    cell, edge = CELLS[4], CELLS[4].at(np.array([1.0, 0.0]))
    step = np.array([cell.half[0], 0.0])
    assert CELLS.find(moved(edge, 0.05 * step)) == 7
    assert CELLS.find(moved(edge, 0.05 * step), before=4) == 4
    assert CELLS.find(moved(edge, 0.2 * step), before=4) == 7
    reached = cell.grid(3)[:, 0, 0].max()
    assert CELLS.find(place(reached - 1e-9, edge[0, 1]), before=4) == 4
    assert CELLS.find(place(reached + 1e-9, edge[0, 1]), before=4) == 7


@pytest.mark.parametrize("direction", [(0, 1, 0), (-1, 0, 0), (0, 0, 1), (1, 2, -2)])
def test_cells_are_across_any_direction(direction) -> None:
    """In the chart that a contact's workspace is given in."""
    cells, chart = Cells.over((-0.03, -0.01), (0.03, 0.01), 8e-3, direction), FlatChart.along(direction)
    for number, cell in enumerate(cells):
        middle = cells.middle(number)
        np.testing.assert_allclose(
            middle, facing(np.asarray(cell.centre @ chart.axes), direction), atol=1e-15
        )
        assert (
            cells.find(middle) == number and cell.holds(cell.at(np.array([[0.9, -0.9], [-1.0, 1.0]]))).all()
        )


def test_outside_there_is_no_cell_and_no_number() -> None:
    assert CELLS.find(place(0.0, 0.011)) is None
    assert CELLS.find(place(0.0, 0.0101)) is not None  # on the edge up to noise
    with pytest.raises(IndexError, match="cell 24 of 24"):
        CELLS[24]
