"""Sensors together: what they tell each other, several on one chamber or contact, and nobody who sees."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from sensor_tables import settings_of

from softfuse.sensors.contact_places import joined_places
from softfuse.sensors.parts import Parts
from softfuse.sensors.status import Status
from softfuse.sensors.suite import SensorSuite

MM = 1e-3


@eqx.filter_jit
def scan(suite, time, raw):
    return jax.lax.scan(lambda s, f: suite.update(s, *f), suite.init(), (time, raw))[1]


def run(suite, time, raw):
    return jax.tree.map(np.asarray, scan(suite, time, np.concatenate(raw, axis=1)))


def with_chambers(parts: Parts, contacts: tuple[str, ...]) -> Parts:
    """The same with some of the contacts, and both cavities sealed."""
    left, right = parts.chambers["left"], parts.chambers["right"]
    sealed = {
        name: replace(each, drive=k, sealed=True, rest_volume=4.7e-6)
        for k, (name, each) in enumerate({"left": left, "right": right}.items())
    }
    return replace(parts, chambers=sealed, contacts={name: parts.contacts[name] for name in contacts})


def idle_lines(count: int, seed: int = 1):
    return np.rint(20000 + np.random.default_rng(seed).normal(0.0, 8.0, (count, 16)))


def test_sealed_gas_tells_of_a_touch_that_lines_do_not_see(parts: Parts) -> None:
    parts = with_chambers(parts, ("top",))
    pressure = settings_of("pressure", chambers=["left", "right"], part="MPX5100A", reference_channel=None)
    time = 0.01 * np.arange(4000)
    # Held for longer than an outflow could last.
    pressed = np.interp(time, [4.0, 4.5, 32.0, 32.5], [0.0, 1.0, 1.0, 0.0])
    raw = pressure.simulate(parts, time, pressed[:, None] * np.array([4e3, -300.0]), [2])
    suite = SensorSuite.of([pressure, settings_of("crossed-diamonds")], parts)
    assert suite.misses and not suite.blind
    seen = run(suite, time, [raw, idle_lines(len(time))])
    held = (time > 4.6) & (time < 31.9)
    assert seen.touching[held, 0].all() and seen.pressing[held, 0].all()
    assert seen.flags[Status.unseen][held].all() and np.isnan(seen.location_m[held]).all()
    assert not seen.touching[time < 4.0].any() and not seen.touching[time > 33.5].any()
    assert not seen.clear[held].any() and seen.clear[time > 34.0].all()
    # Zeros are not taken while it lasts.
    averaged = (time > 6.0) & held
    np.testing.assert_allclose(seen.reading[averaged, 0], 4e3, rtol=0.03)
    np.testing.assert_allclose(seen.places[held, 0, 0], np.broadcast_to([0.0, 0.0, 0.0], (held.sum(), 3)))


def test_chambers_may_be_in_any_order(parts: Parts) -> None:
    time = 0.01 * np.arange(300)
    true = np.interp(time, [1.0, 1.5], [0.0, -1e-7])[:, None] * np.array([1.0, 0.3])
    forth, back = settings_of("flow"), settings_of("flow", chambers=["left", "right"])
    one = run(SensorSuite.of([forth], parts), time, [forth.ideal(parts, time, true)])
    other = run(SensorSuite.of([back], parts), time, [back.ideal(parts, time, true[:, ::-1])])
    np.testing.assert_allclose(one.reading, other.reading[:, ::-1], rtol=1e-12)
    body, z = parts.body, np.random.default_rng(0).normal(0.0, 1e-4, parts.body.n)
    volumes = [
        [part.functional.change(body, jnp.asarray(z)) for part in each.functional(parts).parts]
        for each in (forth, back)
    ]
    assert volumes[0] == volumes[1][::-1]


def test_a_chamber_with_two_sensors_is_squeezed_once(parts: Parts) -> None:
    time = 0.01 * np.arange(300)
    true = np.interp(time, [1.0, 1.5], [0.0, -2e-7])[:, None] * np.array([1.0, 0.5])
    flow, lines = settings_of("flow"), settings_of("crossed-diamonds")
    twice = settings_of("flow", name="again", channels=["g0", "g1"])
    volts = flow.ideal(parts, time, true)
    parts = replace(parts, contacts={"top": parts.contacts["top"]})
    once = run(SensorSuite.of([flow, lines], parts), time, [volts, idle_lines(300)])
    both = run(SensorSuite.of([flow, twice, lines], parts), time, [volts, volts, idle_lines(300)])
    dents = [each.details["crossed-diamonds"].dent_m[-1] for each in (once, both)]
    np.testing.assert_allclose(dents, 3e-7 / (np.pi * (10 * MM) ** 2), rtol=0.01)
    assert both.reading.shape == (300, 4)


def test_what_nobody_watches_is_not_tared_away(parts: Parts) -> None:
    """Without anything that tells of a touch, zeros are taken when the robot is switched on, no later."""
    time = 0.01 * np.arange(3000)
    bent = settings_of("accelerometer")
    true = np.interp(time, [4.0, 12.0], [0.0, 1.0])[:, None] * np.array([1.5, -1.0, 0.2])
    suite = SensorSuite.of([bent], parts)
    assert suite.blind and not suite.misses
    seen = run(suite, time, [bent.ideal(parts, time, true)])
    np.testing.assert_allclose(seen.reading[-1], true[-1], rtol=1e-3)
    assert seen.clear[:150].all() and not seen.clear[250:].any()


def test_a_robot_without_contacts_is_always_clear(parts: Parts) -> None:
    cable, bare = settings_of("cable-length"), replace(parts, contacts={})
    time = 0.01 * np.arange(400)
    suite = SensorSuite.of([cable, settings_of("accelerometer")], bare)
    level = settings_of("accelerometer").ideal(bare, time, np.zeros((400, 3)))
    seen = run(suite, time, [np.tile([4.0, 0.0], (400, 1)), level])
    assert seen.places.shape == (400, 0, 3, 3) and seen.clear.all()
    # A cable that is pulled: no zero is taken, for the body is not at rest.
    assert not seen.valid[:, 2:].any() and seen.valid[:, :2].all()


def turned(angle: float) -> np.ndarray:
    """A place at the origin whose tangents are turned by an angle about its direction, -z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[0.0, 0.0, 0.0], [c, s, 0.0], [s, -c, 0.0]])


