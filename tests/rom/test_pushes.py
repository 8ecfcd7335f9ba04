"""Pushes at an electrode, with a cable that pulls and drives that stay, cover what they are to teach."""

import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.rom.cells import Electrodes
from softfuse.rom.load_paths import pushes

LOW = np.array([0.0, 0.0, 0.0, 1e5, 1e5])
HIGH = np.array([2.0, 2.0, 6.0, 1e5, 1e5])
"""Two patches, a cable, two cavities' gas."""


@pytest.fixture
def paths():
    return pushes(jnp.array([3]), 2, LOW, HIGH, levels=4, near=10)


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
        assert path.near_places.shape == (4, 10, 1) and np.all(path.near_places == 3)


def test_several_cables_pull_one_by_one_and_together() -> None:
    paths = pushes(jnp.array([0]), 1, np.zeros(3), np.ones(3), levels=2, near=1)
    pulls = {tuple(path.levels[-1, 1:]) for path in paths}
    assert pulls == {(0, 0), (0.5, 0), (1, 0), (0, 0.5), (0, 1), (0.5, 0.5), (1, 1)}


def test_an_electrode_is_a_region_by_itself() -> None:
    regions = Electrodes(12)
    assert len(regions) == 12
    assert [regions.find(jnp.array(place)) for place in (0, 11)] == [0, 11]
    assert regions.find(np.int32(4), before=7) == 4
