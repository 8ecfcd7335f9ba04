"""Plans of sweeps: what they say, which cases they give, and how mistakes are told."""

import itertools
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from softfuse.errors import ConfigError
from softfuse.robot.digest import digest
from softfuse.robot.file import load
from softfuse.robot.press_plan import ElectrodePlaces, load_plan
from softfuse.robot.press_series import Series, build_series, driven_of, places_of
from softfuse.robot.robot import build_robot

Write = Callable[..., Path]

ROOT = Path(__file__).parents[2]
PAD, FINGER, DOME, TRUNK = (
    ROOT / "configs" / name for name in ("pad.toml", "finger.toml", "dome.toml", "trunk.toml")
)
FORCES = '[forces]\nvalues = ["1 N", "3 N"]\n'
GRID = '[places]\ntype = "grid"\ncount = [3, 2]\n' + FORCES
RANDOM = '[places]\ntype = "random"\ncount = 20\n' + FORCES
LISTED = '[places]\ntype = "list"\nat = [["10 mm", "-6 mm"], ["-20 mm", "0 mm"]]\n' + FORCES
ELECTRODES = '[places]\ntype = "electrodes"\n' + FORCES
PALM = '[[cable]]\nname = "palm"\n'
POINTS = '[places]\ntype = "list"\nat = [["0 mm", "0 mm", "30 mm"], ["15 mm", "0 mm", "26 mm"]]\n' + FORCES
SURFACE = '[places]\ntype = "surface"\n' + FORCES
PRESSED = '[[chamber]]\nname = "chamber 1"\npressure = { values = ["0 kPa", "10 kPa"] }\n'


@pytest.fixture
def series(tmp_path: Path) -> Callable[[str, Path], list[Series]]:
    """series(text, config): what a plan of this text gives for the robot of a config."""

    def build(text: str, config: Path) -> list[Series]:
        path = tmp_path / "plan.toml"
        path.write_text(text, encoding="utf-8")
        return build_series(load_plan(path), load(config))

    return build


def test_the_example_is_a_plan_for_the_pad(series: Callable) -> None:
    text = (ROOT / "configs" / "pad_sweep.toml").read_text(encoding="utf-8")
    found = series(text, PAD)
    # 25 places, and of their 300 pairs the 228 that are 24 mm apart.
    pairs = [
        p for p in itertools.combinations(itertools.product(range(5), range(5)), 2) if math.dist(*p) >= 2
    ]
    assert len(found) == 3 * (25 + len(pairs))
    assert found[0].levels == (2.0, 4.0, 6.0, 8.0, 10.0)
    assert {one.modulus_factor for one in found} == {0.9, 1.0, 1.1}
    np.testing.assert_allclose(found[0].places, [(-24e-3, -24e-3)])
    np.testing.assert_allclose(found[1].places, [(-12e-3, -24e-3)])
    # Its comments tell of the other keys.
    finger = text.replace('type = "grid"', '# type = "grid"').replace('# type = "electr', 'type = "electr')
    for key in ("count = [5", 'x = ["', 'y = ["', "apart = "):
        finger = finger.replace(key, f"# {key}")
    for key in ("names = [", "[[cable]]", 'name = "palm"', "shortening = {"):
        finger = finger.replace(f"# {key}", key)
    found = series(finger, FINGER)
    assert len(found) == 3 * 5 * (2 + 1) and found[1].driven == (0.0,) and found[-1].driven == (10e-3,)


def test_cases_are_counted_through(series: Callable) -> None:
    found = series("contacts = [1, 2]\nmodulus_factors = [0.5, 1]\n" + GRID, PAD)
    assert [one.number for one in found] == list(range(0, 2 * len(found), 2))
    assert len(found) == 2 * (6 + 15) and len(set(found)) == len(found)
    singles = [one.places[0] for one in found[:6]]
    assert singles == [(x, y) for y in (-30e-3, 30e-3) for x in (-30e-3, 0.0, 30e-3)]


