"""Design tasks: what they say, which problem they give, how mistakes are told, and the config they end in."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.config import load
from softfuse.config.build_cable_route import CableRoute
from softfuse.config.build_design import (
    build_layout,
    build_limits,
    build_measure,
    build_places,
    build_problem,
    finer_config,
    limits_of,
    save_designed,
)
from softfuse.config.design_plan import load_design
from softfuse.design.layout_mesh import layout_mesh
from softfuse.design.objective import Answers, PairError, Unevenness
from softfuse.design.thickness import wall_names, wall_thicknesses
from softfuse.errors import ConfigError

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
    assert len(problem.noise) == len(config.cavities) + len(config.cables)


def test_the_pad_is_pressed_on_half_of_the_papers_places() -> None:
    plan = load_design(PAD)
    problem = build_problem(plan, load(plan.device))
    assert isinstance(problem.objective, Unevenness)
    whole = np.linspace(-0.028, 0.028, 10)
    np.testing.assert_allclose(np.unique(problem.places[:, 0]), whole, atol=1e-7)
    np.testing.assert_allclose(np.unique(problem.places[:, 1]), whole[5:], atol=1e-7)


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
    names = [electrode.name for electrode in config.electrodes]
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
        (FINGER, 'cable = "palm"', 'cable = "palm", cavity = "base left"', "give the name of one"),
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
    assert [cavity.name for cavity in designed.cavities] == [cavity.name for cavity in plan.cavities]
    assert designed.body.materials == config.body.materials
    made, again = mesh.mesh(theta), designed.body.source.mesh([each.centre for each in designed.cavities])
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
    )
    kept, strain, *_ = build_limits(plan, load(plan.device), own, limits_of(plan))
    assert kept.at_least == pytest.approx(0.4 * 2e-9) and kept.at_most == np.inf
    assert strain.at_least == -np.inf and strain.at_most == 0.7
    assert strain.measure(own) == pytest.approx(0.4)


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
        device.attached[0].ports for device in (problem.follow(as_drawn, theta), problem.build(mesh, theta))
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
