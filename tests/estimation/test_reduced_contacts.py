"""What presses on a body in any way, on charts as on the full one."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from made_robots import BLOCK

from softfuse.body import Body
from softfuse.mechanics.model import simulate
from softfuse.mechanics.solution import RESULTS
from softfuse.robot.file import load
from softfuse.robot.reduced import Teacher, build_regions, reduction_mark
from softfuse.robot.robot import build_robot
from softfuse.rom.basis import rest_stiffness
from softfuse.rom.reduced_model import reduced_model
from softfuse.rom.rom_file import Atlas, AtlasFolder

PUNCH = 'model = "punch"'
FINE = '[reduction]\ncell = "10 mm"\nside = 2\nnear = 8\n'
CABLE = """
[[cable]]
name = "edge"
guides = [["-20 mm", "15 mm", "3 mm"], ["20 mm", "15 mm", "3 mm"]]
pulled_at = ["-45 mm", "15 mm", "3 mm"]
anchor_radius = "2 mm"
max_tension = "5 N"
command = { channel = "winch_mm", unit = "mm" }
"""
ALONG_Y = (
    ("direction = [0, 0, -1]", "direction = [0, 1, 0]"),
    ('x = ["-25 mm", "25 mm"], y = ["-11 mm", "11 mm"]', 'x = ["-20 mm", "20 mm"], y = ["9 mm", "10 mm"]'),
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "more", "drive", "within"),
    [
        ([(PUNCH, 'model = "sphere"')], "", [6.0], 2e-3),
        ([(PUNCH, 'model = "cylinder"\nlength = "14 mm"')], "", [6.0], 2e-3),
        ([(PUNCH, 'model = "force"')], "", [6.0, 1.5, -2.0], 5e-3),
        ([], CABLE, [6.0, 3.0], 5e-3),
        ([*ALONG_Y], "", [6.0], 2e-3),
    ],
    ids=["sphere", "cylinder", "force", "cable", "from the side"],
)
def test_a_chart_has_the_full_body_s_equilibria(changes, more, drive, within, tmp_path: Path) -> None:
    """To a part of the largest displacement; also when it is read back, in single precision."""
    text = BLOCK
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    (tmp_path / "block.toml").write_text(text + more + FINE)
    settings = load(tmp_path / "block.toml")
    robot, regions = build_robot(settings), build_regions(settings)
    model = robot.model
    assert isinstance(model.body, Body)
    teacher = Teacher(robot, rest_stiffness(model.body), regions)
    number = len(regions) // 2
    chart = teacher.chart(number)
    small = reduced_model(model, teacher.stiffness, chart, [])
    folder = AtlasFolder(tmp_path / "charts", reduction_mark(settings))
    for each in range(len(regions)):
        folder.write(each, small, chart.basis)
    kept = Atlas(model, regions, folder).chart(number)
    place = jnp.asarray(regions.parts(number, 1)[0](np.array([0.3, -0.2])))[None]
    under = model.rest_state(place).drive.at[: len(drive)].set(jnp.array(drive))
    exact, found, read = (simulate(each, place, under) for each in (model, small, kept.model))
    assert exact.result == found.result == RESULTS.converged
    shape = np.asarray(model.body.displacement(exact.state.z))
    nearly = kept.displacement(np.asarray(found.state.z)[: kept.nodal.shape[1]])
    assert np.abs(nearly - shape).max() < within * np.abs(shape).max()
    np.testing.assert_allclose(read.state.z, found.state.z, atol=1e-5 * np.abs(found.state.z).max())
    wanted = np.asarray(model.reading(exact.state))
    np.testing.assert_allclose(small.reading(found.state), wanted, atol=5 * within * np.abs(wanted).max())
