"""What may press, from TOML to an equilibrium: anywhere on a surface, by force or by depth, and estimated."""

from collections.abc import Callable
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.errors import ConfigError, SoftfuseError
from softfuse.estimation.bounds import limits_of
from softfuse.estimation.step import Observation, exact_steps
from softfuse.estimation.tracked import Frame
from softfuse.estimation.tracker import Tracker
from softfuse.experiment.sweep import chunks_of, solve_chunk
from softfuse.functional.chart import facing
from softfuse.functional.pressure_cells import even, strip
from softfuse.functional.skin import Skin
from softfuse.mechanics.indenters import CylinderIndenter, SphereIndenter
from softfuse.mechanics.model import Model, simulate
from softfuse.mesh.files import write_mesh
from softfuse.mesh.kuhn import kuhn_grid
from softfuse.mesh.orientation import oriented
from softfuse.mesh.tetmesh import tet_mesh
from softfuse.robot.file import parse
from softfuse.robot.press_plan import load_plan
from softfuse.robot.robot import Robot, build_robot
from softfuse.robot.trial import Press, Trial, presses_of

HEIGHT, HALF, DOME = 12e-3, 12e-3, 20e-3

CONFIG = """
[robot]
name = "Block"

[body]
element = "linear"

[body.source]
type = "mesh"
file = "{file}"
unit = "m"

[[body.material]]
law = "neo-hookean"
young = "0.1 MPa"
poisson = 0.3

[body.fixed]
z = ["0 mm", "0 mm"]

[[contact]]
name = "thing"
max_force = "2 N"
{contact}

[[point]]
name = "near"
at = ["3 mm", "0 mm", "9 mm"]

[[point]]
name = "far"
at = ["-4 mm", "5 mm", "8 mm"]

[[sensor]]
name = "near marker"
type = "marker"
point = "near"
channels = ["a", "b", "c"]
unit = "mm"
noise = "0.01 mm"
offset_sigma = "0.01 mm"

[[sensor]]
name = "far marker"
type = "marker"
point = "far"
channels = ["d", "e", "f"]
unit = "mm"
noise = "0.01 mm"
offset_sigma = "0.01 mm"
"""

FLAT = 'direction = [0, 0, -1]\nworkspace = { x = ["-6 mm", "6 mm"], y = ["-6 mm", "6 mm"] }'
PUNCH = 'model = "punch"\nradius = "4 mm"\n'
UNIFORM = 'model = "uniform"\nradius = "4 mm"\n'
PATCH = 'model = "patch"\nradius = "4 mm"\n'
FORCE = 'model = "force"\nradius = "4 mm"\n'
SPHERE = 'model = "sphere"\nradius = "8 mm"\nextent = "5 mm"\n'
CYLINDER = 'model = "cylinder"\nradius = "6 mm"\nlength = "8 mm"\naxis = [0, 2]\nextent = "4 mm"\n'
ANYWHERE = "surface = {}"

Build = Callable[..., Robot]


@pytest.fixture(scope="module")
def build(tmp_path_factory: pytest.TempPathFactory) -> Build:
    """build(contact, dome): 24 × 24 × 12 mm in 648 tetrahedra; its top flat, or a sphere's of 20 mm."""
    folder = tmp_path_factory.mktemp("block")
    planes = (np.linspace(-HALF, HALF, 7), np.linspace(-HALF, HALF, 7), np.linspace(0, HEIGHT, 4))
    grid = kuhn_grid(planes, np.ones((6, 6, 3), bool), (0, 0, 0))
    lower = DOME - np.sqrt(DOME**2 - np.sum(grid.nodes[:, :2] ** 2, axis=1))
    bent = grid.nodes - np.outer(grid.nodes[:, 2] / HEIGHT * lower, [0, 0, 1])
    for name, nodes in (("block", grid.nodes), ("dome", bent)):
        write_mesh(folder / f"{name}.vtu", oriented(tet_mesh(nodes, grid.tets)))

    def robot(contact: str, body: str = "block") -> Robot:
        return build_robot(parse(CONFIG.format(file=f"{body}.vtu", contact=contact), folder / "robot.toml"))

    return robot


