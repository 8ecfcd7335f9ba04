"""softfuse simulate: presses, cables and pressures by name."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from softfuse.mechanics.cable import PulledCable, ShortenedCable
from softfuse.mesh.files import read_mesh
from softfuse.robot.file import load
from softfuse.robot.robot import Robot, build_robot
from softfuse.robot.trial import Press, Trial

PAD = Path(__file__).parents[2] / "configs" / "pad.toml"


def test_numbers_and_shape_are_written(code_of: Callable[..., int], tmp_path: Path) -> None:
    numbers, shape = tmp_path / "n.json", tmp_path / "s.vtu"
    given = ("--at", "10,-6", "--force", "5", "--quiet")
    assert code_of("simulate", PAD, *given, "--json", numbers, "--vtu", shape) == 0
    found = json.loads(numbers.read_text())
    assert found["result"] == "converged" and found["residual_N"] < 1e-9 and found["cables"] == {}
    (press,) = found["contacts"]
    assert press["force_N"] == 5.0 and press["depth_mm"] > 0.1
    np.testing.assert_allclose(press["place_mm"], [10.0, -6.0, 18.0])
    assert len(read_mesh(shape).nodes) == found["nodes"] <= 5000
    volumes = {name: each["volume_change_mm3"] for name, each in found["chambers"].items()}
    assert list(volumes) == ["(-,-)", "(-,+)", "(+,-)", "(+,+)"]
    # The chamber under it is squeezed most; the flow sensors measure the chambers.
    assert min(volumes, key=volumes.__getitem__) == "(+,-)" and volumes["(+,-)"] < -50.0
    readings = [each["value"] for each in found["readings"].values()]
    np.testing.assert_allclose(1e9 * np.array(readings), [*volumes.values()])
    assert {each["unit"] for each in found["readings"].values()} == {"m^3"}


@pytest.fixture(scope="module")
def limb(linear_finger: Callable[..., Path]) -> Path:
    """A config with electrodes, a cable and sealed chambers, coarse."""
    return linear_finger()


@pytest.fixture(scope="module")
def robot(limb: Path) -> Robot:
    return build_robot(load(limb))


@pytest.mark.slow
def test_a_push_and_a_pull_give_numbers_and_a_shape(
    code_of: Callable[..., int], tmp_path: Path, limb: Path
) -> None:
    numbers, shape = tmp_path / "n.json", tmp_path / "s.vtu"
    given = ("--at", "tip left", "--force", "0.2", "--cable", "5 mm", "--quiet")
    assert code_of("simulate", limb, *given, "--json", numbers, "--vtu", shape) == 0
    found = json.loads(numbers.read_text())
    assert found["result"] == "converged" and found["contacts"][0]["at"] == "tip left"
    cable = found["cables"]["palm"]
    assert cable["shortening_mm"] == pytest.approx(5.0) and 0.5 < cable["tension_N"] < 5.0
    # What is told of the sensors is that of the pulled cable.
    readings = {name: each["value"] for name, each in found["readings"].items()}
    assert [value for name, value in readings.items() if name.endswith("palm")] == [pytest.approx(5e-3)]
    pressures = [each["pressure_Pa"] for each in found["chambers"].values()]
    assert len(pressures) == 6 and max(map(abs, pressures)) > 10.0
    # Pushed from the left it goes right, and the palm's cable pulls it down.
    x, y, z = found["points_mm"]["p0"]
    assert x < 117.0 and y < -2.0 and z < 0.0
    assert found["tip_bend_deg"] > 10.0 and len(found["bend_deg"]) == 4
    assert len(read_mesh(shape).nodes) == found["nodes"]


def test_a_cable_is_shortened_or_pulled(robot: Robot) -> None:
    patches = robot.model.contacts[0].drives
    for text, kind, value in (("palm=5 mm", ShortenedCable, 5e-3), ("2 N", PulledCable, 2.0)):
        trial = Trial.of(robot, [Press(None, "lower left", 0.2)], [text])
        assert isinstance(trial.model.actuators[0], kind)
        np.testing.assert_allclose(trial.places[0], robot.settings.places["lower left"])
        np.testing.assert_allclose(trial.drive[: patches + 1], [*[0.2 / patches] * patches, value])
        np.testing.assert_allclose(trial.drive[patches + 1 :], robot.settings.environment.atmosphere)


def test_a_point_is_carried_to_the_surface(robot: Robot) -> None:
    """Of a contact without coordinates to the nearest one, of a disc along its direction."""
    trial = Trial.of(robot, [Press(None, "45,14,10", 0.1), Press(None, "75,0,30", 0.1)])
    np.testing.assert_allclose(trial.places[:, 0], 1e-3 * np.array([[45, 10, 10], [75, 0, 20]]), atol=1e-6)
    outward = np.cross(trial.places[:, 1], trial.places[:, 2])
    np.testing.assert_allclose(outward, [[0, 1, 0], [0, 0, 1]], atol=1e-6)
    assert len(trial.drive) == 2 * robot.model.contacts[0].drives + len(robot.addresses.drives)


def test_nothing_but_gravity_needs_no_contact(robot: Robot) -> None:
    trial = Trial.of(robot)
    assert trial.places.shape == (0, 3, 3) and trial.model.contacts == ()
    assert len(trial.drive) == len(robot.addresses.drives)


@pytest.mark.slow
def test_a_search_that_fails_says_how_far_it_came_and_keeps_that_state(
    code_of: Callable[..., int], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """And from what it kept the way goes on."""
    numbers, shape = tmp_path / "n.json", tmp_path / "s.vtu"
    press = ("simulate", PAD, "--at", "10,-6", "--quiet")
    assert code_of(*press, "--force", "3000", "--json", numbers, "--vtu", shape) == 2
    found = json.loads(numbers.read_text())
    assert found["result"] in ("inverted", "diverged", "step_limit") and found["residual_N"] < 1e-6
    assert 0 < found["reached"] < 1
    (there,) = found["contacts"]
    assert there["force_N"] == pytest.approx(3000 * found["reached"])
    err = capsys.readouterr().err
    assert f"{100 * found['reached']:.3g} % of the way" in err and str(shape) in err
    assert len(read_mesh(shape).nodes) == found["nodes"]
    again = tmp_path / "again.json"
    force = repr(there["force_N"])
    assert code_of(*press, "--force", force, "--start", numbers, "--json", again) == 0
    kept = json.loads(again.read_text())
    assert kept["newton_iterations"] <= 2
    assert kept["contacts"][0]["depth_mm"] == pytest.approx(there["depth_mm"])
    assert code_of(*press, "--force", "5", "--start", shape) == 2
    assert "no state to begin with" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (
            ("--at", "thumb", "--force", "1"),
            '--at "thumb" is no place of this contact: give X,Y,Z in mm, or',
        ),
        (("--at", "1,2", "--force", "1"), '--at "1,2" is no place of this contact'),
        (("--force", "1"), "0 times --at and 1 times --force"),
        (("--at", "tip left"), "1 times --at and 0 times --force"),
        (("--contact", "thumb", "--at", "tip left", "--force", "1"), "say which one is meant"),
        (("--cable", "10"), "expected a length such as NAME=64 mm or a force such as NAME=15 N"),
        (("--cable", "-1 mm"), "a cable is shortened or pulled, from 0 up"),
        (("--cable", "1 mm", "--cable", "1 mm"), "palm is given twice"),
        (("--cable", "thumb=1 mm"), 'say which one, NAME=1 mm, with one of "palm"'),
        (("--pressure", "20 kPa"), "nothing that could be driven so"),
    ],
)
def test_a_mistake_is_one_line(
    code_of: Callable[..., int],
    capsys: pytest.CaptureFixture[str],
    limb: Path,
    arguments: tuple[str, ...],
    told: str,
) -> None:
    assert code_of("simulate", limb, *arguments) == 2
    err = capsys.readouterr().err
    assert told in err and err.count("\n") == 1


def test_a_disc_that_overhangs_is_told(
    code_of: Callable[..., int], capsys: pytest.CaptureFixture[str], coarse: Path
) -> None:
    assert code_of("simulate", coarse, "--at", "35,0", "--force", "5") == 2
    err = capsys.readouterr().err
    assert "overhangs the surface, which spans x -40 to 40" in err and err.count("\n") == 1


@pytest.mark.slow
def test_the_cable_bends_the_limb_beyond_a_right_angle(
    code_of: Callable[..., int], tmp_path: Path, limb: Path
) -> None:
    numbers = tmp_path / "n.json"
    assert code_of("simulate", limb, "--cable", "25 mm", "--quiet", "--json", numbers) == 0
    found = json.loads(numbers.read_text())
    assert found["result"] == "converged" and found["tip_bend_deg"] > 90.0
    assert found["residual_N"] < 1e-6
