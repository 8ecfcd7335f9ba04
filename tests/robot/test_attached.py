"""Cables, gas, electrodes, points and the finger's sensors: what is read, and how mistakes are told."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from softfuse.config import load
from softfuse.config.attached import ElectrodePlace
from softfuse.config.contact import PatchSettings
from softfuse.errors import ConfigError

Write = Callable[..., Path]

FIRST_GUIDE = '["2 mm", "0 mm", "3 mm"]'
PATCH = '"patch"                                 # pressed at the electrodes'
BASE_PALM = 'centre = ["12 mm", "0 mm", "0 mm"]\ndirection = [0, 0, 1]'


def test_the_finger_has_what_the_design_attaches_to_it(write_finger: Write) -> None:
    config = load(write_finger())
    (cable,) = config.cables
    assert cable.guides == tuple((x / 1000, 0.0, 0.003) for x in (2, 12, 22, 38, 52, 68, 82, 98, 108, 116))
    assert (cable.pulled_at, cable.friction, cable.max_tension) == ((-5e-3, 0.0, 3e-3), 0.0, 20.0)
    assert (cable.tension_rate, cable.length_rate, cable.compliance) == (None, None, 0.0)
    assert config.gas is not None
    assert config.gas.dead_volume == pytest.approx((100e-9,))
    assert (config.gas.atmosphere, config.gas.exponent) == (101325.0, 1.0)
    assert isinstance(config.contact, PatchSettings)
    assert (config.contact.radius, config.contact.max_contacts) == (4e-3, 2)
    assert [e.name for e in config.electrodes] == [
        f"{segment} {side}"
        for segment in ("base", "lower", "upper", "tip")
        for side in ("palm", "left", "right")
    ]
    places = [((0.0, 0.0), (0, 0, 1)), ((0.01, 0.01), (0, -1, 0)), ((-0.01, 0.01), (0, 1, 0))]
    assert [(e.centre, e.direction) for e in config.electrodes] == [
        ((x, *yz), into) for x in (0.012, 0.045, 0.075, 0.108) for yz, into in places
    ]
    assert [(p.name, p.at) for p in config.points] == [
        ("p0", (0.117, 0.0, 0.01)),
        ("p1", (0.105, 0.0, 0.01)),
        ("p2", (0.09, 0.0, 0.0125)),
        ("p3", (0.075, 0.0, 0.01)),
    ]
    assert config.centreline is not None
    assert config.centreline.points == tuple((x, 0.0, 0.01) for x in (0.0, 0.03, 0.06, 0.09, 0.12))


def electrode_of(direction: Sequence[float], span: Sequence[str]) -> ElectrodePlace:
    """An electrode at (10, 20, 30) mm."""
    given = {"name": "side", "centre": ["10 mm", "20 mm", "30 mm"], "direction": direction, "span": span}
    return ElectrodePlace.model_validate(given)


@pytest.mark.parametrize("direction", [(0.0, 1.0, 0.0), (2.0, 1.0, 0.0), (0.3, -0.4, 1.2)])
def test_the_first_tangent_of_an_electrode_is_along_its_span_across_the_direction(direction) -> None:
    """What of the span is along the direction moves nothing: patches are carried along that."""
    electrode = electrode_of(direction, ["8 mm", "0 mm", "6 mm"])
    point, u, v = electrode.place
    np.testing.assert_array_equal(point, [0.01, 0.02, 0.03])
    np.testing.assert_allclose([u @ u, v @ v, u @ v], [1, 1, 0], atol=1e-15)
    into = np.array(direction) / np.linalg.norm(direction)
    np.testing.assert_allclose(np.cross(v, u), into, atol=1e-15)
    assert len(electrode.arms) == 2
    for arm, share in zip(electrode.arms, (-0.5, 0.5), strict=True):
        away = share * np.array(electrode.span) - arm * u
        np.testing.assert_allclose(np.cross(away, into), 0.0, atol=1e-17)


def test_an_electrode_without_a_span_is_pressed_in_its_middle() -> None:
    electrode = electrode_of((0.0, 0.0, -1.0), ["0 mm", "0 mm", "0 mm"])
    assert electrode.arms == (0.0,)
    np.testing.assert_array_equal(electrode.place, [[0.01, 0.02, 0.03], [1, 0, 0], [0, 1, 0]])


def test_a_span_along_the_direction_is_told() -> None:
    with pytest.raises(ValidationError, match="runs along the direction: give it along the surface"):
        electrode_of((0.3, -0.4, 1.2), ["3 mm", "-4 mm", "12 mm"])


def test_the_finger_has_a_column_for_every_reading(write_finger: Write) -> None:
    sensors = load(write_finger()).sensors
    assert sensors is not None
    assert sensors.pressure.type == "MPX5100A"
    assert (sensors.pressure.average, sensors.pressure.reference) == (0.2, 5.0)
    assert sensors.channels == (
        *(f"pressure{k}_V" for k in range(6)),
        *(f"electrode{k}" for k in range(12)),
        "cable0_mm",
    )
    measured = write_finger(('supply = "5 V"', 'supply_channel = "supply_V"\nsupply = "5 V"'))
    sensors = load(measured).sensors
    assert sensors is not None
    assert sensors.channels[6] == "supply_V"


def test_rates_and_dead_volumes_have_units(write_finger: Write) -> None:
    rates = 'max_tension = "20 N"\ntension_rate = "300 N/min"\nlength_rate = "10 mm/s"'
    dead = ", ".join(f'"{k} mm^3"' for k in range(6))
    config = load(write_finger(('max_tension = "20 N"', rates), ('"100 mm^3"', f"[{dead}]")))
    assert config.gas is not None
    assert (config.cables[0].tension_rate, config.cables[0].length_rate) == (5.0, 0.01)
    assert config.gas.dead_volume == pytest.approx([k * 1e-9 for k in range(6)])


def test_the_cable_is_optional_and_so_is_its_sensor(write_finger: Write, finger_text: str) -> None:
    sensor = finger_text[finger_text.index("[sensors.cable]") : finger_text.index("[estimator]")]
    config = load(write_finger((sensor, "")))
    assert config.sensors is not None and config.sensors.cable is None and len(config.cables) == 1
    cable = finger_text[finger_text.index("[[cable]]") : finger_text.index("[gas]")]
    assert load(write_finger((sensor, ""), (cable, ""))).cables == ()


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (
            FIRST_GUIDE,
            '["2 mm", "0 mm"]',
            "cable[0].guides[0][2]: missing",
        ),
        (
            FIRST_GUIDE,
            '["12 mm", "0 mm", "3 mm"]',
            "cable[0].guides[1]: is the same point as the one before it: move or remove it",
        ),
        (
            'pulled_at = ["-5 mm"',
            'pulled_at = ["2 mm"',
            "cable[0].pulled_at: is the first guide: pull from a point outside the body",
        ),
        ("friction = 0.0", "friction = -0.1", "cable[0].friction: -0.1 must be greater than or equal to 0"),
        ('max_tension = "20 N"', "", "cable[0].max_tension: missing"),
        (
            "friction = 0.0",
            'compliance = "2 mm"',
            'cable[0].compliance: "2 mm" is a length, expected a length per force such as "0.05 mm/N"',
        ),
        (
            'slack = "0.5 mm"',
            'slack = "0.5 mm"\nzero = ["0.1 mm", "0.2 mm"]',
            "sensors.cable.zero: 2 values for 1 channels: give one, or one for each",
        ),
        (
            'max_tension = "20 N"',
            'max_tension = "20 N"\ntension_rate = "5 N"',
            'cable[0].tension_rate: "5 N" is a force, expected a force per time such as "5 N/s"',
        ),
        (
            'max_tension = "20 N"',
            'max_tension = "20 N"\nlength_rate = "5 N/s"',
            'cable[0].length_rate: "5 N/s" is a force per time, expected a velocity such as "10 mm/s"',
        ),
        (
            'dead_volume = "100 mm^3"',
            'dead_volume = "100 mm^2"',
            'gas.dead_volume: "100 mm^2" is an area, expected a volume such as "785 mm^3"',
        ),
        (
            'dead_volume = "100 mm^3"',
            'dead_volume = ["1 mm^3", "-1 mm^3"]',
            'gas.dead_volume[1]: "-1 mm^3" must be greater than or equal to 0',
        ),
        (
            'dead_volume = "100 mm^3"',
            'dead_volume = ["1 mm^3", "1 mm^3"]',
            "gas.dead_volume: 2 values for 6 cavities: give one, or one for each",
        ),
        (
            'dead_volume = "100 mm^3"',
            "dead_volume = []",
            "gas.dead_volume: the list is empty: give at least one",
        ),
        ("exponent = 1.0", "exponent = 0.9", "gas.exponent: 0.9 must be greater than or equal to 1"),
        (
            PATCH,
            '"pinch" #',
            'contact.model: "pinch" is none of "punch", "uniform", "patch"',
        ),
        (
            "max_contacts = 2",
            "max_contacts = 2\ndirection = [0, 0, -1]",
            "contact.direction: unknown key, the known ones are radius, max_force, model, max_contacts, "
            "place_sigma",
        ),
        ("max_contacts = 2 ", "", "contact.max_contacts: missing"),
        ("max_contacts = 2", "max_contacts = 0", "contact.max_contacts: 0 must be greater than 0"),
        (
            "max_contacts = 2",
            "max_contacts = 13",
            "contact.max_contacts: 13 contacts at once on 12 electrodes: give a number from 1 to 12",
        ),
        (
            BASE_PALM,
            BASE_PALM.replace("1]", "0]"),
            "electrode[0].direction: the direction has no length; use [0, 0, -1] for downwards",
        ),
        (
            'name = "base left"\ncentre = ["12',
            'name = "base palm"\ncentre = ["12',
            'electrode[1].name: the name "base palm" is taken by electrode[0]',
        ),
        ('name = "p1"', 'name = "p0"', 'point[1].name: the name "p0" is taken by point[0]'),
        (
            '"electrode11",',
            "",
            "sensors.electrodes.channels: 11 channels for 12 electrodes: name one column for each",
        ),
        (
            '"pressure5_V",',
            "",
            "sensors.pressure.channels: 5 pressure sensors for 6 cavities: name one column for each",
        ),
        (
            '["cable0_mm"]',
            '["cable0_mm", "cable1_mm"]',
            "sensors.cable.channels: 2 channels for 1 cables: name one column for each",
        ),
        (
            '["cable0_mm"]',
            '["electrode3"]',
            'sensors: two sensors write in the column "electrode3": give each its own',
        ),
        (
            'supply = "5 V"',
            'supply = "3.3 V"',
            'sensors.pressure.reference: 3.3 is not between 4.75 and 5.25',
        ),
        ('high = "4.998 V"', 'high = "1 mV"', "sensors.pressure.low: must be below high = 0.001"),
        (
            "[sensors.electrodes]",
            '[sensors.pressure.leak]\nfastest = "3 min"\n\n[sensors.electrodes]',
            "sensors.pressure.leak.fastest: must be below slowest = 120 s",
        ),
        (
            "off_counts = 400.0",
            "off_counts = 700.0",
            "sensors.electrodes.off_counts: must not exceed on_counts = 600",
        ),
        (
            '["0 mm", "0 mm", "10 mm"], ["30 mm", "0 mm", "10 mm"], ["60 mm", "0 mm", "10 mm"],\n'
            '    ["90 mm", "0 mm", "10 mm"], ["120 mm", "0 mm", "10 mm"],',
            '["0 mm", "0 mm", "10 mm"],',
            "centreline.points: a line has at least two points",
        ),
    ],
)
def test_a_mistake_is_told_with_its_key(write_finger: Write, old: str, new: str, told: str) -> None:
    path = write_finger((old, new))
    with pytest.raises(ConfigError) as caught:
        load(path)
    assert str(caught.value) == f"{path}: {told}"


def _without(text: str, start: str, end: str) -> tuple[str, str]:
    return text[text.index(start) : text.index(end)], ""


def test_parts_that_need_each_other_are_told(write_finger: Write, finger_text: str) -> None:
    def told(*changes: tuple[str, str]) -> str:
        path = write_finger(*changes)
        with pytest.raises(ConfigError) as caught:
            load(path)
        return str(caught.value).removeprefix(f"{path}: ")

    no_gas = _without(finger_text, "[gas]", "[contact]")
    assert told(no_gas).startswith("sensors.pressure: pressures are those of sealed cavities: add [gas]")
    no_sensors = _without(finger_text, "[sensors.pressure]", "[estimator]")
    no_cavities = _without(finger_text, '[[cavity]]\nname = "base left"', "[[cable]]")
    assert told(no_cavities, no_sensors) == "gas: there is no cavity to seal: add [[cavity]], or remove [gas]"
    no_electrodes = _without(finger_text, "[[electrode]]", "[[point]]")
    assert told(no_electrodes, no_sensors).startswith(
        "contact.model: a patch is pressed where an electrode is"
    )
    disc = (
        finger_text[finger_text.index('model = "patch"') : finger_text.index("[[electrode]]")],
        'model = "punch"\nradius = "4 mm"\nmax_force = "5 N"\ndirection = [0, 0, 1]\n'
        'workspace = { x = ["0 mm", "1 mm"], y = ["0 mm", "1 mm"] }\n\n',
    )
    assert told(disc).startswith('contact.model: electrodes tell which "patch" is pressed')
    load(write_finger(disc, no_sensors))


FLOW = '[sensors.flow]\ntype = "D6F-P0001A1"\nchannels = ["f0", "f1", "f2", "f3", "f4", "f5"]\n\n'
LINES = (
    '[sensors.capacitive]\ntype = "crossed-diamonds"\nrow_y = ["0 mm", "1 mm"]\ncolumn_x = ["0 mm", "1 mm"]\n'
    'row_depth = "1 mm"\ncolumn_depth = "2 mm"\n'
    'row_channels = ["r0", "r1"]\ncolumn_channels = ["c0", "c1"]\n\n'
)


@pytest.mark.parametrize(
    ("sensors", "told"),
    [
        (FLOW, "sensors: give either {}; there is [sensors.flow]"),
        ("[sensors]\n\n", "sensors: give either {}; there is neither"),
        (
            "[sensors.cable]\nchannels = ['cable0_mm']\n\n",
            "sensors: give either {}; there is neither",
        ),
        (
            FLOW + LINES + "[sensors.cable]\nchannels = ['cable0_mm']\n\n",
            "sensors.cable: goes with [sensors.pressure] and [sensors.electrodes] only",
        ),
        (FLOW + LINES, "sensors.flow: flow sensors are on vented cavities, [gas] seals them: remove one"),
    ],
)
def test_sensors_come_in_pairs(write_finger: Write, finger_text: str, sensors: str, told: str) -> None:
    given = finger_text[finger_text.index("[sensors.pressure]") : finger_text.index("[estimator]")]
    path = write_finger((given, sensors))
    pairs = (
        "[sensors.flow] and [sensors.capacitive] or [sensors.mutual], "
        "or [sensors.pressure] and [sensors.electrodes]"
    )
    with pytest.raises(ConfigError) as caught:
        load(path)
    assert str(caught.value) == f"{path}: {told.format(pairs)}"


def test_a_sensor_that_the_device_does_not_have_is_told_when_it_is_needed(
    write: Write, write_finger: Write
) -> None:
    finger, pad = load(write_finger()), load(write())
    assert finger.sensors is not None and pad.sensors is not None
    told = "missing, there is [sensors.{}] and [sensors.{}]"
    for key, of, given in (
        ("flow", finger, ("pressure", "electrodes")),
        ("capacitive", finger, ("pressure", "electrodes")),
        ("pressure", pad, ("flow", "capacitive")),
        ("electrodes", pad, ("flow", "capacitive")),
    ):
        with pytest.raises(ConfigError) as caught:
            getattr(of.sensors, key)
        assert str(caught.value) == f"{of.path}: sensors.{key}: {told.format(*given)}"
