"""From the finger's configuration to a device: loads, contacts, readings, limits, points and sensors."""

from collections.abc import Callable
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from made_sensors import electrode_detector, nxp

from softfuse.robot.file import load
from softfuse.robot.settings import RobotSettings
from softfuse.config.build_attached import build_attached, build_centreline, build_points
from softfuse.config.build_device import (
    build_device,
    build_limits,
    build_rates,
    electrode_places,
    with_contact_model,
)
from softfuse.config.build_finger_sensors import build_finger_sensors, electrode_thresholds, pressure_sensor
from softfuse.config.build_mesh import DeviceMesh, build_mesh
from softfuse.config.build_sensors import build_sensors
from softfuse.errors import ConfigError
from softfuse.functional.cable import length
from softfuse.functional.cavity import Cavity
from softfuse.functional.contact import Contact
from softfuse.mechanics.cable import PulledCable
from softfuse.mechanics.gas import SealedGas
from softfuse.mechanics.load import Loads
from softfuse.mechanics.model import Model
from softfuse.mechanics.patch import PatchContact
from softfuse.mechanics.reading import AnswerReading
from softfuse.mesh.surface import outer_surface

Write = Callable[..., Path]
Edited = Callable[..., RobotSettings]

CONFIGS = Path(__file__).parents[2] / "configs"
FRAME = eqx.filter_jit(Contact.frame)


@pytest.fixture(scope="module")
def config(coarse_finger: Write) -> RobotSettings:
    """The finger, coarse."""
    return load(coarse_finger())


@pytest.fixture(scope="module")
def mesh(config: RobotSettings) -> RobotMesh:
    """Its mesh."""
    return build_mesh(config)


@pytest.fixture(scope="module")
def device(config: RobotSettings, mesh: RobotMesh) -> Model:
    """The device on it."""
    return build_device(config, mesh)


@pytest.fixture
def edited(coarse_finger: Write) -> Edited:
    """The configuration with pieces of its text replaced, none of which moves its mesh."""
    return lambda *changes: load(coarse_finger(*changes))


def test_readings_are_the_cable_and_then_the_pressures(config: DeviceConfig, device: Model) -> None:
    assert device.readings == (AnswerReading(tuple(range(7))),)
    cable, gas = device.actuators
    assert isinstance(cable, PulledCable) and isinstance(gas, SealedGas)
    assert device.n_readings == 7
    np.testing.assert_array_equal(device.answered, range(7))
    state = device.rest_state(jnp.asarray(electrode_places(config)[[0, 5]]))
    assert state.drive.shape == (4 + 1 + 6,)
    np.testing.assert_allclose(state.drive, [*[0] * 5, *[101325.0] * 6])
    np.testing.assert_allclose(device.reading(state), 0.0, atol=1e-12)


def test_guides_are_where_the_config_says(device: Model) -> None:
    cable = device.actuators[0]
    assert isinstance(cable, PulledCable)
    ports, body = cable.ports, device.body
    places = ports.values(body, jnp.zeros(body.n)).reshape(-1, 3)
    x = np.array([2, 12, 22, 38, 52, 68, 82, 98, 108, 116])
    np.testing.assert_allclose(1e3 * places, np.stack([x, 0 * x, 0 * x + 3], axis=1), atol=1e-9)
    pulled_at = np.asarray(cable.pulled_at)
    assert float(length(ports.location, pulled_at)) == pytest.approx(0.121)
    # Each guide is inside its element, or its shape values would extrapolate.
    shape = np.asarray(ports.points.shape(body.rest))
    np.testing.assert_allclose(shape.sum(axis=1), 1.0)
    assert np.abs(shape).max() <= 1.0 + 1e-9


def test_cavities_hold_gas_in_the_order_of_the_config(config: DeviceConfig, device: Model) -> None:
    gas = device.actuators[1]
    assert isinstance(gas, SealedGas)
    np.testing.assert_allclose(gas.rest, 480e-9)
    np.testing.assert_allclose(gas.dead, 100e-9)
    assert (float(gas.atmosphere), float(gas.exponent)) == (101325.0, 1.0)
    for cavity, settings in zip(gas.ports.cavities, config.cavities, strict=True):
        middle = np.asarray(device.body.rest)[np.unique(cavity.faces)].mean(axis=0)
        np.testing.assert_allclose(middle, settings.centre, atol=1.5e-3)


