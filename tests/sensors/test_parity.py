"""The suite says the same as the three combinations of sensors that it stands for, on recordings, also
damaged.
"""

from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np
import pytest

from softfuse.config import load
from softfuse.config.build_tracker import build_senses
from softfuse.experiment.paper.mutual_bed import MutualBed
from softfuse.functional.chart import FlatChart
from softfuse.hardware.recording import read_recording
from softfuse.sensors.mutual.field import Thing
from softfuse.sensors.parts import CablePart, ChamberPart, ContactPart, Parts
from softfuse.sensors.suite import SensorSuite

ROOT = Path(__file__).parents[2]
DATA = ROOT / "tests" / "data"
NOTHING: Any = None
DOWN = FlatChart.along(np.array([0.0, 0.0, -1.0]))


def parts_of(config, *, sealed: bool) -> Parts:
    contact = config.contact
    low = high = np.zeros(2)
    if hasattr(contact, "workspace"):
        low, high = np.array([contact.workspace.x, contact.workspace.y]).T
    chamber = ChamberPart(NOTHING, 0, sealed=True) if sealed else ChamberPart(NOTHING)
    return Parts(
        NOTHING,
        np.zeros((0, 3), int),
        {str(k): chamber for k in range(len(config.cavities))},
        {str(k): CablePart(k) for k in range(len(config.cables))},
        {"contact": ContactPart(DOWN, contact.radius, getattr(contact, "max_contacts", 1), low, high)},
    )


@eqx.filter_jit
def old_scan(senses, time, groups):
    return jax.lax.scan(lambda s, f: senses.update(s, *f), senses.init(), (time, groups))[1]


@eqx.filter_jit
def new_scan(suite, time, raw):
    return jax.lax.scan(lambda s, f: suite.update(s, *f), suite.init(), (time, raw))[1]


def same(new, old, **limits):
    limits = {"rtol": 1e-12, "atol": 0.0} | limits
    np.testing.assert_allclose(np.asarray(new), np.asarray(old), **limits)


def compare(old, new, flags: dict[str, str], *, sigma=True) -> None:
    for key in ("reading", "sigma"):
        same(getattr(new, key), getattr(old, key), atol=1e-22)
    for key in ("valid", "touching", "pressing", "clear"):
        np.testing.assert_array_equal(getattr(new, key), getattr(old, key), err_msg=key)
    same(new.location_m, old.location_m)
    if sigma:
        same(new.location_sigma_m, old.location_sigma_m, rtol=1e-9)
    for status, text in flags.items():
        np.testing.assert_array_equal(new.flags[text], old.flags[status], err_msg=text)
    if old.drift is not None:
        same(new.drift.covariance, old.drift.covariance)
        np.testing.assert_array_equal(new.drift.calm, old.drift.calm)


COMMON = {
    "time missing or not increasing": "time missing or not increasing",
    "location unknown": "location unknown",
    "outside workspace": "outside workspace",
}
PAD = COMMON | {
    "flow missing": "flow missing",
    "flow saturated": "flow saturated",
    "electrode lost": "electrode lost",
    "no volume known": "nothing measured",
}


def pad_frames(damage: str):
    config = load(ROOT / "configs" / "pad.toml")
    recording = read_recording(DATA / "pad_nominal_two_presses.csv.gz", config.sensors.channels)
    groups = [recording.matrix(names).copy() for names, _ in config.sensors.groups]
    time, lines = recording.time_s.copy(), np.concatenate(groups[1:], axis=1)
    idle = lines[:50].mean(axis=0)
    if damage == "unseen":
        noise = np.random.default_rng(1).normal(0.0, 8.0, lines.shape)
        lines = np.rint(idle + noise)
    elif damage == "started":
        cut = int(np.flatnonzero(recording.columns["sample"] > 0)[0]) - 20
        time, groups[0], lines = time[cut:], groups[0][cut:], lines[cut:]
    elif damage == "broken":
        lines[300:, 3] = lines[300, 3]
        lines[:, 12] = np.nan
        groups[0][500:600, 1] = np.nan
        time[[90, 700]] = np.nan
        lines[100:104] = np.nan
    groups = [groups[0], lines[:, :8], lines[:, 8:]]
    text = (ROOT / "configs" / "pad.toml").read_text()
    if damage == "started":
        at = 'location = "peak-fit"'
        rows, columns = (list(map(float, part)) for part in (idle[:8], idle[8:]))
        text = text.replace(at, f"{at}\nrow_baseline = {rows}\ncolumn_baseline = {columns}\n", 1)
    return text, time, groups


