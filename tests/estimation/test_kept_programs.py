"""Kept programs do what freshly made ones do, and are made again when anything about them changed."""

import logging
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from checks import unchecked as no_checks

from softfuse.estimation import kept_programs, live_step
from softfuse.estimation.estimator import DEFAULT_STEPS, Estimator, StepSettings
from softfuse.estimation.kept_programs import lowered
from softfuse.estimation.limits import Limits
from softfuse.estimation.step import Observation
from softfuse.functional.chart import facing
from softfuse.material.base import lame_constants
from softfuse.mechanics.model import Model
from softfuse.mechanics.sparse import SparseLU

AT = jnp.asarray(facing(np.array([[14e-3, -2e-3, 0.0]]), (0, 0, -1)))
POISSON = jnp.array([0.3, 0.49])


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    """Where JAX is told to keep programs: softfuse's are in the folder within."""
    before = jax.config.values["jax_compilation_cache_dir"]
    jax.config.update("jax_compilation_cache_dir", str(tmp_path / "jax"))
    yield tmp_path / "jax" / "softfuse"
    jax.config.update("jax_compilation_cache_dir", before)


@pytest.fixture(autouse=True)
def unchecked() -> Iterator[None]:
    """Checks of shapes would be traced and lowered, too."""
    with no_checks():
        yield


@pytest.fixture
def traced(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names of what was traced."""
    names: list[str] = []

    def noted(function: Callable) -> Callable:
        def run(*given, **named):
            names.append(function.__name__)
            return function(*given, **named)

        return run

    monkeypatch.setattr(live_step, "estimate_step", noted(live_step.estimate_step))
    monkeypatch.setattr(live_step, "loaded_tangents", noted(live_step.loaded_tangents))
    return names


def pressed(model: Model, one: Limits, settings: StepSettings = DEFAULT_STEPS) -> list[np.ndarray]:
    """All numbers of some frames with a growing force."""
    following = Estimator(model, one, AT, settings)
    found = []
    for part in np.linspace(0, 1, 12):
        seen = Observation(part * jnp.array([-1e-8, -4e-7]), 1e9 * jnp.eye(2), AT)
        estimate = following.update(seen)
        found += map(np.asarray, [*jax.tree.leaves(estimate.report), following.state.z, estimate.drive])
    return found


def same_bits(one: list[np.ndarray], other: list[np.ndarray]) -> bool:
    return all(a.tobytes() == b.tobytes() for a, b in zip(one, other, strict=True))


def test_a_kept_program_gives_the_same_bits_and_is_not_traced(plain_device, one, folder, traced):
    fresh = pressed(plain_device, one)
    assert set(traced) == {"estimate_step", "loaded_tangents"}
    assert sorted(path.name.split("-")[0] for path in folder.iterdir()) == ["begun", "rest", "stepped"]
    del traced[:]
    kept = pressed(plain_device, one)
    assert not traced
    jax.config.update("jax_enable_compilation_cache", False)
    try:
        compiled = pressed(plain_device, one)
    finally:
        jax.config.update("jax_enable_compilation_cache", True)
    assert traced
    assert np.abs(fresh[-1]).max() > 0 and np.abs(fresh[-2]).max() > 0
    assert same_bits(fresh, kept)
    assert same_bits(fresh, compiled)


@pytest.mark.slow
def test_another_setting_makes_another_step_only(plain_device, one, folder, traced):
    pressed(plain_device, one)
    del traced[:]
    pressed(plain_device, one, StepSettings(refinements=1))
    assert traced == ["estimate_step"]


def kept(folder: Path) -> int:
    return len(list(folder.iterdir()))


@pytest.mark.parametrize(
    ("young", "poisson"),
    [
        (0.3e6, POISSON),
        (0.6e6, POISSON[:1]),
        (0.6e6, POISSON.astype(jnp.float32)),
        (jnp.asarray(0.6e6), POISSON),
    ],
)
def test_other_constants_shapes_and_types_make_another_program(folder, young, poisson):
    for count in (1, 1):
        lowered(lame_constants, 0.6e6, POISSON).compile()(POISSON)
        assert kept(folder) == count
    found = lowered(lame_constants, young, poisson).compile()(poisson)
    assert kept(folder) == 2
    for a, b in zip(found, lame_constants(young, poisson), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6)


def test_another_source_makes_another_program(folder, monkeypatch):
    lowered(lame_constants, 0.6e6, POISSON)
    monkeypatch.setattr(kept_programs, "_source", lambda: "edited")
    lowered(lame_constants, 0.6e6, POISSON)
    assert kept(folder) == 2


def test_another_setting_of_jax_makes_another_program(folder):
    lowered(lame_constants, 0.6e6, POISSON)
    with jax.default_matmul_precision("float32"):
        lowered(lame_constants, 0.6e6, POISSON)
    assert kept(folder) == 2


@pytest.mark.parametrize(
    "damaged",
    [
        lambda data: b"",
        lambda data: data[:-1],
        lambda data: data[:40] + bytes([data[40] ^ 1]) + data[41:],
        lambda data: b"\x80\x04." + data,
    ],
)
def test_a_damaged_file_is_written_anew(folder, damaged, caplog):
    caplog.set_level(logging.INFO)
    expected = lowered(lame_constants, 0.6e6, POISSON).compile()(POISSON)
    (path,) = folder.iterdir()
    whole = path.read_bytes()
    path.write_bytes(damaged(whole))
    found = lowered(lame_constants, 0.6e6, POISSON).compile()(POISSON)
    assert "damaged" in caplog.text
    assert same_bits([np.asarray(x) for x in found], [np.asarray(x) for x in expected])
    caplog.clear()
    lowered(lame_constants, 0.6e6, POISSON)
    assert not caplog.text


def test_the_file_of_another_program_is_not_taken_for_it(folder):
    lowered(lame_constants, 0.6e6, POISSON)
    (first,) = folder.iterdir()
    lowered(lame_constants, 0.3e6, POISSON)
    (second,) = set(folder.iterdir()) - {first}
    second.write_bytes(first.read_bytes())
    found = lowered(lame_constants, 0.3e6, POISSON).compile()(POISSON)
    np.testing.assert_allclose(found, lame_constants(0.3e6, POISSON), rtol=1e-12)


def test_another_xla_that_does_not_know_the_options_compiles_without_them(monkeypatch):
    monkeypatch.setattr(kept_programs, "_QUICKLY", {"xla_no_such_option": True})
    assert float(lowered(lambda fixed, x: fixed * x, 3.0, jnp.ones(())).compile()(jnp.ones(()))) == 3.0


@pytest.mark.slow
def test_what_calls_another_library_is_traced_at_every_start(plain_device, one, folder, traced):
    model = replace(plain_device, linear=SparseLU.plan(plain_device.body))
    first = pressed(model, one)
    assert not [path for path in folder.iterdir() if path.name.startswith("step")]
    del traced[:]
    assert same_bits(first, pressed(model, one))
    assert traced == ["estimate_step"]


def test_where_nothing_can_be_kept_all_is_done_without(folder, caplog):
    caplog.set_level(logging.INFO)
    folder.parent.mkdir()
    folder.write_text("no folder")
    found = lowered(lame_constants, 0.6e6, POISSON).compile()(POISSON)
    np.testing.assert_allclose(found, lame_constants(0.6e6, POISSON), rtol=1e-12)
    assert "cannot be kept" in caplog.text


def test_trees_of_another_kind_are_refused(folder):
    run = lowered(lame_constants, 0.6e6, POISSON).compile()
    with pytest.raises(TypeError, match="was given"):
        run((POISSON,))