def test_each_cavity_may_have_its_own_dead_volume(edited: Edited, device: Model) -> None:
    dead = ", ".join(f'"{10 * k} mm^3"' for k in range(6))
    other = edited(('"100 mm^3"', f"[{dead}]"), ("exponent = 1.0", "exponent = 1.4"))
    gas = device.actuators[1]
    assert other.gas is not None and isinstance(gas, SealedGas)
    loaded = other.gas.load(device.body, gas.ports.cavities)
    np.testing.assert_allclose(loaded.dead, 1e-8 * np.arange(6), atol=1e-20)
    assert float(loaded.exponent) == 1.4


def _check_frames(contact: PatchContact, device: Model, config: DeviceConfig) -> None:
    for electrode, place in zip(config.electrodes, electrode_places(config), strict=True):
        ends = np.array(electrode.centre) + np.outer([-0.5, 0.5], electrode.span)
        for patch, middle in zip(contact.at(jnp.asarray(place)), ends[: contact.drives], strict=True):
            frame = np.asarray(FRAME(patch, device.body)[0])
            np.testing.assert_allclose(frame[:3], middle, atol=1e-12)
            np.testing.assert_allclose(np.cross(frame[3:6], frame[6:9]), electrode.direction, atol=1e-12)


def test_patches_are_on_the_electrodes_and_press_inwards(config: DeviceConfig, device: Model) -> None:
    (contact,) = device.contacts
    assert isinstance(contact, PatchContact)
    np.testing.assert_allclose(contact.offsets, [-5e-3, 5e-3])
    assert (len(config.electrodes), contact.drives) == (12, 2)
    assert float(contact.radius) == 4e-3
    _check_frames(contact, device, config)


def test_an_electrode_without_a_span_is_pressed_in_its_middle(
    edited: Edited, finger_text: str, mesh: RobotMesh, device: Model
) -> None:
    span = 'span = ["10 mm", "0 mm", "0 mm"]\n'
    old = finger_text[finger_text.index("[[electrode]]") : finger_text.index("[[point]]")]
    assert old.count(span) == 12
    middle = edited((old, old.replace(span, "")))
    assert middle.electrodes[0].arms == (0.0,)
    np.testing.assert_allclose(middle.electrodes[0].place[0], (0.012, 0, 0))
    assert middle.contact is not None
    contact = middle.contact.contact(outer_surface(mesh.mesh).faces, mesh.mesh.nodes, middle.electrodes)
    assert isinstance(contact, PatchContact)
    assert (len(middle.electrodes), contact.drives) == (12, 1)
    _check_frames(contact, device, middle)
    np.testing.assert_allclose(build_limits(middle, 2).upper, [5.0, 5.0, 20.0, *[101325.0] * 6])
    assert build_rates(middle, 2).drive.shape == (9,)
    with pytest.raises(ConfigError, match=r"electrode\[1\].span: give all electrodes spans of the same len"):
        edited((old, old.replace(span, "", 1)))


def test_limits_are_those_of_contacts_cables_and_gas(config: RobotSettings, device: Model) -> None:
    limits = build_limits(config, 2)
    np.testing.assert_allclose(limits.lower, [*[0] * 5, *[101325.0] * 6])
    np.testing.assert_allclose(limits.upper, [5, 5, 5, 5, 20, *[101325.0] * 6])
    # 1e-6 per square of a newton, and of the thousandth of the atmosphere that the gas counts as one.
    np.testing.assert_allclose(limits.regularisation, [1e-6] * 5 + [1e-6 / 101.325**2] * 6)
    gas = device.actuators[1]
    assert isinstance(gas, SealedGas)
    np.testing.assert_allclose(limits.regularisation[5:] * gas.units() ** 2, 1e-6)
    assert limits.lower.shape == (4 + Loads(device.actuators).sizes.drives,)