def _pressed(robot: Robot, press: Press) -> dict:
    trial = Trial.of(robot, [press])
    numbers = trial.numbers(trial.solved())
    (contact,) = numbers["contacts"]
    return contact | {"readings": [each["value"] for each in numbers["readings"].values()]}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "where"),
    [(PUNCH, ANYWHERE), (SPHERE, FLAT), (CYLINDER, ANYWHERE)],
    ids=["punch", "sphere", "cylinder"],
)
def test_the_depth_that_a_force_takes_takes_that_force(build: Build, model: str, where: str) -> None:
    robot = build(model + where)
    by_force = _pressed(robot, Press(None, "2,-1,12", 0.3))
    assert by_force["force_N"] == 0.3 and by_force["depth_mm"] > 0.1 and by_force["tangential_N"] == []
    np.testing.assert_allclose(by_force["place_mm"], [2, -1, 12], atol=1e-9)
    by_depth = _pressed(robot, Press(None, "2,-1,12", depth_m=1e-3 * by_force["depth_mm"]))
    assert by_depth["force_N"] == pytest.approx(0.3, rel=1e-5)
    assert by_depth["depth_mm"] == pytest.approx(by_force["depth_mm"], rel=1e-12)
    np.testing.assert_allclose(by_depth["readings"], by_force["readings"], rtol=1e-4, atol=1e-9)


@eqx.filter_jit
def _ports(robot_model: Model, place: jnp.ndarray):
    (kind,) = robot_model.contacts
    ports = kind.load(robot_model.body, place).ports
    return ports.rest, ports.rows(robot_model.body, jnp.zeros(robot_model.body.n))


@pytest.mark.parametrize("model", [PUNCH, UNIFORM, SPHERE, CYLINDER, PATCH, FORCE])
def test_a_flat_top_is_the_same_as_a_workspace_and_as_a_surface(build: Build, model: str) -> None:
    place = jnp.asarray(facing(np.array([2e-3, -1e-3, HEIGHT]), (0, 0, -1)))
    flat, skin = (_ports(build(model + where).model, place) for where in (FLAT, ANYWHERE))
    for a, b in zip(flat, skin, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-12)


def test_round_things_are_those_of_the_mechanics(build: Build) -> None:
    for model, expected in (
        (SPHERE, lambda skin: SphereIndenter(skin, even(), 8e-3, 5e-3)),
        (CYLINDER, lambda skin: CylinderIndenter(skin, strip(1.0, 6, 10), 6e-3, 4e-3, (0.0, 1.0))),
    ):
        robot = build(model + ANYWHERE)
        (made,) = robot.model.contacts
        assert isinstance(made, SphereIndenter | CylinderIndenter) and isinstance(made.surface, Skin)
        same = jax.tree.map(
            np.allclose, eqx.filter(made, eqx.is_array), eqx.filter(expected(made.surface), eqx.is_array)
        )
        assert all(jax.tree.leaves(same))
    (wide,) = build('model = "sphere"\nradius = "3 mm"\n' + ANYWHERE).model.contacts
    assert isinstance(wide, SphereIndenter) and float(wide.extent) == 3e-3


def test_a_sweep_pushes_a_sphere_in_by_its_depth_at_points_of_a_dome(build: Build, tmp_path: Path) -> None:
    robot, plan = build(SPHERE + ANYWHERE, "dome"), tmp_path / "plan.toml"
    config = robot.settings
    points = '[places]\ntype = "list"\nat = [["0 mm", "0 mm", "12 mm"], ["4 mm", "1 mm", "11 mm"]]\n'
    plan.write_text(points + '[depths]\nvalues = ["0.5 mm", "1 mm"]\n')
    text = CONFIG.format(file="dome.vtu", contact=SPHERE + ANYWHERE)
    (chunk,) = chunks_of(text, config, load_plan(plan))
    names = [column.name for column in chunk.swept.table(config).columns]
    rows = [dict(zip(names, row, strict=True)) for row in solve_chunk(chunk)]
    assert [row["thing_depth_mm"] for row in rows] == [0.5, 1.0, 0.5, 1.0]
    for row in rows:
        assert row["result"] == "converged" and row["force_N"] == row["thing_force_N"] > 0.01
        at = ",".join(str(row[f"thing_{axis}_mm"]) for axis in "xyz")
        pressed = _pressed(robot, Press(None, at, depth_m=1e-3 * row["thing_depth_mm"]))
        np.testing.assert_allclose(row["thing_force_N"], pressed["force_N"], rtol=1e-6)
    soft = CONFIG.format(file="dome.vtu", contact=PATCH + ANYWHERE)
    (chunk,) = chunks_of(soft, parse(soft, config.path), load_plan(plan))
    with pytest.raises(ConfigError, match='contact "thing" is not rigid and has no depth: give forces'):
        solve_chunk(chunk)