def test_several_contacts_are_apart(series: Callable) -> None:
    far = series("contacts = 2\n" + GRID.replace("count", 'apart = "40 mm"\ncount'), PAD)
    assert 0 < len(far) < 15
    assert all(math.dist(*one.places) >= 40e-3 for one in far)
    for one in series("contacts = [2, 4]\n" + RANDOM, PAD):
        assert all(math.dist(a, b) >= 20e-3 for a, b in itertools.combinations(one.places, 2))


def test_random_places_are_spread_evenly_and_the_same_again(series: Callable) -> None:
    text = RANDOM.replace("20", "2000\nseed = 3")
    found = series(text, PAD)
    at = np.array([one.places[0] for one in found])
    assert len(at) == 2000 and at.min() >= -30e-3 and at.max() <= 30e-3
    # Standard deviation of a mean of 2000: 0.39 mm.
    np.testing.assert_allclose(at.mean(axis=0), 0, atol=1.6e-3)
    np.testing.assert_allclose(at.std(axis=0), 60e-3 / math.sqrt(12), rtol=0.05)
    assert series(text, PAD) == found
    assert series(text.replace("seed = 3", "seed = 4"), PAD) != found


def test_electrodes_and_cables_of_a_finger(series: Callable, tmp_path: Path) -> None:
    cable = PALM + 'tension = { values = ["0 N", "2 N"] }\n'
    found = series("contacts = [1, 2]\n" + ELECTRODES + cable, FINGER)
    assert len(found) == 2 * (12 + 66)
    assert found[0].places == ("base palm",) and found[0].driven == (0.0,) and found[-1].driven == (2.0,)
    plan = tmp_path / "plan.toml"
    assert driven_of(load_plan(plan), load(FINGER)) == {"palm": "tension"}
    plan.write_text(ELECTRODES + PALM + 'shortening = { from = "0 mm", to = "4 mm", count = 3 }\n')
    assert driven_of(load_plan(plan), load(FINGER)) == {"palm": "shortening"}
    assert isinstance(load_plan(plan).places, ElectrodePlaces)


def test_places_all_over_a_surface_are_well_spread(series: Callable) -> None:
    every = series(SURFACE, DOME)
    few = series(SURFACE.replace("[forces]", "count = 8\n[forces]"), DOME)
    assert len(every) > 20 and [one.places for one in few] == [one.places for one in every[:8]]
    points = np.array([one.places[0] for one in few])
    apart = np.linalg.norm(points[:, None] - points, axis=-1)[np.triu_indices(8, 1)]
    # Eight patches of a half ball of 30 mm.
    assert points.shape == (8, 3) and points[:, 2].min() > 7.9e-3 and apart.min() > 15e-3
    far = series("contacts = 2\n" + SURFACE.replace("[forces]", 'apart = "45 mm"\n[forces]'), DOME)
    assert 0 < len(far) < len(every) ** 2 / 8 and all(math.dist(*one.places) >= 45e-3 for one in far)


def test_points_are_put_on_the_surface(series: Callable) -> None:
    config = load(DOME)
    robot = build_robot(config)
    surface = np.asarray(robot.model.body.rest), np.asarray(robot.parts.faces)
    top, side = (places_of(config, one, surface=surface)[0] for one in series(POINTS, DOME))
    np.testing.assert_allclose(top[0], [0, 0, 30e-3], atol=5e-4)
    np.testing.assert_allclose(side[0], [15e-3, 0, 26e-3], atol=1e-3)


