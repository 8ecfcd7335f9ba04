"""Estimates on charts: near the full body's, from cell to cell, and by the full body where there is none."""

from dataclasses import replace
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from compilations import compilations

from softfuse.body import Body
from softfuse.errors import SoftfuseError, SolveError
from softfuse.estimation.estimator import Estimator
from softfuse.estimation.reduced_estimator import ReducedEstimator
from softfuse.estimation.step import Observation
from softfuse.functional.chart import facing
from softfuse.mechanics.model import Model
from softfuse.rom.basis import rest_stiffness
from softfuse.rom.cells import Cells
from softfuse.rom.load_paths import load_paths
from softfuse.rom.reduced_model import reduced_model
from softfuse.rom.rom_file import Atlas, AtlasFolder
from softfuse.rom.teaching import ChartSettings, teach

MM = 1e-3
NONE = np.zeros((0, 3, 3))
MIDDLE = jnp.asarray(facing(np.zeros((1, 3)), (0, 0, -1)))
CELLS = Cells.over((-16 * MM, -2 * MM), (-8 * MM, 2 * MM), 4 * MM)
PATH = [(-14.5 + 0.13 * k, 0.5 + 0.01 * k, 1.0 + 0.1 * k) for k in range(40)]
"""x, y [mm] and force [N] of a contact that goes from one cell to the next."""


@pytest.fixture(scope="module")
def folder(model: Model, tmp_path_factory: pytest.TempPathFactory) -> AtlasFolder:
    """The charts of the small robot."""
    assert isinstance(model.body, Body)
    stiffness = rest_stiffness(model.body)
    folder = AtlasFolder(tmp_path_factory.mktemp("charts"), "small robot")

    def loads_at(body, places):
        return replace(model, body=body).loads(places)

    for number, cell in enumerate(CELLS):
        chart = teach(
            model.linear,
            model.body,
            stiffness,
            loads_at,
            load_paths(cell.parts(2), 1, np.zeros(1), np.array([6.0]), levels=3, near=6),
            around=[jnp.asarray(place)[None] for place in cell.grid(9)],
            settings=ChartSettings(displacements=40, pressures=16),
        )
        folder.write(number, reduced_model(model, stiffness, chart, NONE), chart.basis)
    return folder


@pytest.fixture(scope="module")
def estimator(model: Model, folder: AtlasFolder, one) -> ReducedEstimator:
    return ReducedEstimator(Atlas(model, CELLS, folder), one, MIDDLE)


@pytest.fixture(scope="module")
def full(model: Model, one) -> Estimator:
    return Estimator(model, one, MIDDLE)


def seen_at(model: Model, volumes_under, x: float, y: float, force: float) -> Observation:
    """The volumes of an equilibrium, x, y in mm."""
    place = jnp.asarray(facing(np.array([[x * MM, y * MM, 0.0]]), (0, 0, -1)))
    return Observation(volumes_under(model, place, jnp.array([force])), 1e9 * jnp.eye(2), place)


def test_it_follows_a_contact_from_cell_to_cell_as_the_full_body_does(
    model, estimator, full, volumes_under
) -> None:
    frames = [seen_at(model, volumes_under, *at) for at in PATH]
    estimator.reset()
    full.reset()
    missed = []
    for (_, _, force), seen in zip(PATH, frames, strict=True):
        found, exact = estimator.update(seen), full.update(seen)
        assert not found.corrected and not found.lost
        assert found.drive[0] == pytest.approx(force, rel=0.02)
        shape, wanted = (np.asarray(model.body.displacement(e.state.z)) for e in (estimator, full))
        missed.append(np.abs(shape - wanted).max() / np.abs(wanted).max())
        assert exact.drive[0] == pytest.approx(found.drive[0], rel=0.02)
    assert np.percentile(missed, 95) < 0.02