def test_a_cylinder_lies_along_its_axis(build: Build) -> None:
    """Seen from above a workspace's u is along x: across x the far marker sees less of one along y."""
    along = {}
    for axis in ("[1, 0]", "[0, 1]"):
        robot = build(CYLINDER.replace("[0, 2]", axis) + FLAT)
        place = robot.parts.contacts["thing"].chart.place(jnp.zeros(2))
        points = robot.model.contacts[0].discs(robot.model.body, place)[0].points
        along[axis] = np.ptp(np.asarray(points), axis=0)[:2]
    np.testing.assert_allclose(along["[1, 0]"], along["[0, 1]"][::-1], rtol=1e-12)
    assert along["[1, 0]"][0] > 7e-3


def test_a_dome_is_pressed_along_its_own_normal(build: Build) -> None:
    robot = build(SPHERE + 'surface = { z = ["6 mm", "20 mm"] }', "dome")
    (workspace,) = robot.workspaces
    assert workspace is not None
    places, _ = workspace.grid(0)
    assert len(places) > 3 and np.all(places[:, 0, 2] > 6e-3)
    found = _pressed(robot, Press(None, "5,0,11.4", 0.2))
    x, y, z = 1e-3 * np.array(found["place_mm"])
    assert found["depth_mm"] > 0.1 and abs(np.hypot(np.hypot(x, y), z - HEIGHT + DOME) - DOME) < 0.2e-3
    # The sphere's middle is in (0, 0, HEIGHT − DOME): so the near marker goes down and aside.
    trial = Trial.of(robot, [Press(None, "5,0,11.4", 0.2)])
    inwards = np.cross(trial.places[0, 2], trial.places[0, 1])
    np.testing.assert_allclose(inwards, -np.array([x, y, z - HEIGHT + DOME]) / DOME, atol=0.1)
    assert found["readings"][2] < 0 and found["readings"][0] < -0.05 * abs(found["readings"][2])


def test_what_has_not_been_found_waits_where_it_may_press(build: Build) -> None:
    """At the origin, outside of this dome, a patch has no rows: every frame was NaN, "inverted element"."""
    robot = build(PATCH + 'surface = { z = ["6 mm", "20 mm"] }', "dome")
    (contact,) = robot.suite.contacts
    places = contact.waiting()
    assert places.shape == (1, 3, 3) and places[0, 0, 2] > 6e-3
    rows = robot.model.loads(places).rows(robot.model.body, jnp.zeros(robot.model.body.n))
    assert jnp.all(jnp.isfinite(rows)) and jnp.any(rows != 0)


def test_a_force_may_have_any_direction(build: Build) -> None:
    robot = build(FORCE + FLAT)
    straight = _pressed(robot, Press(None, "0,0", 0.2))
    aside = _pressed(robot, Press(None, "0,0", 0.2, (0.1, -0.05)))
    assert aside["force_N"] == 0.2 and aside["tangential_N"] == [0.1, -0.05]
    moved = np.subtract(aside["readings"], straight["readings"])
    # Of a flat workspace u is along x and v along y.
    assert moved[0] > 1e-5 and moved[1] < -0.5e-5
    low, high = limits_of(robot).lower, limits_of(robot).upper
    np.testing.assert_array_equal(low, [0, -2, -2])
    np.testing.assert_array_equal(high, [2, 2, 2])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "true"), [(SPHERE, [0.4]), (FORCE, [0.3, -0.12, 0.08])], ids=["sphere", "force"]
)
def test_forces_are_estimated_from_markers(build: Build, model: str, true: list[float]) -> None:
    robot = build(model + ANYWHERE, "dome")
    places = jnp.asarray(Trial.of(robot, [Press(None, "4,1,11.5", 0.1)]).places)

    @eqx.filter_jit
    def found(model, limits, drive):
        reading = model.reading(simulate(model, places, drive).state, places)
        seen = Observation(reading, jnp.diag(jnp.full(len(reading), 1e6)), places)
        return exact_steps(model, limits, model.rest_state(places), seen, steps=12)[0].drive

    np.testing.assert_allclose(found(robot.model, limits_of(robot), jnp.array(true)), true, rtol=1e-4)


