"""Suites say of recordings, also damaged ones, what the combinations of sensors said that they replace.

data/sensor_readings.npz is what these said: flags of every frame, numbers of every tenth.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from suites import PAD, TESTS, run, suite_of, two_presses

from softfuse.hardware.recording import read_recording
from softfuse.robot.file import load
from softfuse.sensors.status import Status

EVERY = 10
ROUNDED, ROUNDED_M = 1e-6, 1e-9
"""Processors of other vector widths add in another order, and a search of a fixed number of steps ends
elsewhere: with 2, 4 and 8 numbers at once by 4e-8 and 3e-11 m."""
COMMON = {
    "bad time": Status.bad_time,
    "location unknown": Status.location_unknown,
    "outside workspace": Status.outside,
}
GAS = COMMON | {
    "flow missing": "flow missing",
    "flow saturated": "flow saturated",
    "no volume known": Status.nothing_measured,
}


@dataclass(frozen=True)
class Before:
    """What was said of one case."""

    case: str

    def __getitem__(self, key: str) -> np.ndarray:
        with np.load(TESTS / "data" / "sensor_readings.npz") as file:
            return file[f"{self.case}/{key}"]

    def __contains__(self, key: str) -> bool:
        with np.load(TESTS / "data" / "sensor_readings.npz") as file:
            return f"{self.case}/{key}" in file


def same(new, old, **limits):
    np.testing.assert_allclose(new, old, **({"rtol": ROUNDED, "atol": 0.0} | limits))


def compare(new, old: Before, flags: dict[str, str], order=slice(None)) -> None:
    """`order`: the numbers of today's readings in the order of those days."""
    for key in ("reading", "sigma"):
        same(getattr(new, key)[::EVERY, order], old[key], atol=1e-22)
    np.testing.assert_array_equal(new.valid[:, order], old["valid"])
    for key in ("touching", "pressing", "clear"):
        np.testing.assert_array_equal(getattr(new, key), old[key], err_msg=key)
    same(new.location_m[::EVERY], old["location_m"], atol=ROUNDED_M)
    for before, text in flags.items():
        np.testing.assert_array_equal(new.flags[text], old[f"flag {before}"], err_msg=text)
    if "drift" in old:
        same(new.drift.covariance[:: 10 * EVERY], old["drift"])
        np.testing.assert_array_equal(new.drift.calm, old["calm"])
    assert old["touching"].any()


@pytest.mark.parametrize("damage", ["none", "unseen", "started", "broken"])
def test_flow_and_crossed_lines(damage: str) -> None:
    recording, settings, old = two_presses(), PAD, Before(f"pad {damage}")
    suite = suite_of(settings)
    time, raw = recording.time_s.copy(), recording.matrix(suite.channels).copy()
    flow, lines = raw[:, :4], raw[:, 4:]
    idle = lines[:50].mean(axis=0)
    if damage == "unseen":
        lines[:] = np.rint(idle + np.random.default_rng(1).normal(0.0, 8.0, lines.shape))
    elif damage == "started":
        cut = int(np.flatnonzero(recording.columns["sample"] > 0)[0]) - 20
        time, raw = time[cut:], raw[cut:]
        vents, crossed = settings.sensors
        known = {"row_baseline": tuple(idle[:8]), "column_baseline": tuple(idle[8:])}
        crossed = crossed.model_copy(update=known)
        suite = suite_of(settings.model_copy(update={"sensors": (vents, crossed)}))
    elif damage == "broken":
        lines[300:, 3] = lines[300, 3]
        lines[:, 12] = np.nan
        flow[500:600, 1] = np.nan
        time[[90, 700]] = np.nan
        lines[100:104] = np.nan
    new = run(suite, time, raw)
    compare(
        new,
        old,
        GAS | {"electrode lost": "electrodes lost", "not seen by electrodes": Status.unseen},
    )
    same(new.location_sigma_m[::EVERY], old["location_sigma_m"])
    same(new.places[::EVERY, :, 0], old["places"])
    assert damage != "unseen" or new.flags[Status.unseen].any()
    seen = new.details["electrodes"]
    same(seen.dent_m[::EVERY], old["dent_m"], atol=1e-20)
    same(seen.weighted_mean_m[::EVERY], old["mean_m"], atol=1e-18)
    np.testing.assert_array_equal(seen.valid, old["lines"])


@pytest.mark.parametrize("damage", ["none", "broken"])
def test_pressure_single_electrodes_and_cable(damage: str) -> None:
    settings, old = load(TESTS.parent / "configs" / "finger.toml"), Before(f"finger {damage}")
    recording = read_recording(TESTS / "data" / "finger_one_push.csv.gz", [])
    suite, rng = suite_of(settings), np.random.default_rng(1)
    time = np.arange(recording.time_s[0] - 3.0, recording.time_s[-1], 0.01)

    def finer(names, noise):
        rows = [np.interp(time, recording.time_s, recording.columns[name]) for name in names]
        return np.array(rows).T + rng.normal(0.0, noise, (len(time), len(names)))

    volts, counts, cable = (
        finer(sensor.channels, noise)
        for sensor, noise in zip(settings.sensors, (1e-3, 8.0, 0.02), strict=True)
    )
    if damage == "broken":
        volts[400:600, 2] = np.nan
        counts[500:, 4] = 0.0
        cable[300:340] = np.nan
    new = run(suite, time, np.concatenate([volts, counts, cable], axis=1))
    flags = {
        "bad time": Status.bad_time,
        "pressure missing": "pressure missing",
        "pressure out of range": "pressure out of range",
        "cavity leaks": "pressure leaks",
        "cable length missing": "cable missing",
        "electrode lost": "electrodes lost",
    }
    compare(new, old, flags, order=[6, *range(6)])
    middles = np.array([place[0] for place in settings.places.values()])
    same(new.places[::EVERY, :, 0], middles[old["places"]])


def test_flow_and_mutual_grid() -> None:
    settings, old = load(TESTS.parent / "configs" / "pad_mutual.toml"), Before("grid")
    time = 0.01 * np.arange(500)
    force = np.interp(time, [1.2, 1.8, 2.6, 3.2], [0.0, 4.0, 4.0, 0.0])
    flow = np.gradient(force, time)[:, None] * np.array([40e-9, 10e-9, 8e-9, 3e-9])
    volts = np.clip(0.503 + 1.2e6 * flow + np.random.default_rng(3).normal(0, 2e-3, flow.shape), 0, 3.3)
    new = run(suite_of(settings), time, np.concatenate([volts, old["cells"]], axis=1))
    compare(new, old, GAS | {"electrode lost": "grid lost"})
    same(new.location_sigma_m[::EVERY], old["location_sigma_m"])
    pressing = old["pressing"][::EVERY]
    same(new.places[::EVERY, :, 0][pressing], old["places"][pressing], atol=ROUNDED_M)
    assert old["pressing"].any(axis=0).all()