def test_places_of_several_are_joined_by_their_precision() -> None:
    rng = np.random.default_rng(0)
    frames = np.stack([turned(0.3), turned(-1.1), turned(2.0)])
    at = rng.normal(0.0, MM, (3, 2))
    frames[:, 0, :2] = at
    root = rng.normal(0.0, MM, (3, 2, 2))
    own = root @ root.transpose(0, 2, 1) + MM**2 * np.eye(2)
    # In x and y: the textbook's weighted mean.
    flat = [f[1:, :2].T @ c @ f[1:, :2] for f, c in zip(frames, own, strict=True)]
    total = sum(np.linalg.inv(c) for c in flat)
    mean = np.linalg.solve(total, sum(np.linalg.solve(c, x) for c, x in zip(flat, at, strict=True)))
    located = jnp.array([[True], [True], [True]])
    place, covariance = joined_places(jnp.asarray(frames)[:, None], jnp.asarray(own)[:, None], located)
    np.testing.assert_allclose(place[0, 0], [*mean, 0.0], rtol=1e-9)
    np.testing.assert_allclose(place[0, 1:], frames[0, 1:])
    turn = frames[0, 1:, :2]
    np.testing.assert_allclose(covariance[0], turn @ np.linalg.inv(total) @ turn.T, rtol=1e-9)


@pytest.mark.parametrize("who", [0, 1, None])
def test_who_locates_nothing_has_no_say(who: int | None) -> None:
    frames = np.stack([turned(0.0), turned(1.0)])
    frames[:, 0, 0] = 1.0, 2.0
    own = np.full((2, 1, 2, 2), np.nan)
    if who is not None:
        own[who, 0] = np.eye(2)
    located = jnp.array([[who == 0], [who == 1]])
    place, covariance = joined_places(jnp.asarray(frames)[:, None], jnp.asarray(own), located)
    np.testing.assert_allclose(place[0, 0, 0], 2.0 if who == 1 else 1.0)
    if who is not None:
        np.testing.assert_allclose(covariance[0], np.eye(2), atol=1e-12)
    assert np.isfinite(place).all()


def test_a_stage_and_lines_that_see_one_contact_agree_on_it(parts: Parts) -> None:
    stage, lines = settings_of("indenter"), settings_of("crossed-diamonds")
    parts = replace(parts, contacts={"top": parts.contacts["top"]})
    time = 0.01 * np.arange(100)
    at = np.tile([5.0, -3.0, 2.0], (100, 1))
    suite = SensorSuite.of([settings_of("line-length"), stage, lines], parts)
    length = settings_of("line-length").ideal(parts, time, np.zeros((100, 1)))
    seen = run(suite, time, [length, at, idle_lines(100)])
    # Lines see nothing: the stage alone tells.
    assert seen.touching[5:].all()
    np.testing.assert_allclose(seen.location_m[5:, 0], np.tile([5 * MM, -3 * MM, 0.0], (95, 1)), atol=1e-12)
    np.testing.assert_allclose(seen.location_sigma_m[5:, 0], 0.05 * MM)
    assert not suite.misses