def _markers(robot: Robot, force_N: float) -> np.ndarray:
    """Where both points are (6,) [mm] under a press."""
    trial = Trial.of(robot, [Press(None, "2,-1", force_N)])
    return np.concatenate(list(trial.numbers(trial.solved())["points_mm"].values()))


@pytest.mark.slow
def test_a_press_on_a_robot_as_drawn_is_noticed_by_markers_alone(build: Build) -> None:
    """Nobody has said how wrong its model is, and no sensor sees contacts."""
    robot = build(PATCH + FLAT)
    rest, pressed = (_markers(robot, force) for force in (1e-6, 1.0))
    tracker, rng = Tracker(robot), np.random.default_rng(1)
    rows = [
        tracker.update(Frame(0.1 * k, (pressed if 20 <= k < 30 else rest) + rng.normal(0, 0.01, len(rest))))
        for k in range(50)
    ]
    touching = np.array([row.touching[0] for row in rows])
    assert not touching[:20].any() and touching[24:30].all() and not touching[40:].any()
    assert abs(rows[29].force_N - 1.0) < 2.6 * rows[29].force_sigma_N < 1.3


@pytest.mark.parametrize(
    ("contact", "told"),
    [
        (PUNCH + "direction = [0, 0, -1]", "contact[0].workspace: missing, needed with direction"),
        (
            PUNCH + 'workspace = { x = ["0 mm", "1 mm"], y = ["0 mm", "1 mm"] }',
            "contact[0].direction: missing",
        ),
        (
            SPHERE + FLAT + "\nsurface = {}",
            "contact[0].surface: give either a direction",
        ),
        (CYLINDER.replace("[0, 2]", "[0, 0]") + ANYWHERE, "contact[0].axis: the axis has no length"),
        (CYLINDER.replace('length = "8 mm"', "") + ANYWHERE, "contact[0].length: missing"),
        (PATCH + 'extent = "1 mm"\nsurface = {}', "contact[0].extent: unknown key"),
        (
            SPHERE.replace('"sphere"', '"ball"') + ANYWHERE,
            'contact[0].model: "ball" is none of "punch", "uniform"',
        ),
    ],
)
def test_what_does_not_go_together_is_told(build: Build, contact: str, told: str) -> None:
    with pytest.raises(ConfigError) as caught:
        build(contact)
    assert told in str(caught.value)


def test_a_contact_that_nothing_could_find_is_told(build: Build) -> None:
    with pytest.raises(ConfigError, match='contact "thing": no sensor sees it, and it has no surface'):
        Tracker(build(PUNCH))


def test_presses_that_do_not_go_together_are_told(build: Build) -> None:
    patch, punch, anywhere = build(PATCH + ANYWHERE), build(PUNCH + FLAT), build(PUNCH + ANYWHERE)
    for robot, press, told in (
        (patch, Press(None, "0,0,12", depth_m=1e-3), '"thing" is not rigid and has no depth: give a force'),
        (punch, Press(None, "0,0,12", 0.1, (0.1, 0.0)), 'only one of model = "force" is pushed aside'),
        (punch, Press(None, "11,0", 0.1), "overhangs the surface"),
        # Its normal there is the top's, not a mean of both sides of the edge.
        (anywhere, Press(None, "11,0,12", 0.1), "overhangs the surface"),
    ):
        with pytest.raises(SoftfuseError, match=told):
            Trial.of(robot, [press])
    at = ["0,0,12"]
    for given, told in (
        (([], at, [1.0], [1.0]), "1 times --at and 1 times --depth: give one of both for each press"),
        (([], at, [1.0], [], ["1"]), '--tangential "1": expected two forces in N, U,V'),
        (([], at, [1.0], [], ["1,2", "3,4"]), "2 times --tangential for 1 times --at"),
    ):
        with pytest.raises(SoftfuseError, match=told):
            presses_of(*given)
    assert presses_of([], at, [], [1.5]) == (Press(None, "0,0,12", depth_m=1.5e-3),)
    assert presses_of(["thing"], at, [0.2], [], ["1,-2"]) == (Press("thing", "0,0,12", 0.2, (1.0, -2.0)),)
