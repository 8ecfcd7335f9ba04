"""Every kind of sensor: from true values through its electronics to readings, what is missing, and that all
keys count.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from sensor_tables import TABLES, settings_of

from softfuse.errors import ConfigError
from softfuse.io.settings import Settings
from softfuse.sensors.base import AbstractSensor
from softfuse.sensors.parts import Parts, TrueContact
from softfuse.sensors.registry import SENSORS
from softfuse.sensors.suite import SensorSuite

MEASURING = {
    "flow": 200e-9,
    "pressure": 3e3,
    "cable-length": 5e-3,
    "cable-tension": 4.0,
    "marker": 3e-3,
    "accelerometer": 3.0,
    "attitude": 0.3,
    "liquid-metal": 2e-3,
    "line-length": 4e-3,
    "dielectric-sheet": 0.2,
    "bragg-gratings": 20.0,
    "point-pressure": 20e3,
    "base-wrench": 1.0,
    "strain-gauge": 4e-3,
}
"""Kinds that measure, and how much of it is much."""

TIME = 0.01 * np.arange(600)
RAMP = np.interp(TIME, [3.5, 4.2, 5.0, 5.5], [0.0, 1.0, 1.0, 0.0])


@eqx.filter_jit
def scan(suite: SensorSuite, raw):
    time = 0.01 * jnp.arange(len(raw))
    return jax.lax.scan(lambda s, f: suite.update(s, *f), suite.init(), (time, raw))[1]


def frames(
    kind: str, parts: Parts, *, seed: int | None, time=TIME, ramp=RAMP
) -> tuple[SensorSuite, np.ndarray, np.ndarray]:
    """The sensor, a stage that tells when something presses, true values, and raw readings of both."""
    settings, stage = settings_of(kind), settings_of("indenter")
    functional = settings.functional(parts)
    assert functional is not None
    count = functional.count
    size = MEASURING[kind] * (1.0 - 0.3 * np.arange(count) / max(count, 1))
    true = ramp[:, None] * size
    if kind == "bragg-gratings":
        true[:, ::3] *= 1e-4  # strains, not curvatures
    ideal = settings.ideal(parts, time, true)
    raw = ideal if seed is None else settings.simulate(parts, time, true, [seed], [seed, 1])
    pressed = np.stack([0.0 * time, 0.0 * time, np.where(ramp > 0, 1.0, 0.0)], axis=1)
    suite = SensorSuite.of([settings, stage], parts)
    return suite, true, np.concatenate([raw, pressed], axis=1)


@pytest.mark.parametrize("kind", MEASURING)
def test_ideal_readings_are_the_truth(kind: str, parts: Parts) -> None:
    suite, true, raw = frames(kind, parts, seed=None)
    seen = jax.tree.map(np.asarray, scan(suite, raw))
    held = (TIME > 4.8) & (TIME < 5.0)
    assert len(suite.readings) == true.shape[1] and suite.channels[-1] == "iF"
    np.testing.assert_allclose(seen.reading[held], true[held], rtol=0.02, atol=1e-9 * np.abs(true).max())
    assert seen.valid[held].all()


@pytest.mark.parametrize("kind", sorted(set(MEASURING) - {"flow", "marker", "cable-tension", "cable-length"}))
def test_no_reading_counts_before_its_zero_is_known(kind: str, parts: Parts) -> None:
    suite, _, raw = frames(kind, parts, seed=None)
    seen = jax.tree.map(np.asarray, scan(suite, raw))
    assert not seen.valid[:50].any() and seen.valid[200].all()


@pytest.mark.parametrize("kind", MEASURING)
def test_readings_of_real_parts_are_as_sure_as_they_say(kind: str, parts: Parts) -> None:
    suite, true, raw = frames(kind, parts, seed=3)
    seen = jax.tree.map(np.asarray, scan(suite, raw))
    held = (TIME > 4.8) & (TIME < 5.0)
    off = (seen.reading - true)[held] / seen.sigma[held]
    assert np.abs(off).max() < 5.0
    # And not so unsure that nothing is told.
    if kind not in ("accelerometer", "attitude"):
        assert np.all(seen.sigma[held] < 0.2 * np.abs(true[held]).max())
    other = settings_of(kind).simulate(parts, TIME, true, [4], [4, 1])
    again = settings_of(kind).simulate(parts, TIME, true, [3], [3, 1])
    assert not np.array_equal(raw[:, : other.shape[1]], other)
    np.testing.assert_array_equal(raw[:, : again.shape[1]], again)


@pytest.mark.parametrize("kind", sorted(set(MEASURING) - {"flow"}))
def test_zeros_of_real_parts_drift_as_long_presses_are_told(kind: str, parts: Parts) -> None:
    time = 0.01 * np.arange(2400)
    ramp = np.interp(time, [3.5, 4.2], [0.0, 1.0])
    off = []
    for seed in range(6):
        suite, true, raw = frames(kind, parts, seed=seed, time=time, ramp=ramp)
        seen = jax.tree.map(np.asarray, scan(suite, raw))
        off.append(((seen.reading - true) / seen.sigma)[[1400, 2399]])
    # A wander of the same size after minutes would be ten times too far off after as many seconds.
    assert np.sqrt(np.mean(np.square(off))) < 1.5


@pytest.mark.parametrize("kind", MEASURING)
def test_what_is_missing_is_told_and_not_believed(kind: str, parts: Parts) -> None:
    suite, _, raw = frames(kind, parts, seed=3)
    raw[450:460, suite.inputs[kind]] = np.nan
    seen = jax.tree.map(np.asarray, scan(suite, raw))
    flag = seen.flags[f"{kind} missing"]
    assert flag[450:460].all() and not flag[:450].any() and not flag[460:].any()
    for leaf in (seen.reading, seen.sigma):
        assert np.isfinite(leaf).all()
    # A length is averaged over what is missing.
    if kind != "cable-length":
        assert not seen.valid[450:460].any()


def test_there_is_a_table_for_every_kind() -> None:
    assert set(TABLES) == set(SENSORS)
    assert all(SENSORS[kind].model_fields["type"].default == kind for kind in SENSORS)


def used_keys(settings: Any, run) -> dict[str, set[str]]:
    """Fields that are read of settings and all settings in them, by class."""
    read: dict[str, set[str]] = {}
    plain = Settings.__getattribute__

    def noted(self, name):
        if name in type(self).model_fields:
            read.setdefault(type(self).__name__, set()).add(name)
        return plain(self, name)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Settings, "__getattribute__", noted)
        run(settings)
    return read


def all_settings(settings: Settings):
    """Settings and all settings in them."""
    yield settings
    for name in type(settings).model_fields:
        value = getattr(settings, name)
        for each in value if isinstance(value, tuple) else (value,):
            if isinstance(each, Settings):
                yield from all_settings(each)


@pytest.mark.parametrize("kind", SENSORS)
def test_every_key_is_read(kind: str, parts: Parts) -> None:
    contact = TrueContact(
        np.array([[0.0, 0.0, 0.018], [1, 0, 0], [0, -1, 0]]), 0.01, middle=np.array([0, 0, 0.03])
    )

    def run(settings) -> None:
        sensor = settings.sensor(parts)
        functional = settings.functional(parts)
        if isinstance(sensor, AbstractSensor):
            values = np.zeros((2, functional.count))
        else:
            assert functional is None
            values = np.stack([settings.signal(parts, [contact], settings.points(parts))] * 2)
        raw = settings.simulate(parts, TIME[:2], values, [1], [2])
        assert raw.shape == (2, len(settings.columns)) and settings.columns == sensor.channels
        assert np.isfinite(raw).all()

    changed = {
        "flow": {},
        "pressure": {"share": [0.1, 0.9], "slope": None},
        "mutual-4x4": {"shape": {"gain": [1.0] * 16}},
    }
    settings = [settings_of(kind)]
    if kind == "pressure":
        settings.append(settings_of(kind, slope=None, share=[0.1, 0.9]))
    elif kind in changed:
        settings.append(settings_of(kind, **changed[kind]))
    read: dict[str, set[str]] = {}
    for each in settings:
        for name, keys in used_keys(each, run).items():
            read.setdefault(name, set()).update(keys)
    # What stands for other keys has been used up when these were filled in; names of electrodes are for
    # reports.
    spent = {"type", "part", "output"} | ({"name"} if kind == "electrodes" else set())
    for each in all_settings(settings[0]):
        unread = set(type(each).model_fields) - read.get(type(each).__name__, set()) - spent
        assert not unread, f"{type(each).__name__}: nobody reads {sorted(unread)}"


@pytest.mark.parametrize(
    ("kind", "changed", "told"),
    [
        ("flow", {"chambers": ["left", "sealed"]}, 'chamber "sealed" has no vent'),
        ("flow", {"chambers": ["left", "up"]}, 'there is no chamber "up", but "left", "right"'),
        ("pressure", {"chambers": ["left", "sealed"]}, 'chamber "left" is vented'),
        ("cable-length", {"cables": ["one", "two"]}, 'there is no cable "two", but "one", "other"'),
        ("marker", {"point": "toe"}, 'there is no point "toe", but "tip"'),
        ("indenter", {"contact": "skin"}, 'contact "skin" presses on no flat face'),
        ("crossed-diamonds", {"contact": "skin"}, 'contact "skin" presses on no flat face'),
        ("liquid-metal", {"stations": [0, 2]}, "2 channels for 1 segments"),
    ],
)
def test_what_does_not_go_together_is_refused(kind: str, changed: Any, told: str, parts: Parts) -> None:
    with pytest.raises(ConfigError, match=told):
        settings_of(kind, **changed).sensor(parts)


def test_two_sensors_do_not_share_a_name_or_a_channel(parts: Parts) -> None:
    with pytest.raises(ConfigError, match='two sensors are named "marker"'):
        SensorSuite.of([settings_of("marker")] * 2, parts)
    with pytest.raises(ConfigError, match='two sensors write in the column "mx"'):
        SensorSuite.of([settings_of("marker"), settings_of("marker", name="other")], parts)


@pytest.mark.parametrize("kind", SENSORS)
def test_memory_keeps_its_types(kind: str, parts: Parts) -> None:
    """Otherwise a program that goes from frame to frame would be compiled anew for the second one."""
    suite = SensorSuite.of([settings_of(kind)], parts)
    first = suite.init()
    frame = jax.ShapeDtypeStruct((), float), jax.ShapeDtypeStruct((len(suite.channels),), float)
    later = jax.eval_shape(lambda *given: suite.update(*given)[0], first, *frame)
    types = [(leaf.shape, leaf.dtype, leaf.weak_type) for leaf in jax.tree.leaves(later)]
    assert types == [(leaf.shape, leaf.dtype, leaf.weak_type) for leaf in jax.tree.leaves(first)]
