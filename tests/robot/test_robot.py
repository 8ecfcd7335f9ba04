"""From the finger's settings to a robot: loads, contacts, readings, named points, and where everything is."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.errors import ConfigError
from softfuse.functional.cable import length
from softfuse.functional.chart import direction_of
from softfuse.functional.contact import Contact
from softfuse.mechanics.cable import PulledCable
from softfuse.mechanics.gas import SealedGas
from softfuse.mechanics.indenters import FlatIndenter, SurfacePatches
from softfuse.mechanics.prescribed import PrescribedForce
from softfuse.mesh.surface import outer_surface
from softfuse.robot.contacts import PatchSettings
from softfuse.robot.file import load
from softfuse.robot.mesh import RobotMesh, build_mesh
from softfuse.robot.robot import Addresses, Robot, build_robot
from softfuse.robot.settings import RobotSettings

Write = Callable[..., Path]
Edited = Callable[..., RobotSettings]

FRAME = eqx.filter_jit(Contact.frame)
LOWER_PALM = 'centre = ["45 mm", "0 mm", "0 mm"], direction = [0, 0, 1]'


@pytest.fixture(scope="module")
def settings(coarse_finger: Write) -> RobotSettings:
    """The finger, coarse."""
    return load(coarse_finger())


@pytest.fixture(scope="module")
def mesh(settings: RobotSettings) -> RobotMesh:
    """Its mesh."""
    return build_mesh(settings)


@pytest.fixture(scope="module")
def robot(settings: RobotSettings, mesh: RobotMesh) -> Robot:
    """The robot on it."""
    return build_robot(settings, mesh)


@pytest.fixture
def edited(coarse_finger: Write) -> Edited:
    """The settings with pieces of their text replaced, none of which moves the mesh."""
    return lambda *changes: load(coarse_finger(*changes))


def _gas(robot: Robot) -> SealedGas:
    gas = robot.model.actuators[1]
    assert isinstance(gas, SealedGas)
    return gas


def test_readings_and_drives_are_called_by_their_names(robot: Robot) -> None:
    chambers = [chamber.name for chamber in robot.settings.chambers]
    assert robot.addresses == Addresses(
        {"palm": 0, **{name: 1 + k for k, name in enumerate(chambers)}},
        {"pressure": slice(0, 6), "cable": slice(6, 7)},
        {"hand": slice(0, 2)},
    )
    model = robot.model
    assert isinstance(model.actuators[0], PulledCable) and isinstance(model.actuators[1], SealedGas)
    np.testing.assert_array_equal(model.answered, [1, 2, 3, 4, 5, 6, 0])
    np.testing.assert_array_equal(robot.reading_kinds, [0] * 6 + [1])
    places = jnp.asarray(list(robot.settings.places.values()))[jnp.array([0, 5])]
    state = model.rest_state(places)
    assert state.drive.shape == (4 + 1 + 6,)
    np.testing.assert_allclose(state.drive, [*[0] * 5, *[101325.0] * 6])
    np.testing.assert_allclose(model.reading(state, places), 0.0, atol=1e-12)
    low, high = robot.ranges
    np.testing.assert_allclose(low, [0, *[101325.0] * 6])
    np.testing.assert_allclose(high, [20, *[101325.0] * 6])


def test_guides_are_where_the_settings_say(robot: Robot) -> None:
    cable = robot.model.actuators[0]
    assert isinstance(cable, PulledCable)
    ports, body = cable.ports, robot.model.body
    places = ports.values(body, jnp.zeros(body.n)).reshape(-1, 3)
    x = np.array([2, 12, 22, 38, 52, 68, 82, 98, 108, 116])
    np.testing.assert_allclose(1e3 * places, np.stack([x, 0 * x, 0 * x + 3], axis=1), atol=1e-9)
    assert float(length(ports.location, cable.pulled_at)) == pytest.approx(0.121)
    # Each guide is inside its element, or its shape values would extrapolate.
    shape = np.asarray(ports.points.shape(body.rest))
    np.testing.assert_allclose(shape.sum(axis=1), 1.0)
    assert np.abs(shape).max() <= 1.0 + 1e-9


def test_chambers_hold_gas_in_the_order_of_the_settings(robot: Robot) -> None:
    gas = _gas(robot)
    np.testing.assert_allclose(gas.rest, 480e-9)
    np.testing.assert_allclose(gas.dead, 100e-9)
    assert (float(gas.atmosphere), float(gas.exponent)) == (101325.0, 1.0)
    for cavity, given in zip(gas.ports.cavities, robot.settings.chambers, strict=True):
        middle = np.asarray(robot.model.body.rest)[np.unique(cavity.faces)].mean(axis=0)
        np.testing.assert_allclose(middle, given.centre, atol=1.5e-3)


def test_each_chamber_has_a_gas_of_its_own(edited: Edited, mesh: RobotMesh) -> None:
    """One sealed adiabatically, one driven, one vented: no sensor of the finger goes with that any more."""
    settings = edited()
    changes = (
        {"exponent": 1.4},
        {"gas": "driven", "highest": 20e3, "dead_volume": 0.0},
        {"dead_volume": 5e-9},
        {"gas": "vented"},
        {},
        {},
    )
    chambers = tuple(
        chamber.model_copy(update=change) for chamber, change in zip(settings.chambers, changes, strict=True)
    )
    robot = build_robot(settings.model_copy(update={"chambers": chambers, "sensors": ()}), mesh)
    cable, slow, fast, driven = robot.model.actuators
    assert isinstance(cable, PulledCable) and isinstance(driven, PrescribedForce)
    assert isinstance(slow, SealedGas) and isinstance(fast, SealedGas)
    np.testing.assert_allclose(slow.dead, [5e-9, 100e-9, 100e-9])
    assert (float(slow.exponent), float(fast.exponent)) == (1.0, 1.4)
    names = [chamber.name for chamber in chambers]
    order = ["palm", names[2], names[4], names[5], names[0], names[1]]
    assert robot.addresses.drives == {name: k for k, name in enumerate(order)}
    low, high = robot.ranges
    np.testing.assert_allclose(low, [0, *[101325.0] * 4, 0])
    np.testing.assert_allclose(high, [20, *[101325.0] * 4, 20e3])
    parts = robot.parts.chambers
    assert [parts[name].drive for name in names] == [4, 5, 1, None, 2, 3]
    assert [parts[name].sealed for name in names] == [True, False, True, False, True, True]


def _check_frames(contact: SurfacePatches, robot: Robot) -> None:
    (contact_settings,) = robot.settings.contacts
    assert isinstance(contact_settings, PatchSettings)
    (electrodes,) = [sensor for sensor in robot.settings.sensors if sensor.places]
    assert [*robot.settings.places] == [seen.name for seen in electrodes.places]
    assert len(electrodes.places) == 12
    span = contact_settings.span or 0.0
    for electrode in electrodes.electrodes:
        place = electrode.place()
        middles = np.array(electrode.centre) + np.outer(span * np.array([-0.5, 0.5]), [1.0, 0, 0])
        patches = contact.discs(robot.model.body, jnp.asarray(place))
        for patch, middle in zip(patches, middles[: contact.drives], strict=True):
            frame = np.asarray(FRAME(patch, robot.model.body)[0])
            np.testing.assert_allclose(frame[:3], middle, atol=1e-12)
            np.testing.assert_allclose(np.cross(frame[3:6], frame[6:9]), electrode.direction, atol=1e-12)
        np.testing.assert_allclose(direction_of(jnp.asarray(place)), electrode.direction, atol=1e-15)


def test_patches_are_on_the_electrodes_and_press_inwards(robot: Robot) -> None:
    (contact,) = robot.model.contacts
    assert isinstance(contact, SurfacePatches)
    np.testing.assert_allclose(contact.offsets, [-5e-3, 5e-3])
    assert contact.drives == 2 and float(contact.radius) == 4e-3
    assert not robot.unseen.any() and robot.workspaces == (None, None)
    _check_frames(contact, robot)


def test_a_contact_without_a_span_presses_in_the_middle(robot: Robot, mesh: RobotMesh) -> None:
    (contact,) = robot.settings.contacts
    middle = contact.model_copy(update={"span": None})
    pressed = middle.contact(outer_surface(mesh.mesh).faces, mesh.mesh.nodes)
    assert isinstance(pressed, SurfacePatches) and pressed.drives == 1
    _check_frames(pressed, replace(robot, settings=robot.settings.model_copy(update={"contacts": (middle,)})))


def test_a_punch_has_the_layer_that_is_given(coarse: Path) -> None:
    (contact,) = load(coarse).contacts
    contact = contact.model_copy(update={"compliance": 0.5e-9})
    rest, faces = np.array([[0, 0, 1.0], [1, 0, 1], [0, 1, 1]]), np.array([[0, 1, 2]])
    punch = contact.contact(faces, rest)
    assert isinstance(punch, FlatIndenter)
    assert float(punch.compliance) == 0.5e-9
    real = contact.real(0.1e-9).contact(faces, rest)
    assert float(real.compliance) == pytest.approx(0.6e-9)


def test_points_and_centreline_are_in_the_material(robot: Robot) -> None:
    rest = robot.model.body.rest
    for points, expected in (
        (robot.points(), [p.at for p in robot.settings.points]),
        (robot.centreline(), [(x, 0.0, 0.01) for x in (0.0, 0.03, 0.06, 0.09, 0.12)]),
    ):
        assert points is not None
        found = jnp.einsum("ga,gai->gi", points.shape(rest), rest[points.nodes])
        np.testing.assert_allclose(found, expected, atol=1e-12)


def test_a_robot_may_have_no_points(robot: Robot) -> None:
    bare = replace(robot, settings=robot.settings.model_copy(update={"points": (), "centreline": None}))
    assert bare.points().shape(robot.model.body.rest).shape == (0, 10)
    assert bare.centreline() is None


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('["22 mm", "0 mm", "3 mm"]', '["30 mm", "0 mm", "3 mm"]',
         r"cable\[0\]: guide 2 at \(30, 0, 3\) mm lies outside the body by 2 mm \(nearest place \("),
        ('["60 mm", "0 mm", "10 mm"]', '["60 mm", "5 mm", "10 mm"]',
         r"centreline.points: point 2 at \(60, 5, 10\) mm lies outside the body by 2.5 mm"),
        ('at = ["105 mm", "0 mm"', 'at = ["125 mm", "0 mm"', r"point: point 1 at \(125, 0, 10\) mm"),
    ],
)  # fmt: skip
def test_points_outside_the_material_are_told(
    edited: Edited, mesh: RobotMesh, old: str, new: str, told: str
) -> None:
    wrong = edited((old, new))
    with pytest.raises(ConfigError, match=rf"^{wrong.path}: {told}"):
        made = build_robot(wrong, mesh)
        made.centreline()
        made.points()


def test_chambers_of_another_mesh_are_told(settings: RobotSettings, mesh: RobotMesh) -> None:
    cavity = mesh.cavities[0]
    lost = replace(cavity, faces=np.array([[0, 1, 2], [0, 2, 1]]), tets=cavity.tets[:2])
    with pytest.raises(
        ConfigError, match=rf"^{settings.path}: chamber: a cavity has a face that belongs to no"
    ):
        build_robot(settings, replace(mesh, cavities=(lost,) * 6))


@pytest.mark.parametrize(
    "moved",
    [
        'centre = ["30 mm", "0 mm", "0 mm"], direction = [0, 0, 1]',  # 5 mm deep in the notch
        'centre = ["45 mm", "30 mm", "0 mm"], direction = [0, 0, 1]',  # beside the finger
        'centre = ["45 mm", "0 mm", "0 mm"], direction = [0, 0, -1]',  # enters the body at its back
    ],
)
def test_an_electrode_off_the_surface_is_told(edited: Edited, mesh: RobotMesh, moved: str) -> None:
    wrong = edited((LOWER_PALM, moved))
    told = 'sensor[1].electrodes[3].centre: "lower palm" is not within the radius of contact "hand" of where'
    with pytest.raises(ConfigError) as caught:
        build_robot(wrong, mesh)
    assert str(caught.value).startswith(f"{wrong.path}: {told}")


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('contact = "hand" ', 'contact = "paw" ', 'sensor "electrodes": there is no contact "paw", but'),
        ('cables = ["palm"]', 'cables = ["back"]', 'sensor "cable": there is no cable "back", but "palm"'),
        ("at_once = 2", "at_once = 13", 'sensor "electrodes": 13 contacts at once on 12 electrodes: give'),
        ('model = "patch" ', 'model = "patch"\nsurface = {x = ["1 m", "2 m"]} #',
         "contact[0].surface: no part of the outer surface is in these ranges: widen them"),
    ],
)  # fmt: skip
def test_parts_that_do_not_go_together_are_told(
    edited: Edited, mesh: RobotMesh, old: str, new: str, told: str
) -> None:
    wrong = edited((old, new))
    with pytest.raises(ConfigError) as caught:
        build_robot(wrong, mesh)
    assert str(caught.value).startswith(f"{wrong.path}: {told}")


def test_pressures_are_not_those_of_vented_chambers(settings: RobotSettings, mesh: RobotMesh) -> None:
    vented = tuple(chamber.model_copy(update={"gas": "vented"}) for chamber in settings.chambers)
    with pytest.raises(ConfigError) as caught:
        build_robot(settings.model_copy(update={"chambers": vented}), mesh)
    told = 'sensor "pressure": chamber "base left" is vented, so that there is no pressure in it'
    assert str(caught.value) == f"{settings.path}: {told}"