def test_where_there_is_no_chart_the_full_body_goes_on(model, estimator, full, volumes_under) -> None:
    estimator.reset()
    outside = [seen_at(model, volumes_under, x, 0.0, 4.0) for x in (-10.0, -8.5, -6.0, -6.0, -6.0)]
    found = [estimator.update(seen) for seen in outside]
    assert [e.corrected for e in found] == [False, False, True, True, True]
    full.reset()
    wanted = [full.update(seen) for seen in outside][-1]
    np.testing.assert_allclose(found[-1].drive, wanted.drive, rtol=1e-4)
    np.testing.assert_allclose(estimator.state.z, full.state.z, atol=1e-3 * np.abs(full.state.z).max())
    inside = [estimator.update(seen_at(model, volumes_under, -9.0, 0.0, 4.0)) for _ in range(6)]
    assert not inside[-1].corrected
    assert inside[-1].drive[0] == pytest.approx(4.0, rel=0.02)


def test_a_contact_that_does_not_press_stays_on_the_chart(model, estimator, volumes_under) -> None:
    """What is left of the shape then is rounding, of which the last modes may be any part."""
    estimator.reset()
    estimator.update(seen_at(model, volumes_under, -14.5, 0.5, 3.0))
    random = np.random.default_rng(0)
    for _ in range(20):
        point = np.array([[-14.5 * MM, 0.5 * MM, 0.0]]) + random.normal(0, 0.02 * MM, (1, 3)) * [1, 1, 0]
        place = facing(point, (0, 0, -1))
        noise = random.normal(0, 1e-10, 2)
        found = estimator.update(Observation(jnp.asarray(noise), 1e9 * jnp.eye(2), jnp.asarray(place)))
        assert not found.corrected
        assert found.drive[0] < 0.2


def test_nothing_is_compiled_while_charts_are_changed(model, estimator, volumes_under) -> None:
    """Nor while the full body goes on and a chart is taken again, not even for the first time."""
    frames = [seen_at(model, volumes_under, *at) for at in (*PATH, (-6.0, 0.0, 4.0), *PATH[::-1])]
    estimator.reset()
    estimator.update(frames[0])
    jax.clear_caches()
    with compilations() as events:
        corrected = []
        for _ in range(3):
            for seen in frames:
                corrected.append(estimator.update(seen).corrected)
                estimator.displacement()
    assert any(corrected) and not all(corrected)
    assert events == []


def test_a_reset_forgets(model, estimator, volumes_under) -> None:
    frames = [seen_at(model, volumes_under, *at) for at in PATH[:8]]
    estimator.reset()
    first = [estimator.update(seen).drive[0] for seen in frames]
    estimator.update(seen_at(model, volumes_under, -6.0, 0.0, 4.0))
    estimator.reset()
    rest, wanted = estimator.state, model.rest_state(estimator._places)
    assert eqx.tree_equal(rest, wanted)
    assert [estimator.update(seen).drive[0] for seen in frames] == first


def test_a_device_of_another_structure_is_refused(model, full) -> None:
    other = replace(model, readings=model.readings[:1])
    with pytest.raises(SolveError, match="another structure"):
        full.live.ready(other)


def test_charts_that_are_missing_damaged_or_of_another_device_are_told(
    model, folder: AtlasFolder, tmp_path: Path
) -> None:
    copy = AtlasFolder(tmp_path, folder.mark)
    for number in range(len(CELLS)):
        copy.file(number).write_bytes(folder.file(number).read_bytes())
    Atlas(model, CELLS, copy)
    with pytest.raises(SoftfuseError, match="another robot"):
        Atlas(model, CELLS, AtlasFolder(tmp_path, "another"))
    whole = copy.file(1).read_bytes()
    copy.file(1).write_bytes(whole[: len(whole) // 2])
    with pytest.raises(SoftfuseError, match="damaged"):
        Atlas(model, CELLS, copy)
    copy.file(1).unlink()
    with pytest.raises(SoftfuseError, match="1 of 2 charts are missing"):
        Atlas(model, CELLS, copy)