def test_what_is_only_driven_is_not_pressed(series: Callable) -> None:
    cables = '[[cable]]\nname = "cable 0"\ntension = { values = ["0 N", "1 N", "2 N"] }\n'
    found = series("modulus_factors = [1, 2]\n" + PRESSED + cables, TRUNK)
    assert len(found) == 2 * 3 * 2 and {one.places for one in found} == {()}
    assert [one.driven for one in found[:3]] == [
        (0, 0, 0, 0, 0, 0),
        (0, 0, 0, 0, 10e3, 0),
        (1, 0, 0, 0, 0, 0),
    ]
    assert places_of(load(TRUNK), found[0]).shape == (0, 3, 3)


def test_a_digest_is_of_what_is_said(tmp_path: Path, write: Write) -> None:
    plan = tmp_path / "plan.toml"
    digests = []
    for text in (GRID, "# a comment\n" + GRID.replace("1 N", "1000 mN"), GRID.replace("1 N", "2 N")):
        plan.write_text(text)
        digests.append(digest(load_plan(plan)))
    assert digests[0] == digests[1] != digests[2] and len(digests[0]) == 64
    assert digest(load(PAD)) == digest(load(write())) != digest(load(write(("0.6 MPa", "0.7 MPa"))))
    forced = 'max_force = "25 N"'
    digests = [digest(load(write((forced, f'{forced}\ncompliance = "{c} mm/MPa"')))) for c in (0, 1)]
    assert digests[0] == digest(load(PAD)) != digests[1]
    fixed = "[body.fixed]"
    field = [digest(load(write((fixed, f"[body.stiffness_field]\nx = {c}\n{fixed}")))) for c in (0, 0.1, 0.2)]
    assert field[0] == digest(load(PAD)) and len(set(field)) == 3


def test_a_digest_is_of_files_too(write: Write, tmp_path: Path, pad_text: str) -> None:
    start, end = pad_text.index("[body.source]"), pad_text.index("# One material")
    source = '[body.source]\ntype = "surface"\nfile = "body.stl"\nunit = "mm"\nedge_length = "5 mm"\n\n'
    path = write((pad_text[start:end], source))
    digests = []
    for content in (b"one", b"one", b"two"):
        (tmp_path / "body.stl").write_bytes(content)
        digests.append(digest(load(path)))
    assert digests[0] == digests[1] != digests[2]