@pytest.mark.parametrize("damage", ["none", "unseen", "started", "broken"])
def test_flow_and_crossed_lines(tmp_path, damage):
    text, time, groups = pad_frames(damage)
    path = tmp_path / "pad.toml"
    path.write_text(text)
    config = load(path)
    old = old_scan(build_senses(config), time, tuple(groups))
    sensors = config.sensors
    suite = SensorSuite.of([sensors.flow, sensors.capacitive], parts_of(config, sealed=False))
    new = new_scan(suite, time, np.concatenate(groups, axis=1))
    compare(old, new, PAD)
    np.testing.assert_array_equal(new.flags["not seen by electrodes"], old.flags["not seen by electrodes"])
    same(new.places[:, :, 0], old.places)
    assert np.asarray(old.touching).any()
    if damage == "unseen":
        assert np.asarray(old.flags["not seen by electrodes"]).any()
    reading = new.details["electrode"]
    same(reading.dent_m, old.details.dent_m(suite.contact_sensors[0].peak.radius_m), atol=1e-20)
    same(reading.weighted_mean_m, old.details.weighted_mean_m, atol=1e-18)
    np.testing.assert_array_equal(reading.valid, old.details.electrode_valid)


@pytest.mark.parametrize("damage", ["none", "broken"])
def test_pressure_single_electrodes_and_cable(damage):
    config = load(ROOT / "configs" / "finger.toml")
    sensors = config.sensors
    recording = read_recording(DATA / "finger_one_push.csv.gz", sensors.channels)
    rng = np.random.default_rng(1)
    time = np.arange(recording.time_s[0] - 3.0, recording.time_s[-1], 0.01)

    def finer(names, noise):
        rows = [np.interp(time, recording.time_s, recording.columns[name]) for name in names]
        return np.array(rows).reshape(len(names), len(time)).T + rng.normal(
            0.0, noise, (len(time), len(names))
        )

    raw = [
        finer(names, noise) for (names, _), noise in zip(sensors.groups, (1e-3, 0.0, 8.0, 0.02), strict=True)
    ]
    if damage == "broken":
        raw[0][400:600, 2] = np.nan
        raw[2][500:, 4] = 0.0
        raw[3][300:340] = np.nan
    groups = [each * unit for each, (_, unit) in zip(raw, sensors.groups, strict=True)]
    old = old_scan(build_senses(config), time, tuple(groups))
    parts = parts_of(config, sealed=True)
    places = [
        {"name": e.name, "centre": [f"{x} m" for x in e.centre], "direction": list(e.direction)}
        for e in config.electrodes
    ]
    electrodes = type(sensors.electrodes).model_validate(
        {"channels": sensors.electrodes.channels, "electrodes": places}
    )
    suite = SensorSuite.of([sensors.cable, sensors.pressure, electrodes], parts)
    new = new_scan(suite, time, np.concatenate([raw[3], raw[0], raw[2]], axis=1))
    compare(
        old,
        new,
        {
            "time missing or not increasing": "time missing or not increasing",
            "pressure missing": "pressure missing",
            "pressure out of range": "pressure out of range",
            "cavity leaks": "pressure leaks",
            "cable length missing": "cable length missing",
            "electrode lost": "electrode lost",
        },
        sigma=False,
    )
    assert np.asarray(old.touching).any()


def test_flow_and_mutual_grid():
    config = load(ROOT / "configs" / "pad_mutual.toml")
    time = 0.01 * np.arange(500)
    gap = np.interp(time, [0.8, 1.2, 3.2, 3.8], [0.04, 0.0, 0.0, 0.04])
    force = np.interp(time, [1.2, 1.8, 2.6, 3.2], [0.0, 4.0, 4.0, 0.0])
    late = np.interp(time, [1.6, 2.0, 2.8, 3.0], [0.05, 0.0, 0.0, 0.05])
    things = [
        [Thing((-14e-3, -19e-3), g, f), Thing((29.5e-3, 12e-3), o, 0.5 * f)]
        for g, f, o in zip(gap, force, late, strict=True)
    ]
    cells = MutualBed().counts(time, things).astype(float)
    flow = np.gradient(force, time)[:, None] * np.array([40e-9, 10e-9, 8e-9, 3e-9])
    rng = np.random.default_rng(3)
    volts = np.clip(0.503 + 1.2e6 * flow + rng.normal(0, 2e-3, flow.shape), 0, 3.3)
    old = old_scan(build_senses(config), time, (volts, cells))
    sensors = config.sensors
    suite = SensorSuite.of([sensors.flow, sensors.mutual], parts_of(config, sealed=False))
    new = new_scan(suite, time, np.concatenate([volts, cells], axis=1))
    compare(old, new, PAD)
    pressing = np.asarray(old.pressing)
    same(np.asarray(new.places)[:, :, 0][pressing], np.asarray(old.places)[pressing])
    assert pressing.any(axis=0).all()
