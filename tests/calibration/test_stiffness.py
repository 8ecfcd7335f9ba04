"""The one-scalar fit."""

import numpy as np
import pytest

from softfuse.calibration.stiffness import fit_stiffness
from softfuse.errors import SoftfuseError


def test_the_factor_minimises_the_relative_errors() -> None:
    rng = np.random.default_rng(0)
    true = rng.uniform(4, 16, 15)
    estimated = true / 0.92 * (1 + 0.03 * rng.normal(size=15))
    fit = fit_stiffness(estimated, true)

    def cost(k: float) -> float:
        return float(np.sum((k * estimated / true - 1) ** 2))

    assert fit.n == 15
    assert cost(fit.factor) < min(cost(fit.factor * 0.999), cost(fit.factor * 1.001))
    assert abs(fit.factor - 0.92) < 3 * fit.standard_error < 0.05


def test_estimates_that_say_nothing_are_left_out() -> None:
    estimated = np.array([10.0, np.nan, 0.0, 5.0])
    fit = fit_stiffness(estimated, np.array([8.0, 8.0, 4.0, 4.0]))
    assert fit.n == 2 and fit.factor == pytest.approx(0.8)
    with pytest.raises(SoftfuseError, match="choose other presses"):
        fit_stiffness(estimated[1:3], np.ones(2))
