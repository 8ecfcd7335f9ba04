"""The fuzz of benchmarks/fuzz_decoder.py, in small."""

import runpy
from pathlib import Path

import pytest

BLOCKS = 20_000
FUZZ = runpy.run_path(str(Path(__file__).parents[2] / "benchmarks" / "fuzz_decoder.py"))


@pytest.fixture(scope="module")
def counts() -> dict:
    """Of damaged packets."""
    return FUZZ["fuzz_packets"](BLOCKS, 1)


def test_nothing_wrong_is_accepted_beyond_the_odds_of_the_crc(counts):
    assert counts["reached_crc"] > BLOCKS / 4
    # Poisson with a mean of 0.14: more than 4 in one of 3 million seeds.
    assert counts["expected"] < 0.2 and counts["wrong_bodies"] <= 4
    assert counts["wrong_messages"] <= counts["wrong_bodies"]


def test_order_returns_within_two_packets(counts):
    assert counts["second_lost"] == 0
    # Only what has lost its end takes the next one with it.
    assert 0 < counts["first_lost"] < BLOCKS / 2
    assert counts["undescribed"] == 0


def test_the_fuzz_would_see_a_crc_that_does_not_check(monkeypatch):
    monkeypatch.setattr("softfuse.hardware.wire.message.crc16.ibm_3740", lambda body: 0)
    counts = FUZZ["fuzz_packets"](2000, 1)
    assert counts["wrong_bodies"] > 100 and counts["wrong_messages"] > 100


def test_forged_packets_are_read_or_refused_and_all_accounted_for():
    counts = FUZZ["fuzz_forged"](BLOCKS // 4, 1)
    refused = counts["malformed"] + counts["unknown_version"] + counts["unknown_kind"]
    assert counts["packets"] == counts["handed_out"] + refused == BLOCKS // 4
    assert min(counts.values()) > 0


def test_damaged_lines_cost_no_line_but_one_of_their_neighbours():
    counts = FUZZ["fuzz_lines"](BLOCKS // 10, 1)
    assert counts["second_lost"] == 0 and counts["malformed"] > BLOCKS // 40
    assert counts["samples"] > 1.5 * counts["blocks"]
