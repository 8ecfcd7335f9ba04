"""Amplitudes from a few unknowns are those from all where the modes make the shape, and near them else."""

import numpy as np

from softfuse.rom.rom_file import telling, telling_unknowns


def smooth_modes(count: int) -> np.ndarray:
    """Polynomials on a line of 400 unknowns, orthonormal."""
    return np.linalg.qr(np.vander(np.linspace(-1, 1, 400), count))[0]


def test_a_few_unknowns_tell_the_amplitudes_of_what_the_modes_make() -> None:
    modes, amplitudes = smooth_modes(8), np.arange(1.0, 9.0)
    unknowns = telling_unknowns(modes)
    assert len(np.unique(unknowns)) == len(unknowns) == 16
    told = telling(modes, unknowns)
    np.testing.assert_allclose(told.of_them @ (modes @ amplitudes)[told.unknowns], amplitudes, rtol=1e-10)


def test_what_the_modes_do_not_make_comes_through_little_enlarged() -> None:
    modes, left_out = smooth_modes(8), 1e-3 * np.sin(40 * np.linspace(-1, 1, 400))
    told = telling(modes, telling_unknowns(modes))
    off = modes @ (told.of_them @ left_out[told.unknowns])
    assert np.abs(off).max() < 3 * np.abs(left_out).max()


def test_no_modes_are_told_by_no_unknowns() -> None:
    modes = np.zeros((12, 0))
    told = telling(modes, telling_unknowns(modes))
    assert told.unknowns.size == 0 and told.of_them.shape == (0, 0)