def test_rates_are_those_of_the_cables(config: RobotSettings, edited: Edited) -> None:
    free = build_rates(config, 2)
    assert np.all(np.isinf(free.drive)) and np.all(np.isinf(free.stroke)) and free.drive.shape == (11,)
    rates = 'max_tension = "20 N"\ntension_rate = "5 N/s"\nlength_rate = "10 mm/s"'
    held = build_rates(edited(('max_tension = "20 N"', rates)), 1)
    np.testing.assert_array_equal(held.drive, [np.inf, np.inf, 5.0, *[np.inf] * 6])
    np.testing.assert_array_equal(held.stroke, [np.inf, np.inf, 0.01, *[np.inf] * 6])


def test_points_and_centreline_are_in_the_material(config: RobotSettings, device: Model) -> None:
    for points, expected in (
        (build_points(config, device.body), [p.at for p in config.points]),
        (build_centreline(config, device.body), [(x, 0.0, 0.01) for x in (0.0, 0.03, 0.06, 0.09, 0.12)]),
    ):
        rest = device.body.rest
        found = jnp.einsum("ga,gai->gi", points.shape(rest), rest[points.nodes])
        np.testing.assert_allclose(found, expected, atol=1e-12)


def test_a_device_may_have_no_points(edited: Edited, device: Model) -> None:
    text = (CONFIGS / "finger.toml").read_text(encoding="utf-8")
    cut = text[text.index("[[point]]") : text.index("[sensors.pressure]")]
    bare = edited((cut, ""))
    points = build_points(bare, device.body)
    assert points.shape(device.body.rest).shape == (0, 10)
    with pytest.raises(ConfigError, match=rf"^{bare.path}: centreline: missing, "):
        build_centreline(bare, device.body)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('["22 mm", "0 mm", "3 mm"]', '["30 mm", "0 mm", "3 mm"]',
         r"cable\[0\]: guide 2 at \(30, 0, 3\) mm lies [\d.]+ mm outside the body \(nearest place \("),
        ('["60 mm", "0 mm", "10 mm"]', '["60 mm", "5 mm", "10 mm"]',
         r"centreline.points: point 2 at \(60, 5, 10\) mm lies [\d.]+ mm outside the body"),
        ('at = ["105 mm", "0 mm"', 'at = ["125 mm", "0 mm"', r"point: point 1 at \(125, 0, 10\) mm"),
    ],
)  # fmt: skip
def test_points_outside_the_material_are_told(
    edited: Edited, device: Model, old: str, new: str, told: str
) -> None:
    wrong = edited((old, new))
    gas = device.actuators[1]
    assert isinstance(gas, SealedGas)
    with pytest.raises(ConfigError, match=rf"^{wrong.path}: {told}"):
        build_attached(wrong, device.body, gas.ports.cavities)
        build_centreline(wrong, device.body)
        build_points(wrong, device.body)


def test_cavities_of_another_mesh_are_told(config: RobotSettings, device: Model) -> None:
    lost = Cavity(jnp.array([[0, 1, 2], [0, 2, 1]]))
    assert config.gas is not None
    with (
        pytest.raises(ConfigError, match=rf"^{config.path}: gas: a cavity has a face that belongs to no"),
        config.told("gas"),
    ):
        config.gas.load(device.body, [lost] * 6)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (
            'centre = ["45 mm", "0 mm", "0 mm"]',
            'centre = ["30 mm", "0 mm", "0 mm"]',
        ),  # 5 mm deep in the notch
        ('centre = ["45 mm", "0 mm", "0 mm"]', 'centre = ["45 mm", "30 mm", "0 mm"]'),  # beside the finger
        (
            'centre = ["45 mm", "0 mm", "0 mm"]\ndirection = [0, 0, 1]',
            'centre = ["45 mm", "0 mm", "0 mm"]\ndirection = [0, 0, -1]',
        ),  # enters the body at its back
    ],
)
def test_an_electrode_off_the_surface_is_told(edited: Edited, mesh: RobotMesh, old: str, new: str) -> None:
    wrong = edited((old, new))
    told = 'electrode[3].centre: "lower palm" is not within contact.radius of where its direction enters'
    with pytest.raises(ConfigError) as caught:
        build_device(wrong, mesh)
    assert str(caught.value).startswith(f"{wrong.path}: {told}")


