"""From the start of Python to the first estimate, see `cold_start`."""

import argparse
import tempfile
from pathlib import Path

import pytest
from cold_start import ROOT, run


@pytest.mark.parametrize("cache", ["empty", "warm"])
def test_first_estimate(benchmark, cache: str) -> None:
    recording = ROOT / "tests" / "data" / "pad_nominal_two_presses.csv.gz"
    given = argparse.Namespace(config=ROOT / "configs" / "pad.toml", recording=recording, charts=None)
    with tempfile.TemporaryDirectory() as shared:
        if cache == "warm":
            run("api", given, Path(shared))

        def start():
            if cache == "warm":
                run("api", given, Path(shared))
            else:
                with tempfile.TemporaryDirectory() as own:
                    run("api", given, Path(own))

        benchmark.pedantic(start, rounds=3 if cache == "warm" else 1)
