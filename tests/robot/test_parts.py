"""Cables, chambers, contacts, electrodes and points: what is read, and how mistakes are told."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from softfuse.errors import ConfigError
from softfuse.robot.contacts import PatchSettings
from softfuse.robot.file import load
from softfuse.sensors.electrodes import ElectrodePlace, ElectrodeSettings

Write = Callable[..., Path]

FIRST_GUIDE = '["2 mm", "0 mm", "3 mm"]'
PATCH = 'model = "patch" '
BASE_PALM = 'centre = ["12 mm", "0 mm", "0 mm"], direction = [0, 0, 1]'
SEALED = 'gas = "sealed"                                  #'
DEAD = 'dead_volume = "100 mm^3"                        # of'
WINCH = '# command = { channel = "winch_mm", unit = "mm" } '


def test_the_finger_has_what_the_design_attaches_to_it(write_finger: Write) -> None:
    settings = load(write_finger())
    (cable,) = settings.cables
    assert cable.guides == tuple((x / 1000, 0.0, 0.003) for x in (2, 12, 22, 38, 52, 68, 82, 98, 108, 116))
    assert (cable.pulled_at, cable.friction, cable.max_tension) == ((-5e-3, 0.0, 3e-3), 0.0, 20.0)
    assert (cable.command, cable.compliance) == (None, 0.0)
    for chamber in settings.chambers:
        assert (chamber.gas, chamber.exponent) == ("sealed", 1.0)
        assert chamber.dead_volume == pytest.approx(100e-9)
    assert settings.environment.atmosphere == 101325.0
    contact = settings.contact()
    assert isinstance(contact, PatchSettings)
    assert (contact.radius, contact.at_once, contact.span) == (4e-3, 2, 10e-3)
    (electrodes,) = settings.sensors_of(ElectrodeSettings)
    assert [e.name for e in electrodes.electrodes] == [
        f"{segment} {side}"
        for segment in ("base", "lower", "upper", "tip")
        for side in ("palm", "left", "right")
    ]
    places = [((0.0, 0.0), (0, 0, 1)), ((0.01, 0.01), (0, -1, 0)), ((-0.01, 0.01), (0, 1, 0))]
    assert [(e.centre, e.direction) for e in electrodes.electrodes] == [
        ((x, *yz), into) for x in (0.012, 0.045, 0.075, 0.108) for yz, into in places
    ]
    assert [(p.name, p.at) for p in settings.points] == [
        ("p0", (0.117, 0.0, 0.01)),
        ("p1", (0.105, 0.0, 0.01)),
        ("p2", (0.09, 0.0, 0.0125)),
        ("p3", (0.075, 0.0, 0.01)),
    ]
    assert settings.centreline is not None
    assert settings.centreline.points == tuple((x, 0.0, 0.01) for x in (0.0, 0.03, 0.06, 0.09, 0.12))


def electrode_of(direction: Sequence[float], along: Sequence[float] | None) -> ElectrodePlace:
    """An electrode at (10, 20, 30) mm."""
    given = {"name": "side", "centre": ["10 mm", "20 mm", "30 mm"], "direction": direction, "along": along}
    return ElectrodePlace.model_validate(given)


@pytest.mark.parametrize("direction", [(0.0, 1.0, 0.0), (2.0, 1.0, 0.0), (0.3, -0.4, 1.2)])
def test_the_first_tangent_of_an_electrode_is_along_its_axis_across_the_direction(direction) -> None:
    """What of the axis is along the direction counts for nothing: patches are carried along that."""
    axis = np.array([0.8, 0.0, 0.6])
    point, u, v = electrode_of(direction, axis.tolist()).place()
    np.testing.assert_array_equal(point, [0.01, 0.02, 0.03])
    np.testing.assert_allclose([u @ u, v @ v, u @ v], [1, 1, 0], atol=1e-15)
    into = np.array(direction) / np.linalg.norm(direction)
    np.testing.assert_allclose(np.cross(v, u), into, atol=1e-15)
    assert u @ axis > 0
    np.testing.assert_allclose(np.cross(axis - (axis @ u) * u, into), 0.0, atol=1e-15)


def test_an_electrode_without_an_axis_has_one_of_x_y_z() -> None:
    place = electrode_of((0.0, 0.0, -1.0), None).place()
    np.testing.assert_array_equal(place, [[0.01, 0.02, 0.03], [1, 0, 0], [0, 1, 0]])


def test_an_axis_along_the_direction_is_told() -> None:
    with pytest.raises(ValidationError, match="runs along the direction: give it along the surface"):
        electrode_of((0.3, -0.4, 1.2), [3, -4, 12])


def test_the_finger_has_a_column_for_every_reading(write_finger: Write) -> None:
    columns = tuple(f"pressure{k}_V" for k in range(6)), tuple(f"electrode{k}" for k in range(12))
    settings = load(write_finger())
    assert settings.channels == (*columns[0], *columns[1], "cable0_mm")
    measured = load(
        write_finger(
            ('reference = "5 V" ', 'reference_channel = "supply_V"\nreference = "5 V" '),
            (WINCH, WINCH.removeprefix("# ")),
        )
    )
    assert measured.channels == (*columns[0], "supply_V", *columns[1], "cable0_mm", "winch_mm")
    assert measured.commands == ("winch_mm",)
    command = measured.cables[0].command
    assert command is not None and (command.of, command.factor) == ("length", 1e-3)


def test_the_cable_is_optional_and_so_is_its_sensor(write_finger: Write, finger_text: str) -> None:
    start = finger_text.index("[[sensor]]                                      # by how much each cable")
    sensor = finger_text[start : finger_text.index("[estimator]")]
    settings = load(write_finger((sensor, "")))
    assert [each.name for each in settings.sensors] == ["pressure", "electrodes"] and len(
        settings.cables
    ) == 1
    cable = finger_text[finger_text.index("[[cable]]") : finger_text.index("[[contact]]")]
    assert load(write_finger((sensor, ""), (cable, ""))).cables == ()


def test_a_chamber_may_be_driven(write_finger: Write) -> None:
    driven = 'gas = "driven"\nlowest = "-20 kPa"\nhighest = "50 kPa"\n'
    driven += 'command = { channel = "supply", unit = "mbar" } #'
    settings = load(write_finger((SEALED, driven)))
    chamber = settings.chambers[0]
    assert (chamber.lowest, chamber.highest) == (-20e3, 50e3) and settings.commands == ("supply",)
    assert chamber.command is not None
    assert (chamber.command.of, chamber.command.factor) == ("pressure", 100.0)


_UNIT = (
    'cable[0].command.unit: "A" is no unit of a length, a tension or a pressure: give one such as "mm", "N" '
    'or "kPa"'
)
_DESCENDING = "contact[0].surface.x: the first value must not exceed the second"


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
            "sensor[2].zero: 2 values for 1 channels: give one, or one for each",
        ),
        (WINCH, 'command = { channel = "winch", unit = "A" } ', _UNIT),
        (
            WINCH,
            'command = { channel = "winch", unit = "kPa" } ',
            "cable[0].command.unit: a cable is commanded to a length or a tension",
        ),
        (
            WINCH,
            'command = { channel = "cable0_mm", unit = "mm" } ',
            'sensor: "cable0_mm" is the column of two sensors or commands: give each its own',
        ),
        (
            SEALED,
            'gas = "pumped" #',
            'chamber[0].gas: "pumped" is none of "vented", "sealed", "driven"',
        ),
        (
            SEALED,
            'gas = "driven" #',
            "chamber[0].highest: missing: the highest pressure that the chamber is driven to",
        ),
        (
            SEALED,
            'gas = "driven"\nhighest = "1 kPa"\ncommand = { channel = "p", unit = "N" } #',
            "chamber[0].command.unit: a chamber is commanded to a pressure",
        ),
        (
            SEALED,
            'gas = "sealed"\nhighest = "1 kPa" #',
            'chamber[0].command: only a chamber with gas = "driven" has it, this one is sealed',
        ),
        (
            SEALED,
            'gas = "driven"\nhighest = "1 kPa"\nlowest = "1 Pa" #',
            'chamber[0].lowest: "1 Pa" must be less than or equal to 0',
        ),
        (
            DEAD,
            DEAD.replace("^3", "^2"),
            'chamber[0].dead_volume: "100 mm^2" is an area, expected a volume such as "785 mm^3"',
        ),
        (
            DEAD,
            DEAD.replace("100", "-1"),
            'chamber[0].dead_volume: "-1 mm^3" must be greater than or equal to 0',
        ),
        ("exponent = 1.0", "exponent = 0.9", "chamber[0].exponent: 0.9 must be greater than or equal to 1"),
        (
            PATCH,
            'model = "pinch" #',
            'contact[0].model: "pinch" is none of "punch", "uniform", "sphere", "cylinder", "patch", "force"',
        ),
        (
            PATCH,
            'model = "patch"\ndirection = [0, 0, -1] #',
            "contact[0].workspace: missing, needed with direction",
        ),
        (PATCH, 'model = "patch"\nsurface = { x = ["2 mm", "1 mm"] } #', _DESCENDING),
        (
            PATCH,
            'model = "patch"\nsurface = { normal = [0, 0, 0] } #',
            "contact[0].surface.normal: the direction has no length; use [0, 0, -1] for downwards",
        ),
        ("at_once = 2", "at_once = 0", "contact[0].at_once: 0 must be greater than 0"),
        (
            BASE_PALM,
            BASE_PALM.replace("1]", "0]"),
            "sensor[1].electrodes[0].direction: the direction has no length; use [0, 0, -1] for downwards",
        ),
        (
            BASE_PALM + ", along = [1, 0, 0]",
            BASE_PALM + ", along = [0, 0, 2]",
            "sensor[1].electrodes[0].along: runs along the direction: give it along the surface",
        ),
        (
            '{ name = "base left", centre',
            '{ name = "base palm", centre',
            'sensor[1].electrodes[1].name: the name "base palm" is taken by sensor[1].electrodes[0]',
        ),
        ('name = "p1"', 'name = "p0"', 'point[1].name: the name "p0" is taken by point[0]'),
        (
            '"electrode11",',
            "",
            "sensor[1].channels: 11 for 12 electrodes",
        ),
        (
            '"pressure5_V",',
            "",
            "sensor[0].channels: 5 for 6 chambers",
        ),
        (
            '["cable0_mm"]',
            '["cable0_mm", "cable1_mm"]',
            "sensor[2].channels: 2 values for 1 channels: give one, or one for each",
        ),
        (
            '["cable0_mm"]',
            '["electrode3"]',
            'sensor: "electrode3" is the column of two sensors or commands: give each its own',
        ),
        (
            'reference = "5 V"',
            'reference = "3.3 V"',
            "sensor[0].reference: 3.3 is not between 4.75 and 5.25",
        ),
        ('high = "4.998 V"', 'high = "1 mV"', "sensor[0].low: must be below high = 0.001"),
        (
            'average = "0.2 s" ',
            'leak.fastest = "3 min" ',
            "sensor[0].leak.fastest: must be below slowest = 120 s",
        ),
        (
            "off_counts = 400.0",
            "off_counts = 700.0",
            "sensor[1].off_counts: must not exceed on_counts = 600",
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