@pytest.mark.parametrize(
    ("config", "text", "told"),
    [
        (PAD, FORCES, "places: missing: say where it presses"),
        (PAD, "contacts = 1\n", "places: missing, and nothing is driven: say what is varied"),
        (PAD, GRID.replace(FORCES, ""), "give either forces or depths"),
        (PAD, GRID + '[depths]\nvalues = ["1 mm"]\n', "give either forces or depths"),
        (PAD, SURFACE, 'places.type: this is pressed in a workspace: give "grid", "random" or "list"'),
        (PAD, POINTS, "places.at[0]: give x and y in the workspace"),
        (PAD, 'contact = "thumb"\n' + GRID, 'contact: say which one is meant: there is "indenter"'),
        (DOME, LISTED, "places.at[0]: give x, y and z of a point"),
        (
            DOME,
            GRID,
            'places.type: this contact may be anywhere on a surface: give "surface" or "list"',
        ),
        (DOME, PRESSED, 'has no chamber "chamber 1" that is driven, it has none'),
        (
            TRUNK,
            PRESSED.replace("chamber 1", "chamber 7"),
            'has no chamber "chamber 7" that is driven, it could be "chamber 0", "chamber 1", "chamber 2"',
        ),
        (
            TRUNK,
            PRESSED.replace("10 kPa", "25 kPa"),
            'chamber[0].pressure: beyond what "chamber 1" may be driven to, 0 to 20 kPa',
        ),
        (
            PAD,
            GRID.replace("grid", "grit"),
            'places.type: "grit" is none of "grid", "random", "list", "surface", "electrodes"',
        ),
        (
            PAD,
            GRID.replace("count", "aparts = 1\ncount"),
            'places.aparts: unknown key, did you mean "apart"?',
        ),
        (
            PAD,
            GRID.replace('"1 N"', '"1 mm"'),
            'forces.values[0]: "1 mm" is a length, expected a force such as "15 N"',
        ),
        (PAD, GRID.replace('"1 N"', "1"), 'forces.values[0]: 1 has no unit, expected a force such as "15 N"'),
        (PAD, GRID.replace('"1 N"', '"4 N"'), "forces.values: the values must ascend"),
        (PAD, GRID + "count = 3\n", "forces: give either values, a list, or from, to and count"),
        (PAD, GRID.replace('values = ["1 N", "3 N"]', 'from = "1 N"'), "forces: give either values, a list"),
        (
            PAD,
            GRID.replace('values = ["1 N", "3 N"]', 'from = "2 N"\nto = "1 N"\ncount = 2'),
            "forces.to: must be above from",
        ),
        (PAD, "contacts = 5\n" + GRID, "contacts: 5 must be less than or equal to 4"),
        (PAD, "modulus_factors = [1, 0]\n" + GRID, "modulus_factors[1]: 0 must be greater than 0"),
        (
            PAD,
            GRID.replace("count", 'x = ["-31 mm", "0 mm"]\ncount'),
            "places.x: beyond contact.workspace, -30 to 30 mm",
        ),
        (
            PAD,
            LISTED.replace("-20 mm", "-40 mm"),
            "places.at[1]: x is beyond contact.workspace, -30 to 30 mm",
        ),
        (
            PAD,
            LISTED.replace('"-20 mm", "0 mm"', '"10 mm", "-6 mm"'),
            "places.at[1]: this place is given twice",
        ),
        (PAD, "contacts = 3\n" + LISTED, "places: no 3 of them are 20 mm apart"),
        (
            PAD,
            "contacts = 4\n" + RANDOM.replace("count", 'apart = "100 mm"\ncount'),
            "places.apart: 4 places 100 mm apart do not fit: give fewer contacts or a smaller distance",
        ),
        (
            PAD,
            "contacts = 4\n" + GRID.replace("[3, 2]", "[90, 90]"),
            "places: 4 contacts on 8100 places are too many",
        ),
        (PAD, RANDOM.replace("20", "600000"), ": these are 1200000 cases: plan at most 1000000"),
        (PAD, ELECTRODES, 'places.type: this is pressed in a workspace: give "grid", "random" or "list"'),
        (PAD, GRID + PALM + "tension = { values = [] }\n", "cable[0].tension.values: the list is empty"),
        (PAD, GRID + PALM, "cable[0]: give either shortening or tension"),
        (PAD, GRID + PALM + 'tension = { values = ["1 N"] }\n', "cable[0].name: "),
        (FINGER, GRID, 'places.type: this robot is pressed at its electrodes: give "electrodes"'),
        (
            FINGER,
            ELECTRODES.replace("[forces]", 'names = ["toe"]\n[forces]'),
            'places.names[0]: there is no electrode "toe"',
        ),
        (
            FINGER,
            "contacts = 2\n" + ELECTRODES.replace("[forces]", 'names = ["tip left"]\n[forces]'),
            "contacts: 2 at once on 1 electrodes",
        ),
        (
            FINGER,
            ELECTRODES + 2 * (PALM + 'tension = { values = ["1 N"] }\n'),
            'cable[1].name: the cable "palm" is given twice',
        ),
    ],
)
def test_a_mistake_is_a_line_with_file_and_key(series: Callable, config: Path, text: str, told: str) -> None:
    with pytest.raises(ConfigError) as caught:
        series(text, config)
    (line,) = str(caught.value).split("\n")
    assert ".toml: " in line and told in line


def test_every_mistake_is_told(series: Callable) -> None:
    with pytest.raises(ConfigError) as caught:
        series("contacts = 0\n" + GRID.replace("3 N", "3 mN/s") + "count = 2.5\n", PAD)
    assert len(str(caught.value).split("\n")) == 3
