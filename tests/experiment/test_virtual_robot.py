"""Virtual robots: made with errors within their bounds, in equilibrium, and seen by their sensors as they
are.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from made_robots import BEAM, BLOCK, quick_robot, settings_of

from softfuse.errors import ConfigError, SolveError
from softfuse.experiment.episodes import Episode, Touch, episodes_of, place_of
from softfuse.experiment.equilibria import RobotSolver, kept_poses
from softfuse.experiment.virtual_robot import MakingErrors, VirtualRobot, virtual_robot
from softfuse.mechanics.model import simulate
from softfuse.robot.mesh import build_mesh
from softfuse.robot.robot import build_robot

NONE = MakingErrors(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, skin=0.0, nodes=0)
FORCES = (2.0, 6.0)


@pytest.fixture(scope="module")
def block() -> VirtualRobot:
    return quick_robot(settings_of(BLOCK), NONE)


@pytest.fixture(scope="module")
def beam() -> VirtualRobot:
    return quick_robot(settings_of(BEAM), NONE)


def at(robot: VirtualRobot, x: float, y: float, forces: tuple[float, ...] = FORCES) -> Touch:
    chart = robot.made.parts.contacts["stage"].chart
    assert chart is not None
    return Touch("stage", place_of(np.asarray(chart.place(jnp.array([x, y])))), forces)


def test_a_press_that_it_cannot_bear_is_told(block: VirtualRobot) -> None:
    with pytest.raises(
        SolveError, match='"stage" at .* mm.* no equilibrium: inverted element: .*; press less hard'
    ):
        RobotSolver(block).poses(Episode((at(block, 0.01, 0.0, (1e5,)),)))


def test_a_robot_is_off_its_drawing_within_bounds() -> None:
    drawn, bounds = settings_of(BEAM), MakingErrors(nodes=0, seed=5)
    made = virtual_robot(drawn, bounds).made
    (chamber,), (cable,), (point,) = made.settings.chambers, made.settings.cables, made.settings.points
    guides = np.array(cable.guides) - np.array(drawn.cables[0].guides)
    for error, bound in (
        (chamber.shift, 0.3e-3),
        (chamber.growth, 0.2e-3),
        (guides, 0.3e-3),
        (np.array(point.at) - np.array(drawn.points[0].at), 0.3e-3),
    ):
        assert 1e-6 < np.abs(error).max() <= bound + 1e-12
    walls = np.asarray(made.parts.body.rest)[np.unique(made.parts.chambers["bladder"].cavity.faces)]
    low, high = walls.min(axis=0), walls.max(axis=0)
    np.testing.assert_allclose(0.5 * (low + high), np.array([0, 0, 11e-3]) + chamber.shift, atol=1e-9)
    np.testing.assert_allclose(high - low, np.array([40e-3, 8e-3, 6e-3]) + chamber.growth, atol=1e-9)
    (material,), shear = made.settings.body.materials, 0.5 * 0.6e6 / 1.45
    assert material.law == "yeoh" and 1e-3 < abs(material.shear_modulus / shear - 1) <= 0.1
    assert material.lame / material.shear_modulus == pytest.approx(2 * 0.45 / 0.1)
    other = virtual_robot(drawn, MakingErrors(nodes=0, seed=6)).made.settings
    assert other.chambers[0].shift != chamber.shift


def test_its_mesh_has_so_many_times_the_nodes() -> None:
    drawn = settings_of(BLOCK)
    made = virtual_robot(drawn, MakingErrors(nodes=2.0)).made
    assert len(made.mesh.mesh.nodes) >= 2 * len(build_mesh(drawn).mesh.nodes)


def test_a_point_that_an_error_would_move_out_of_the_body_stays_in_it() -> None:
    drawn = settings_of(BLOCK, ('["0 mm", "0 mm", "17 mm"]', '["0 mm", "0 mm", "17.99 mm"]'))
    heights = [
        virtual_robot(drawn, MakingErrors(nodes=0, seed=k)).made.settings.points[0].at[2] for k in range(4)
    ]
    assert max(heights) <= 18e-3 and min(heights) < 17.9e-3


@pytest.mark.slow
def test_equilibria_are_those_of_the_model(block: VirtualRobot) -> None:
    touch = at(block, 15e-3, 4e-3)
    poses = RobotSolver(block).poses(Episode((touch,)))
    places = jnp.array([touch.place])
    model = block.made.model
    state = simulate(model, places, jnp.array([6.0]), model.rest_state(places)).state
    np.testing.assert_allclose(poses["reading"][-1], model.reading(state, places), rtol=1e-6, atol=1e-15)
    np.testing.assert_allclose(poses["volume"], poses["reading"], rtol=1e-9, atol=1e-18)
    assert -poses["gap"][-1, 0] == pytest.approx(float(model.depth(places, state)), rel=1e-6)
    assert poses["force"][:, 0].tolist() == [0.0] * 11 + [2.0, 6.0] and poses["held"][-2:].tolist() == [1, 1]
    np.testing.assert_allclose(poses["signal stage"][-1], [15e-3, 4e-3, 6.0])
    assert poses["point"][-1, 0, 2] < 17e-3 and (np.diff(poses["gap"][:, 0]) < 0).all()


def test_mirrored_presses_give_mirrored_readings(block: VirtualRobot) -> None:
    solver = RobotSolver(block)
    right, left = (solver.poses(Episode((at(block, x, 0.0),)))["reading"] for x in (15e-3, -15e-3))
    np.testing.assert_allclose(left, right[:, ::-1], rtol=1e-6, atol=1e-15)
    assert right[-1, 1] < -30e-9 and abs(right[-1, 0]) < -0.1 * right[-1, 1]


@pytest.mark.slow
def test_actuators_are_driven_and_hold_while_something_presses(beam: VirtualRobot) -> None:
    place = beam.made.workspaces[0].places[0]
    episode = Episode((Touch("hand", place_of(place), (0.3,)),), (("palm", 2e-3), ("bladder", 5e3)))
    count: list[int] = []
    solver = RobotSolver(beam)
    poses = solver.poses(episode, solved=lambda: count.append(1))
    assert len(count) == solver.count(episode) == 5
    addresses = beam.made.addresses
    shortening, tension = (
        poses["reading"][:, addresses.readings[name]][:, 0] for name in ("encoder", "load cell")
    )
    np.testing.assert_allclose(shortening[:5], 2e-3 * np.linspace(0, 1, 5), atol=1e-9)
    np.testing.assert_allclose(shortening[4:], 2e-3, atol=1e-9)
    assert (tension[1:] > 0.1).all() and abs(tension[-1] - tension[4]) > 1e-3
    np.testing.assert_allclose(poses["drive"][4:, addresses.drives["bladder"]], 5e3)
    np.testing.assert_allclose(poses["drive"][:, addresses.drives["palm"]], tension)
    assert poses["volume"][4, 0] > 0
    moved = poses["reading"][:, addresses.readings["camera"]]
    np.testing.assert_allclose(moved, poses["point"][:, 0] - beam.made.settings.points[0].at, atol=1e-12)
    # The cable runs below the middle: it bends the beam down; the hand, from above, further.
    assert moved[4, 2] < -1e-3 and moved[-1, 2] < moved[4, 2]


def test_a_cable_that_is_commanded_to_a_tension_is_pulled_with_it() -> None:
    robot = quick_robot(settings_of(BEAM, ('"winch_mm", unit = "mm"', '"winch_N", unit = "N"')), NONE)
    poses = RobotSolver(robot).poses(Episode((), (("palm", 3.0),)))
    drive, answer = (poses[name][:, robot.made.addresses.drives["palm"]] for name in ("drive", "answer"))
    np.testing.assert_allclose(drive, 3.0 * np.linspace(0, 1, 5))
    assert (np.diff(answer) > 1e-4).all() and poses["held"].tolist() == [0, 0, 0, 0, 1]
    assert dict(RobotSolver(robot).reach()) == {"palm": 10.0, "bladder": 20e3}


def test_a_cable_that_is_shortened_reaches_as_far_as_its_largest_tension_pulls_it(beam: VirtualRobot) -> None:
    solver = RobotSolver(beam)
    reach = dict(solver.reach())["palm"]
    poses = solver.poses(Episode((), (("palm", reach),)))
    assert poses["drive"][-1, beam.made.addresses.drives["palm"]] == pytest.approx(10.0, rel=1e-6)


def test_a_cable_that_a_body_does_not_bear_reaches_as_far_as_it_does() -> None:
    robot = quick_robot(settings_of(BEAM, ('max_tension = "10 N"', 'max_tension = "1 kN"')), NONE)
    solver = RobotSolver(robot)
    reach = dict(solver.reach())["palm"]
    poses = solver.poses(Episode((), (("palm", 0.5 * reach),)))
    assert 1.0 < poses["drive"][-1, robot.made.addresses.drives["palm"]] < 1e3


def test_episodes_at_random_are_where_something_may_press_and_within_reach(beam: VirtualRobot) -> None:
    reach = (("palm", 5e-3), ("bladder", 20e3))
    episodes = episodes_of(beam.made, 8, reach=reach, seed=3)
    assert episodes == episodes_of(beam.made, 8, reach=reach, seed=3)
    assert episodes != episodes_of(beam.made, 8, reach=reach, seed=4)
    assert [bool(each.driven) for each in episodes] == [False, True] * 4
    most = dict(reach)
    for each in episodes:
        (touch,) = each.touches
        assert 0.0 <= touch.place[0][0] <= 0.03 and touch.place[0][2] == pytest.approx(18e-3)
        assert 0.35 <= touch.forces[-1] <= 0.75 and touch.forces[0] == pytest.approx(touch.forces[-1] / 3)
        assert all(0 <= value <= 0.5 * most[name] for name, value in each.driven)


def test_poses_are_kept(block: VirtualRobot, tmp_path) -> None:
    episodes = [Episode((at(block, 10e-3, 0.0),))]
    count: list[int] = []
    for _ in range(2):
        (poses,) = kept_poses(tmp_path, block, episodes, solved=lambda: count.append(1))
    assert len(count) == 2 and poses["reading"].shape == (13, 2)


def test_what_cannot_be_done_is_told(block: VirtualRobot, beam: VirtualRobot) -> None:
    solver = RobotSolver(block)
    with pytest.raises(ConfigError, match="overhangs"):
        solver.poses(Episode((at(block, 30e-3, 0.0),)))
    with pytest.raises(ConfigError, match="not so many contacts"):
        solver.poses(Episode((at(block, 10e-3, 0.0), at(block, -10e-3, 0.0))))
    with pytest.raises(ConfigError, match='no cable or driven chamber "left"'):
        solver.poses(Episode((at(block, 10e-3, 0.0),), (("left", 1e3),)))
    for forces in ((), (0.0,), (2.0, 1.0)):
        with pytest.raises(ConfigError, match="increase"):
            at(block, 0.0, 0.0, forces)
    with pytest.raises(ConfigError, match="as many"):
        Episode((at(block, 0.0, 0.0, (1.0,)), at(block, 0.0, 0.0)))
    with pytest.raises(ConfigError, match="silicone"):
        virtual_robot(beam.drawn, MakingErrors(nodes=0, silicone="porridge"))
    bare = build_robot(settings_of(BLOCK[: BLOCK.index("[[contact]]")]))
    with pytest.raises(ConfigError, match="nothing may press"):
        episodes_of(bare, 1, reach=(), seed=0)
