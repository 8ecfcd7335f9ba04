"""Design tasks: what they say, which problem they give, how mistakes are told, and the config they end in."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.design.cable_route import CableRoute
from softfuse.design.chamber_count import channel_edits, with_chambers
from softfuse.design.objective import Answers, PairError, Unevenness
from softfuse.design.of_robot import (
    build_layout,
    build_limits,
    build_measure,
    build_places,
    build_problem,
    finer_config,
    limits_of,
    save_designed,
    searched_config,
)
from softfuse.design.plan import load_design
from softfuse.errors import ConfigError
from softfuse.robot.file import load
from softfuse.robot.layout.layout_mesh import layout_mesh
from softfuse.robot.layout.thickness import wall_names, wall_thicknesses
from softfuse.robot.mesh import build_mesh
from softfuse.sensors.flow.sensor import FlowSettings
from softfuse.sensors.pressure.sensor import PressureSettings

CONFIGS = Path(__file__).parents[2] / "configs"
PAD, FINGER = CONFIGS / "design_pad.toml", CONFIGS / "design_finger.toml"


@pytest.fixture
def changed(tmp_path: Path) -> Callable[..., Path]:
    """changed(plan, (old, new), ...): a copy of a plan with some text replaced."""

    def write(plan: Path, *changes: tuple[str, str]) -> Path:
        text = plan.read_text(encoding="utf-8").replace('device = "', f'device = "{CONFIGS}/')
        for old, new in changes:
            assert old in text
            text = text.replace(old, new, 1)
        path = tmp_path / "plan.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.mark.parametrize("path", [PAD, FINGER])
def test_the_examples_can_be_made_as_drawn(path) -> None:
    plan = load_design(path)
    config = load(plan.device)
    problem = build_problem(plan, config)
    layout = problem.layout
    np.testing.assert_array_equal(layout.start, 0.0)
    thickness = np.asarray(wall_thicknesses(layout, jnp.asarray(layout.start)))
    assert (thickness >= problem.walls.least(layout) - 1e-9).all()
    assert len(problem.noise) == len(config.chambers) + len(config.cables)


def test_the_pad_is_pressed_on_half_of_the_papers_places() -> None:
    plan = load_design(PAD)
    problem = build_problem(plan, load(plan.device))
    assert isinstance(problem.objective, Unevenness)
    whole = np.linspace(-0.028, 0.028, 10)
    np.testing.assert_allclose(np.unique(problem.places[:, 0, 0]), whole, atol=1e-7)
    np.testing.assert_allclose(np.unique(problem.places[:, 0, 1]), whole[5:], atol=1e-7)


def test_turned_by_half_a_turn_the_pad_stays_the_same() -> None:
    plan = load_design(PAD)
    layout = build_layout(plan, load(plan.device))
    theta = 0.3 * layout.upper
    values = layout.values(jnp.asarray(theta))
    for a, b in ((0, 3), (1, 2)):
        np.testing.assert_allclose(values[a][:2], -values[b][:2], atol=1e-15)
        np.testing.assert_allclose(values[a][2:], values[b][2:], atol=1e-15)


def test_pairs_are_numbers_of_presses() -> None:
    plan = load_design(FINGER)
    config = load(plan.device)
    objective = build_problem(plan, config).objective
    assert isinstance(objective, PairError)
    names = list(config.places)
    assert [[names[k] for k in pair] for pair in objective.pairs] == [
        list(pair) for pair in plan.objective.pairs
    ]


@pytest.mark.parametrize(
    ("plan", "old", "new", "message"),
    [
        (PAD, 'cavity = "outer left", value = "x"', 'cavity = "left", value = "x"', r'no cavity "left"'),
        (PAD, 'value = "x"', 'value = "width"', r'has no "width": it has x, y, z'),
        (PAD, 'scale = "1 mm"', 'scale = "1 deg"', r"parameter\[0\]"),
        (PAD, 'lower = "-7 mm"', 'lower = "1 mm"', "must lie between lower and upper"),
        (PAD, 'measure = "unevenness"', 'measure = "evenness"', "objective"),
        (PAD, "at_least = 0.4", "", "give at_least or at_most, parts of the device's own, or most"),
        (PAD, "at_least = 0.4", "most = 0.4", 'limit "sensitivity" by at_most'),
        (FINGER, 'cable = "palm"', 'cable = "back"', 'no cable "back": it has palm'),
        (FINGER, 'cable = "palm"', 'cable = "palm", guides = [12]', "12 is none of 0 to 9"),
        (
            FINGER,
            'cable = "palm", value = "z"',
            'cable = "palm", value = "half z"',
            'have x, y, z, no "half z"',
        ),
        (FINGER, 'cable = "palm"', 'cable = "palm", cavity = "base left"', "adds to one thing"),
        (FINGER, 'cable = "palm", value = "z"', 'electrodes = "rows", value = "pitch"', "has no rows and"),
        (PAD, 'cavity = "outer left", value = "x"', 'electrodes = "rows", value = "x"', 'pitch, no "x"'),
        (
            PAD,
            'cavity = "outer left", value = "x"',
            'electrodes = "rows", value = "pitch"',
            "could leave the",
        ),
        (
            PAD,
            'lower = "-7 mm"\nupper = "20 mm"\nscale = "1 mm"\nadds = [{ cavity = "outer left", value = "x"',
            'lower = "-9 mm"\nupper = "1 mm"\nadds = [{ electrodes = "columns", value = "pitch"',
            "could cross",
        ),
        (
            FINGER,
            'measure = "softness"',
            'measure = "force-error", force = "1 N", place_sigma = "electrodes"',
            "has no rows and columns",
        ),
        (
            PAD,
            'measure = "unevenness"',
            'measure = "force-error"\nforce = "1 N"\nplace_sigma = "none"',
            'such as "64 mm"',
        ),
        (PAD, 'half = ["5 mm"', 'halves = ["5 mm"', r"cavity\[0\]"),
        (FINGER, '"lower palm", "lower left"', '"lower palm", "thumb"', 'no press on an electrode "thumb"'),
        (FINGER, 'measure = "softness"', 'measure = "place-error", force = "1 N"', "pressed as a whole"),
    ],
)
def test_mistakes_are_told(changed, plan, old, new, message) -> None:
    path = changed(plan, (old, new))
    with pytest.raises(ConfigError, match=message):
        planned = load_design(path)
        config = load(planned.device)
        problem = build_problem(planned, config)
        names = build_places(planned, config)[1]
        for limit in planned.limits:
            build_measure(planned, limit.of, names)
        problem.walls.least(problem.layout)


def test_walls_by_name_are_those_of_a_cavity(changed) -> None:
    path = changed(PAD, ("[walls]\n", '[walls]\nspecial = { "inner left, high z" = "5 mm" }\n'))
    plan = load_design(path)
    problem = build_problem(plan, load(plan.device))
    least = dict(zip(wall_names(problem.layout), problem.walls.least(problem.layout), strict=True))
    assert least["cavity 1, high z"] == 0.005
    assert sum(value == 0.005 for value in least.values()) == 1


def test_a_finer_config_has_shorter_edges() -> None:
    for name in ("pad.toml", "finger.toml"):
        config = load(CONFIGS / name)
        assert finer_config(config, 2.0).body.source.base_size == 0.5 * config.body.source.base_size


def test_a_search_may_have_a_mesh_of_its_own() -> None:
    plan = load_design(PAD)
    config = load(plan.device)
    other = plan.model_copy(update={"search": plan.search.model_copy(update={"edges": {"base_size": 0.01}})})
    source = searched_config(other, config).body.source
    assert (source.base_size, source.surface_size) == (0.01, config.body.source.surface_size)
    wrong = plan.model_copy(update={"search": plan.search.model_copy(update={"edges": {"wall_size": 0.01}})})
    with pytest.raises(ConfigError, match="no wall_size: it has surface_size, base_size"):
        searched_config(wrong, config)


@pytest.mark.parametrize("path", [PAD, FINGER])
def test_the_config_of_what_is_found_is_that_device(path, tmp_path) -> None:
    plan = load_design(path)
    config = load(plan.device)
    problem = build_problem(plan, config)
    layout = problem.layout
    theta = 0.2 * layout.scale * np.cos(np.arange(len(layout.names)))
    mesh = layout_mesh(layout, theta, problem.fineness)
    target = tmp_path / "designed.toml"
    saved = save_designed(plan, config, mesh, theta, target)
    designed = load(target)
    assert designed == saved
    assert [chamber.name for chamber in designed.chambers] == [cavity.name for cavity in plan.cavities]
    assert designed.body.materials == config.body.materials
    made, again = mesh.mesh(theta), build_mesh(designed).mesh
    assert len(made.nodes) == len(again.nodes)
    np.testing.assert_allclose(again.nodes, made.nodes, atol=1e-9)


def test_limits_are_parts_of_the_devices_own_or_stand_by_themselves(changed) -> None:
    path = changed(
        PAD,
        (
            "at_least = 0.4",
            'at_least = 0.4\n\n[[limit]]\nof = { measure = "strain", force = "8 N" }\nmost = 0.7',
        ),
    )
    plan = load_design(path)
    suffered = jnp.array([0.1]), jnp.array([0.05])
    own = Answers(
        jnp.full((1, 4), 1e-9),
        jnp.zeros((1, 4, 2)),
        jnp.ones(1),
        jnp.zeros((1, 0, 3)),
        *suffered,
        jnp.ones(4),
        jnp.zeros((1, 2, 2)),
    )
    kept, strain, *_ = build_limits(plan, load(plan.device), own, limits_of(plan))
    assert kept.at_least == pytest.approx(0.4 * 2e-9) and kept.at_most == np.inf
    assert strain.at_least == -np.inf and strain.at_most == 0.7
    assert strain.measure(own) == pytest.approx(0.4)


@pytest.mark.slow
def test_guides_follow_parameters_into_device_and_config(tmp_path) -> None:
    plan = load_design(FINGER)
    config = load(plan.device)
    route = CableRoute.of(plan, config)
    which = [parameter.name for parameter in plan.parameters].index("cable height")
    theta = np.zeros(len(plan.parameters))
    theta[which] = -0.4e-3
    (guides,) = route.guides(theta)
    drawn = np.array(config.cables[0].guides)
    np.testing.assert_allclose(guides, drawn - [0.0, 0.0, 0.4e-3])
    problem = build_problem(plan, config)
    mesh = layout_mesh(problem.layout, theta, problem.fineness)
    as_drawn = problem.build(mesh, 0.0 * theta)
    moved, built = (
        device.actuators[0].ports for device in (problem.follow(as_drawn, theta), problem.build(mesh, theta))
    )
    np.testing.assert_allclose(moved.points.location, built.points.location, atol=1e-15)
    saved = save_designed(plan, config, mesh, theta, tmp_path / "designed.toml")
    np.testing.assert_allclose(saved.cables[0].guides, guides, atol=1e-15)


@pytest.mark.slow
def test_readings_have_the_derivatives_of_devices_with_other_guides(changed, coarse_finger) -> None:
    path = changed(FINGER, (f'device = "{CONFIGS}/finger.toml"', f'device = "{coarse_finger()}"'))
    plan = load_design(path)
    problem = build_problem(plan, load(plan.device))
    which = problem.layout.names.index("cable height")
    meshed = problem.on_mesh(problem.layout.start)
    slope = meshed.value(problem.layout.start).slopes[0, which]

    def built(step: float) -> float:
        theta = problem.layout.start
        theta[which] = step
        # Built anew with these guides, on the same mesh.
        return replace(meshed, device=problem.build(meshed.mesh, theta)).measures(theta)[0]

    step = 2e-5
    assert slope == pytest.approx((built(step) - built(-step)) / (2 * step), rel=1e-4)


PITCH = """
[[parameter]]
name = "pitch"
lower = "-4 mm"
upper = "2 mm"
adds = [{ electrodes = "rows", value = "pitch" }, { electrodes = "columns", value = "pitch" }]
"""


@pytest.mark.slow
@pytest.mark.parametrize("device", ["pad.toml", "pad_mutual.toml"])
def test_lines_of_electrodes_follow_their_pitch(changed, tmp_path, device) -> None:
    path = changed(
        PAD,
        (str(CONFIGS / "pad.toml"), str(CONFIGS / device)),
        ('measure = "unevenness"', 'measure = "force-error"\nforce = "5 N"\nplace_sigma = "electrodes"'),
        ("# What may change", PITCH + "\n# What may change"),
    )
    plan = load_design(path)
    config = load(plan.device)
    problem = build_problem(plan, config)
    theta = np.zeros(len(plan.parameters))
    theta[[parameter.name for parameter in plan.parameters].index("pitch")] = -1e-3
    told = {}
    mesh = layout_mesh(problem.layout, theta, problem.fineness)
    for name, at in (("drawn", 0.0 * theta), ("nearer", theta)):
        designed = save_designed(plan, config, mesh, at, tmp_path / f"{name}.toml")
        (lines,), (drawn,) = (
            [sensor for sensor in each.sensors if hasattr(sensor, "row_y")] for each in (designed, config)
        )
        for own, before in ((lines.row_y, drawn.row_y), (lines.column_x, drawn.column_x)):
            np.testing.assert_allclose(np.diff(own), np.diff(before) + at.sum(), atol=1e-12)
            assert np.mean(own) == pytest.approx(0.0, abs=1e-12)
        told[name] = problem.touched(jnp.asarray(at))
    assert told["drawn"].shape == (len(problem.places), 2, 2)
    # Beyond the outermost lines less is told, and these are nearer to the middle now.
    corner = int(np.argmax(problem.places[:, 0, 0] + problem.places[:, 0, 1]))
    error = {name: np.trace(np.linalg.inv(each[corner])) for name, each in told.items()}
    assert error["nearer"] > 1.2 * error["drawn"]


@pytest.mark.slow
def test_a_plan_may_draw_another_number_of_cavities(changed, tmp_path) -> None:
    text = PAD.read_text(encoding="utf-8")
    cavity = text[text.index('[[cavity]]\nname = "outer right"') : text.index("# What may change")]
    fifth = (
        cavity.replace("outer right", "middle").replace('["27 mm"', '["0 mm"').replace('["5 mm"', '["1.5 mm"')
    )
    config = load(CONFIGS / "pad.toml")
    more = load_design(changed(PAD, (cavity, cavity + fifth)))
    problem = build_problem(more, config)
    start = problem.layout.start
    mesh = layout_mesh(problem.layout, start, problem.fineness)
    saved = save_designed(more, config, mesh, start, tmp_path / "more.toml")
    (own,), (flow,) = (each.sensors_of(FlowSettings) for each in (config, saved))
    assert flow.channels == (*own.channels, "middle V")
    assert flow.chambers == tuple(cavity.name for cavity in more.cavities)
    assert len(saved.chambers) == len(saved.body.source.shapes) == 5
    assert len(problem.noise) == 5


@pytest.mark.slow
def test_what_a_calibration_said_of_other_cavities_is_left_out(changed, tmp_path) -> None:
    text = (CONFIGS / "pad.toml").read_text(encoding="utf-8")
    assert "[estimator]\n" in text
    calibrated, spread = tmp_path / "calibrated.toml", tmp_path / "spread.npz"
    spread.touch()
    calibrated.write_text(
        text.replace("[estimator]\n", f'[estimator]\nreading_spread = "{spread}"\n'), encoding="utf-8"
    )
    plan = load_design(changed(PAD, (str(CONFIGS / "pad.toml"), str(calibrated))))
    config = load(calibrated)
    problem = build_problem(plan, config)
    mesh = layout_mesh(problem.layout, problem.layout.start, problem.fineness)
    saved = save_designed(plan, config, mesh, problem.layout.start, tmp_path / "designed.toml")
    assert config.estimator.reading_spread == spread and saved.estimator.reading_spread is None


def test_what_each_cavity_has_of_its_own_is_not_guessed(changed) -> None:
    plan = load_design(FINGER)
    config = load(plan.device)
    fewer = plan.model_copy(update={"cavities": plan.cavities[:4]})
    chambers = list(config.chambers)
    chambers[0] = chambers[0].model_copy(update={"dead_volume": 2e-7})
    differing = config.model_copy(update={"chambers": tuple(chambers)})
    with pytest.raises(ConfigError, match="6 chambers that differ in dead_volume"):
        with_chambers(fewer, differing)
    (pressure,) = config.sensors_of(PressureSettings)
    for update, told in (({"gain": (0.9,) * 6}, "6 values of gain"), ({"chambers": ("base left",)}, "some")):
        sensors = (pressure.model_copy(update=update), *config.sensors[1:])
        with pytest.raises(ConfigError, match=told):
            channel_edits(fewer, config.model_copy(update={"sensors": sensors}))
    assert channel_edits(fewer, config) == {
        ("sensor", 0, "chambers"): [cavity.name for cavity in fewer.cavities],
        ("sensor", 0, "channels"): list(pressure.channels[:4]),
    }
    assert [chamber.dead_volume for chamber in with_chambers(plan, differing).chambers][:2] == [2e-7, 1e-7]
