"""What a grid's cells say about a punch over it and pressed in, and that it is kept apart from others."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from softfuse.robot.file import load
from softfuse.robot.body import PadSource
from softfuse.experiment.build_virtual_pad import pad_plan
from softfuse.experiment import kept_poses
from softfuse.experiment.electrode_electronics import CellElectronics
from softfuse.experiment.pad_electrodes import GridElectrodes
from softfuse.experiment.pad_touches import PadBed, PadTouches, pad_touches
from softfuse.experiment.pose_cache import settings_digest
from softfuse.experiment.virtual_pad import PadErrors, PadPose, PadSettings, Touch
from softfuse.mechanics.sparse import SparseLU
from softfuse.mesh.pad import PadGeometry
from softfuse.sensors.mutual.field import MutualField

MM = 1e-3
CONFIG = Path(__file__).parents[2] / "configs" / "pad_mutual.toml"
X, Y = (-24 * MM, -8 * MM, 8 * MM, 24 * MM), (-15 * MM, -5 * MM, 5 * MM, 15 * MM)
GRID = GridElectrodes(MutualField(X, Y, half_width=5 * MM), radius=6 * MM)
OVER = (8 * MM, -15 * MM)
"""Row 0, column 2."""


def pose(force: float) -> PadPose:
    """Of which a grid takes the force."""
    return PadPose(force, 1e-3, np.zeros(4), np.zeros((0, 3)))


def image(said: np.ndarray) -> np.ndarray:
    """Row by row."""
    return said.reshape(4, 4)


def test_cells_are_row_by_row_and_lose_most_under_a_punch_that_is_close() -> None:
    near = [image(GRID.near(OVER, gap)) for gap in (0.0, 1 * MM, 5 * MM, 25 * MM)]
    for there in near:
        assert (there < 0).all() and there.min() == there[0, 2]
    assert (np.diff([there[0, 2] for there in near]) > 0).all()
    assert near[0][0, 2] < -0.05 and near[-1][0, 2] > -0.01
    # Rows are closer than columns, and the row next to the punch loses more than the column next to it.
    assert near[1][1, 2] < near[1][0, 1]


def test_force_per_area_squeezes_the_cells() -> None:
    pressed = [image(GRID.pressed(OVER, pose(force), GRID.points)) for force in (0.0, 2.0, 6.0)]
    np.testing.assert_array_equal(pressed[0], image(GRID.near(OVER, 0.0)))
    assert pressed[0][0, 2] < 0 < pressed[1][0, 2] < pressed[2][0, 2]
    assert pressed[2].max() == pressed[2][0, 2]
    # A quarter of the area under the same pressure, in the middle of a cell that is larger than either.
    field = MutualField(half_width=20 * MM)
    at = (field.column_x[0], field.row_y[0])
    wide, narrow = (
        GridElectrodes(field, radius).pressed(at, pose(force), GRID.points)[0]
        - GridElectrodes(field, radius).near(at, 0.0)[0]
        for radius, force in ((12 * MM, 8.0), (6 * MM, 2.0))
    )
    assert narrow / wide == pytest.approx(0.25, rel=0.15)


def test_crosstalk_is_what_cells_of_the_same_lines_add() -> None:
    without = dataclasses.replace(GRID, field=dataclasses.replace(GRID.field, crosstalk=0.0))
    alone, said = (image(each.pressed(OVER, pose(6.0), each.points)) for each in (without, GRID))
    row, column = alone.sum(axis=1), alone.sum(axis=0)
    expected = alone + 0.01 * (row[:, None] + column[None] - 2 * alone)
    np.testing.assert_allclose(said, expected, atol=1e-15)


def test_what_is_kept_differs_by_every_setting_of_the_grid(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def kept(folder, files, names, start):
        asked.extend(files)
        return [dict.fromkeys(names, np.zeros(1)) for _ in files]

    monkeypatch.setattr(kept_poses, "kept", kept)
    changes = {
        "column_x": Y, "row_y": X, "half_width": 4 * MM, "depth": 1 * MM, "fringe": 0.2, "returned": 0.2,
        "spacer_Pa": 5e4, "crosstalk": 0.02,
    }  # fmt: skip
    assert changes.keys() == {field.name for field in dataclasses.fields(MutualField)}
    fields = [dataclasses.replace(GRID.field, **{name: value}) for name, value in changes.items()]
    grids = [GRID, GridElectrodes(GRID.field, 5 * MM), *(GridElectrodes(field, 6 * MM) for field in fields)]
    for grid in grids:
        kept_poses.kept_pad_touches(None, SETTINGS, grid, [Touch((0.0, 0.0), (1.0,))], (0.0, 1e-3))
    assert len(set(asked)) == len(grids) == 10
    assert settings_digest(GRID) == settings_digest(
        GridElectrodes(MutualField(X, Y, half_width=5 * MM), 6 * MM)
    )


SETTINGS = PadSettings(
    PadGeometry(
        size=(0.07, 0.07, 0.018),
        cavity_size=(0.026, 0.026, 0.006),
        cavity_centres=((-0.0165, -0.0165), (-0.0165, 0.0165), (0.0165, -0.0165), (0.0165, 0.0165)),
        cavity_z_bottom=0.006,
    ),
    0.2e6,
    surface_size=28e-3,
    base_size=28e-3,
    growth=3.0,
    radius=6e-3,
    rims=(1.0,),
    sectors=(4,),
    errors=PadErrors(0.0, 0.0),
)
"""A coarse mesh, without errors of making."""


def test_equilibria_and_cells_come_together() -> None:
    gaps, forces = (0.0, 2e-3, 25e-3), (1.0, 3.0)
    found = pad_touches(PadBed(SETTINGS, GRID, gaps, plan=SparseLU.plan), [Touch((8e-3, -5e-3), forces)])
    assert isinstance(found, PadTouches)
    assert found.near.shape == (1, 3, 16) and found.pressed.shape == (1, 3, 16)
    np.testing.assert_array_equal(found.pressed[:, 0], found.near[:, 0])
    np.testing.assert_array_equal(found.pressed[0, 2], GRID.pressed((8e-3, -5e-3), pose(3.0), GRID.points))
    assert (found.volume[0, 1:, 2] < 0).all()


@pytest.mark.parametrize(
    ("width", "half"), [('electrode_width = "12 mm"', 6 * MM), ("# pitch apart", 8 * MM)]
)
def test_the_grids_drawing_is_the_configurations(width: str, half: float, tmp_path: Path) -> None:
    text = CONFIG.read_text(encoding="utf-8")
    for old, new in (
        ('electrode_width = "16 mm"', width),
        ('depth = "1.5 mm"', 'depth = "2 mm"'),
        ('row_y = ["-24 mm", "-8 mm"', 'row_y = ["-24 mm", "-9 mm"'),
        ("noise_counts = 8.0", "noise_counts = 5.0"),
    ):
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path = tmp_path / "pad.toml"
    path.write_text(text, encoding="utf-8")
    config = load(path)
    assert isinstance(config.body.source, PadSource)
    plan = pad_plan(config, config.body.source, 0.2e6, 0.49)
    assert isinstance(plan.array, GridElectrodes) and plan.array.radius == 8 * MM
    field = plan.array.field
    np.testing.assert_allclose(field.column_x, X)
    np.testing.assert_allclose(field.row_y, [-24 * MM, -9 * MM, 8 * MM, 24 * MM])
    assert field.half_width == pytest.approx(half) and field.depth == pytest.approx(2 * MM)
    assert isinstance(plan.parts.electrodes, CellElectronics) and plan.parts.electrodes.noise_counts == 5.0
    assert plan.electrodes == tuple(f"cell{row}{column}" for row in range(4) for column in range(4))


def test_where_the_punch_waits_a_grid_has_forgotten_it() -> None:
    config = load(CONFIG)
    assert isinstance(config.body.source, PadSource)
    plan = pad_plan(config, config.body.source, 0.2e6, 0.49)
    assert isinstance(plan.parts.electrodes, CellElectronics)
    waits = [plan.array.near(touch.at, plan.gaps[-1]) for touch in plan.touches]
    lost = np.abs(plan.parts.electrodes.rest_counts * np.array(waits)).max()
    assert lost < 3 * plan.parts.electrodes.noise_counts
