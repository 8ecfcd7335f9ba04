"""Pushes at an electrode, with a cable that pulls and drives that stay, cover what they are to teach."""

import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.functional.chart import facing, moved
from softfuse.rom.cells import Cells, Spots
from softfuse.rom.load_paths import ends, load_paths

LOW = np.array([0.0, 0.0, 0.0, 1e5, 1e5])
HIGH = np.array([2.0, 2.0, 6.0, 1e5, 1e5])
"""Two patches, a cable, two cavities' gas."""
PLACES = facing(np.stack([1e-2 * np.arange(12.0), *np.zeros((2, 12))], axis=1), (0, 0, -1))
"""Middles of electrodes."""


@pytest.fixture
def paths():
    return load_paths(Spots(PLACES).parts(3, 3), 2, LOW, HIGH, levels=4, near=10)


def test_the_force_is_on_either_patch_or_on_both_with_and_without_the_cable(paths) -> None:
    ends = {tuple(path.levels[-1, :3]) for path in paths}
    forces, tensions = ((2.0, 0.0), (0.0, 2.0), (1.0, 1.0), (0.0, 0.0)), (0.0, 3.0, 6.0)
    assert ends == {(*f, t) for f in forces for t in tensions} - {(0.0, 0.0, 0.0)}
    for path in paths:
        np.testing.assert_allclose(path.levels[:, :3], np.outer([0.25, 0.5, 0.75, 1], path.levels[-1, :3]))
        assert np.all(path.levels[:, 3:] == 1e5) and np.all(path.near_drives[..., 3:] == 1e5)


def test_what_is_near_stays_within_half_a_level_and_the_limits(paths) -> None:
    for path in paths:
        away = (path.near_drives - path.levels[:, None])[..., :3]
        assert np.abs(away).max() <= 0.125 * 6 and np.ptp(away[..., 2]) > 0.1 * 6 / 4
        assert np.all((path.near_drives >= LOW) & (path.near_drives <= HIGH))
        assert path.near_places.shape == (4, 10, 1, 3, 3) and np.all(path.near_places == PLACES[3])


def test_several_cables_pull_one_by_one_and_together() -> None:
    pulls = {tuple(end[1:]) for end in ends(1, np.zeros(3), np.ones(3))}
    assert pulls == {(0, 0), (0.5, 0), (1, 0), (0, 0.5), (0, 1), (0.5, 0.5), (1, 1)}


def test_forces_aside_are_tried_at_both_limits_beside_the_whole_force() -> None:
    low, high = np.array([0.0, -2.0, -2.0]), np.full(3, 2.0)
    found = {tuple(end) for end in ends(3, low, high)}
    assert found == {(2, 0, 0), (2, 2, 0), (2, -2, 0), (2, 0, 2), (2, 0, -2)}


def test_a_chamber_is_taught_at_either_gauge_pressure() -> None:
    found = {tuple(end) for end in ends(1, np.array([0.0, -2.0]), np.array([1.0, 4.0]))}
    assert found == {(force, p) for force in (0, 1) for p in (-2, -1, 0, 2, 4)} - {(0, 0)}


def test_presses_are_all_over_a_cell_and_what_pulls_alone_is_there_once() -> None:
    cell = Cells.over((0.0, 0.0), (4e-3, 4e-3), 4e-3)
    paths = load_paths(cell.parts(0, 2), 1, np.zeros(2), np.array([5.0, 3.0]), levels=2, near=8)
    pressed = [path for path in paths if path.levels[-1, 0] > 0]
    assert len(pressed) == 4 * 3 and len(paths) == len(pressed) + 2
    middles = np.unique([np.asarray(path.place)[0, 0, :2] for path in pressed], axis=0)
    np.testing.assert_allclose(middles, 1e-3 * np.array([(1, 1), (1, 3), (3, 1), (3, 3)]), atol=1e-12)
    for path in pressed:
        away = np.asarray(path.near_places[:, :, 0, 0, :2] - path.place[0, 0, :2])
        assert 0.8e-3 < np.abs(away).max() <= 1.15e-3
        assert np.all(path.near_drives >= 0) and np.all(path.near_drives <= [5.0, 3.0])


def test_what_is_nearest_to_an_electrode_is_its_region() -> None:
    regions = Spots(PLACES)
    assert len(regions) == 12
    assert [regions.find(jnp.asarray(place)) for place in PLACES[[0, 11]]] == [0, 11]
    assert regions.find(PLACES[4], before=7) == 4
    assert regions.find(moved(PLACES[4], np.array([4e-3, 9e-3]))) == 4
    assert regions.find(moved(PLACES[4], np.array([6e-3, 0.0]))) == 5