def test_a_patch_cannot_become_a_disc(device: Model) -> None:
    with pytest.raises(ConfigError, match='a device that is pressed by a "patch" has no "punch"'):
        with_contact_model(device, "punch")


def _same(a: object, b: object) -> bool:
    return bool(eqx.tree_equal(a, b))


def test_the_fingers_own_values_are_those_of_its_data_sheets(config: DeviceConfig) -> None:
    pressure, electrodes = build_finger_sensors(config)
    assert _same(pressure, nxp("MPX5100A", 6))
    assert _same(electrodes, electrode_detector(12))


def test_gains_are_one_for_all_cavities_or_one_for_each(edited: Edited) -> None:
    each = "[0.9, 0.95, 1.0, 1.05, 1.1, 1.2]"
    sensors = edited(("gain = 0.96", f"gain = {each}")).sensors
    assert sensors is not None and sensors.pressure.gain == (0.9, 0.95, 1.0, 1.05, 1.1, 1.2)
    with pytest.raises(ConfigError, match="sensors.pressure.gain: 2 values for 6 channels: give one, or"):
        edited(("gain = 0.96", "gain = [1.0, 0.9]"))


def test_settings_reach_the_sensors(edited: Edited) -> None:
    pressure, electrodes = build_finger_sensors(
        edited(
            ('atmosphere = "101.325 kPa"', 'atmosphere = "95 kPa"'),
            ('supply = "5 V"', 'supply = "5.1 V"\nhold_off = "2 s"\nlag_frames = 7'),
            ('low = "2 mV"', 'low = "3 mV"'),
            ("model_error = 0.05", "gain_sigma = 0.02"),
            (
                "[sensors.electrodes]",
                '[sensors.pressure.tare]\nsettle = "2 s"\ndrift = "6 Pa/min"\n\n[sensors.pressure.leak]\n'
                'slowest = "1 min"\nfastest = "4 s"\nrepeat = "30 Pa"\n\n[sensors.electrodes]',
            ),
            ("on_counts = 600.0", 'on_counts = 500.0\nlost = "0.2 s"\nquiet = "3 s"\non_frames = 5'),
            ("[sensors.cable]", '[sensors.electrodes.baseline]\ncreep_time = "30 s"\n\n[sensors.cable]'),
        )
    )
    np.testing.assert_allclose(pressure.rest_Pa, 95e3)
    assert (float(pressure.reference), float(pressure.clip_low), pressure.lag) == (5.1, 3e-3, 7)
    assert (float(pressure.gain_sigma), float(pressure.hold_off_s)) == (0.02, 2.0)
    assert (float(pressure.tare.settle_s), float(pressure.tare.drift_Pa_s)) == (2.0, pytest.approx(0.1))
    leak = pressure.leak
    assert (float(leak.tolerated_1_s), float(leak.prior_1_s)) == (pytest.approx(1 / 60), 0.25)
    assert float(leak.repeat_Pa) == 30.0
    np.testing.assert_allclose(electrodes.on_counts, 500.0)
    assert (float(electrodes.lost_s), float(electrodes.quiet_s), int(electrodes.on_frames)) == (0.2, 3.0, 5)
    assert float(electrodes.array.creep_time_s) == 30.0


def test_sensors_of_the_other_device_are_told(config: RobotSettings, write: Write) -> None:
    with pytest.raises(ConfigError, match=rf"^{config.path}: sensors.capacitive: missing, there is"):
        build_sensors(config)
    pad = load(write())
    with pytest.raises(ConfigError, match=rf"^{pad.path}: sensors.pressure: missing, there is"):
        build_finger_sensors(pad)
