"""Sensors as one program: the same numbers as frame by frame, never compiled again, read when asked for."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from compilations import compilations

from softfuse.estimation.compiled_suite import CompiledSuite
from softfuse.estimation.kept_programs import Packing
from softfuse.hardware.recording import read_recording
from softfuse.robot.file import load
from softfuse.robot.robot import build_robot
from softfuse.sensors.suite import SensorSuite

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def suite(coarse: Path) -> SensorSuite:
    return build_robot(load(coarse)).suite


@pytest.fixture(scope="module")
def compiled(suite: SensorSuite) -> CompiledSuite:
    with ThreadPoolExecutor(1) as compiler:
        return CompiledSuite(suite, compiler)


@pytest.fixture(scope="module")
def frames(suite: SensorSuite) -> list[tuple[float, np.ndarray]]:
    """Until the first press is held: times and readings."""
    recording = read_recording(ROOT / "tests" / "data" / "pad_nominal_two_presses.csv.gz", [])
    return list(zip(recording.time_s[:200].tolist(), recording.matrix(suite.channels)[:200], strict=True))


def test_a_tree_comes_out_of_its_vectors_as_it_went_in():
    tree = {
        "a": jnp.arange(6.0).reshape(2, 3),
        "b": jnp.array([True, False]),
        "c": (jnp.array(3), jnp.zeros(0)),
    }
    packing = Packing.of(tree)
    packed = packing.pack(tree)
    assert sorted(vector.shape for vector in packed.values()) == [(1,), (2,), (6,)]
    again = packing.unpack({kind: np.asarray(vector) for kind, vector in packed.items()})
    assert eqx.tree_equal(again, jax.tree.map(np.asarray, tree))


def test_another_tree_is_refused():
    packing = Packing.of((jnp.zeros(3), jnp.zeros(2, bool)))
    with pytest.raises(ValueError, match="bool"):
        packing.pack((jnp.zeros(3), jnp.zeros(2)))


def test_the_program_says_what_the_sensors_say(suite, compiled, frames):
    compiled.reset()
    update, state = eqx.filter_jit(lambda s, t, r: suite.update(s, t, r)), suite.init()
    touched = False
    for time_s, raw in frames:
        found = compiled.update(time_s, raw).observation
        state, expected = update(state, jnp.asarray(time_s), jnp.asarray(raw))
        assert jax.tree.structure(found) == jax.tree.structure(expected)
        for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
            np.testing.assert_allclose(
                a, b, rtol=1e-6, atol=1e-9 * float(np.nan_to_num(np.abs(b)).max(initial=1))
            )
        touched |= bool(found.touching[0])
    assert touched


def test_the_same_frames_give_the_same_bits_and_nothing_is_compiled(compiled, frames):
    runs = []
    with compilations() as events:
        for _ in range(2):
            compiled.reset()
            runs.append([compiled.update(time_s, raw) for time_s, raw in frames])
    assert events == []
    for first, second in zip(*runs, strict=True):
        for kind, vector in first.packed.items():
            assert np.array_equal(np.asarray(vector), np.asarray(second.packed[kind]), equal_nan=True)


def test_a_kept_program_says_the_same_and_is_not_traced(suite, compiled, frames, tmp_path, monkeypatch):
    before = jax.config.values["jax_compilation_cache_dir"]
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    try:
        with ThreadPoolExecutor(1) as compiler:
            CompiledSuite(suite, compiler)
            monkeypatch.setattr(type(suite), "update", None)
            monkeypatch.setattr(type(suite), "init", None)
            kept = CompiledSuite(suite, compiler)
    finally:
        jax.config.update("jax_compilation_cache_dir", before)
    compiled.reset()
    for time_s, raw in frames:
        found, expected = (each.update(time_s, raw).observation for each in (kept, compiled))
        assert jax.tree.structure(found) == jax.tree.structure(expected)
        for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
            assert np.array_equal(a, b, equal_nan=True)


def test_another_number_of_readings_is_refused(compiled):
    with pytest.raises(ValueError, match="19 readings in a frame: the sensors have 20 channels"):
        compiled.update(0.0, np.zeros(19))
