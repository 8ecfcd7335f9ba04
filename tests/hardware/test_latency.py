"""Quantiles of latencies in constant memory."""

import math

import numpy as np

from softfuse.hardware.live.session import Latencies


def test_quantiles_are_those_of_the_samples_to_two_per_cent() -> None:
    samples = np.random.default_rng(0).lognormal(-5.0, 1.0, 20_000)
    found = Latencies()
    for sample in samples:
        found.add(float(sample))
    for share in (0.01, 0.5, 0.99, 0.999):
        exact = np.quantile(samples, share, method="inverted_cdf")
        assert exact * (1 - 1e-12) <= found.quantile_s(share) <= exact * 1.0201
    assert found.largest_s == found.quantile_s(1.0) == samples.max()


def test_nothing_is_nan_and_extremes_are_kept() -> None:
    found = Latencies()
    assert math.isnan(found.quantile_s(0.5)) and found.largest_s == 0.0
    found.add(0.0)
    assert found.quantile_s(0.5) == 0.0
    found.add(1e6)
    assert found.quantile_s(1.0) >= 1e3 and found.largest_s == 1e6
