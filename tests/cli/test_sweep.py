"""softfuse sweep on a coarse pad: rows are those of single simulations, and nothing is computed twice."""

import importlib.util
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import psutil
import pyarrow.dataset as ds
import pytest
from distributed import Client, LocalCluster

from softfuse.computing.cluster import prepared
from softfuse.errors import SoftfuseError
from softfuse.experiment.sweep import Chunk, Swept, chunks_of, solve_chunk
from softfuse.functional.chart import facing
from softfuse.mechanics.cable import ShortenedCable
from softfuse.mechanics.model import simulate
from softfuse.robot.digest import digest
from softfuse.robot.file import load, save_edited
from softfuse.robot.press_plan import load_plan
from softfuse.robot.press_series import swept_model
from softfuse.robot.robot import build_robot
from softfuse.robot.trial import Trial

PLACES = '[places]\ntype = "list"\nat = [["-17 mm", "-15 mm"], ["12 mm", "14 mm"]]\n'
FORCES = '[forces]\nvalues = ["1 N", "4 N"]\n'
PLAN = "contacts = [1, 2]\nmodulus_factors = [1, 1.5]\ncases_per_file = 2\n" + PLACES + FORCES
"""Of each modulus two places and the pair of them, each at two forces: 12 cases in 6 files."""

OPTIONS: Any = {
    "dashboard_address": None,
    "scheduler_kwargs": {"dashboard_address": "127.0.0.1:0"},
    "memory_limit": 0,
}
"""No dashboard, and no port that something else may have."""

Rows = list[dict[str, Any]]

PAD = Path(__file__).parents[2] / "configs" / "pad.toml"

CAVITIES = ("minus_minus", "minus_plus", "plus_minus", "plus_plus")

CHAMBERS = ("base left", "base right", "middle left", "middle right", "tip left", "tip right")


@pytest.fixture(scope="module")
def pad(coarse: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The coarsest pad of linear elements, which compile in no time."""
    text = coarse.read_text().replace('element = "taylor-hood"', 'element = "linear"')
    # With a high Poisson's ratio linear elements lock.
    path = tmp_path_factory.mktemp("pad") / "pad.toml"
    path.write_text(text.replace("poisson = 0.49", "poisson = 0.3"))
    return path


@pytest.fixture(scope="module")
def cluster() -> Iterator[LocalCluster]:
    """Two processes behind a scheduler."""
    with LocalCluster(n_workers=2, threads_per_worker=1, host="127.0.0.1", **OPTIONS) as cluster:
        yield cluster


@pytest.fixture
def plan(tmp_path: Path) -> Callable[[str], Path]:
    """Writes a plan."""

    def write(text: str) -> Path:
        path = tmp_path / "plan.toml"
        path.write_text(text)
        return path

    return write


def rows_in(folder: Path) -> Rows:
    """All rows, in the order of the cases."""
    return ds.dataset(sorted(map(str, folder.glob("part-*.parquet")))).to_table().to_pylist()


@pytest.mark.slow
def test_rows_are_those_of_single_simulations_and_none_is_computed_twice(
    code_of: Callable[..., int],
    capsys: pytest.CaptureFixture[str],
    cluster: LocalCluster,
    pad: Path,
    plan: Callable[[str], Path],
    tmp_path: Path,
) -> None:
    out = tmp_path / "out"
    given = ("sweep", pad, plan(PLAN), "--out", out)
    assert code_of(*given, "--scheduler", cluster.scheduler_address) == 0
    assert capsys.readouterr().out.endswith("out, 12 of them new: 12 converged\n")
    rows = rows_in(out)
    assert [row["case"] for row in rows] == list(range(12))
    assert len(list(out.glob("part-*.parquet"))) == 6

    soft = load(pad)
    stiff = save_edited(pad, tmp_path / "stiff.toml", {("body", "material", 0, "young"): "0.9 MPa"})
    models = {1.0: build_robot(soft).model, 1.5: build_robot(stiff).model}
    for row in rows:
        assert row["result"] == "converged" and row["residual_N"] < 1e-9 and row["wall_time_s"] > 0
        count = row["contacts"]
        at = [[1e-3 * row[f"indenter{k}_{axis}_mm"] for axis in "xy"] + [0.0] for k in range(count)]
        force = [row[f"indenter{k}_force_N"] for k in range(count)]
        assert row["force_N"] == sum(force)
        if count == 1:
            assert row["indenter1_x_mm"] is None and row["indenter1_force_N"] is None
        model = models[row["modulus_factor"]]
        places = jnp.asarray(facing(np.array(at), (0, 0, -1)))
        solution = simulate(model, places, jnp.array(force), model.rest_state(places))
        volumes = 1e9 * np.asarray(model.reading(solution.state))
        assert np.max(np.abs(volumes)) > 1.0
        found = [row[f"{name}_mm3"] for name in CAVITIES]
        np.testing.assert_allclose(found, volumes, rtol=0, atol=1e-10 * np.max(np.abs(volumes)))
        moved = np.linalg.norm(model.body.displacement(solution.state.z), axis=1)
        np.testing.assert_allclose(row["largest_displacement_mm"], 1e3 * moved.max(), rtol=1e-10)
        depth = 1e3 * float(model.depth(places, solution.state))
        assert depth > 0.01
        np.testing.assert_allclose(row["indenter0_depth_mm"], depth, rtol=1e-10)

    # With one part gone and one broken those two are computed, with all there no scheduler is asked.
    parts = sorted(out.glob("part-*.parquet"))
    before = {part: part.stat().st_mtime_ns for part in parts}
    parts[1].unlink()
    parts[2].write_bytes(parts[2].read_bytes()[:-100])
    assert code_of(*given, "--scheduler", cluster.scheduler_address) == 0
    assert ", 4 of them new: 12 converged" in capsys.readouterr().out
    again = rows_in(out)
    for old, new in zip(rows, again, strict=True):
        assert old["case"] == new["case"]
        np.testing.assert_allclose(old["minus_minus_mm3"], new["minus_minus_mm3"], rtol=0, atol=1e-8)
    for part in (parts[0], *parts[3:]):
        assert part.stat().st_mtime_ns == before[part]
    assert code_of(*given, "--scheduler", "tcp://127.0.0.1:1") == 0
    assert ", 0 of them new: 12 converged" in capsys.readouterr().out

    about = json.loads((out / "sweep.json").read_text())
    assert about["softfuse"] == version("softfuse") and about["config"] == digest(soft)
    assert about["columns"]["minus_minus_mm3"] == 'volume change of "(-,-)"'
    assert list(about["columns"]) == list(rows[0])

    for config, text, told in (
        (pad, PLAN.replace("1.5", "1.6"), "holds a sweep by another plan"),
        (tmp_path / "stiff.toml", PLAN, "holds a sweep by another config"),
    ):
        assert code_of("sweep", config, plan(text), "--out", out) == 2
        assert re.fullmatch(rf"error: .*{told}: give another folder\n", capsys.readouterr().err)
    assert rows_in(out) == again


@pytest.mark.slow
def test_a_case_that_fails_is_a_row(
    code_of: Callable[..., int], cluster: LocalCluster, pad: Path, plan: Callable[[str], Path], tmp_path: Path
) -> None:
    text = pad.read_text().replace('x = ["-30 mm", "30 mm"]', 'x = ["-39 mm", "30 mm"]')
    config = tmp_path / "wide.toml"
    config.write_text(text)
    failing = PLACES.replace("-17 mm", "-36 mm") + FORCES.replace("4 N", "30 kN")
    given = ("sweep", config, plan(failing), "--out", tmp_path, "--quiet")
    assert code_of(*given, "--scheduler", cluster.scheduler_address) == 0
    off, off_too, fine, crushed = rows_in(tmp_path)
    assert off["result"] == off_too["result"] == "overhangs" and off["residual_N"] is None
    assert fine["result"] == "converged" and fine["plus_plus_mm3"] < 0
    assert crushed["result"] in ("inverted", "diverged", "snapped", "step_limit")
    assert (
        crushed["plus_plus_mm3"] is None and crushed["force_N"] == 30e3 and crushed["newton_iterations"] > 0
    )


@pytest.mark.slow
def test_a_worker_that_dies_is_told_and_costs_nothing(
    code_of: Callable[..., int],
    caplog: pytest.LogCaptureFixture,
    pad: Path,
    plan: Callable[[str], Path],
    tmp_path: Path,
) -> None:
    with LocalCluster(n_workers=2, threads_per_worker=1, host="127.0.0.1", **OPTIONS) as cluster:
        with Client(cluster, set_as_default=False) as client:
            pids = client.run(os.getpid)
            killed = []

            def kill_a_busy_one() -> None:
                while not killed:
                    busy = [worker for worker, keys in client.processing().items() if keys]
                    if busy:
                        os.kill(pids[busy[0]], signal.SIGKILL)
                        killed.append(busy[0])
                    time.sleep(0.05)

            thread = threading.Thread(target=kill_a_busy_one)
            thread.start()
            given = ("sweep", pad, plan(PLAN), "--out", tmp_path / "out", "--quiet")
            code = code_of(*given, "--scheduler", cluster.scheduler_address)
            thread.join()
        assert code == 0 and len(rows_in(tmp_path / "out")) == 12
    assert f"the worker {killed[0]} has died" in caplog.text


@pytest.fixture
def heeded_interrupts() -> Iterator[None]:
    """Processes started within heed SIGINT, which those of a job in the background ignore."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="process groups")
@pytest.mark.usefixtures("heeded_interrupts")
def test_an_interrupt_leaves_what_is_finished_and_only_the_loopback_is_listened_on(
    pad: Path, plan: Callable[[str], Path], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    many = plan(PLAN.replace("[1, 1.5]", str([1 + k / 100 for k in range(500)])))
    command = [sys.executable, "-m", "softfuse", "sweep", pad, many, "--out", out, "--workers", "2"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    try:
        deadline = time.monotonic() + 240
        while not list(out.glob("part-*.parquet")):
            assert process.poll() is None and time.monotonic() < deadline
            time.sleep(0.2)
        family = [psutil.Process(process.pid), *psutil.Process(process.pid).children(recursive=True)]
        ports = [port for each in family for port in each.net_connections("inet")]
        listening = {port.laddr.ip for port in ports if port.status == psutil.CONN_LISTEN}
        assert listening == {"127.0.0.1"} and len(family) >= 3
        os.killpg(process.pid, signal.SIGINT)
        _, err = process.communicate(timeout=120)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    assert process.returncode == 130
    assert "Traceback" not in err
    _, alive = psutil.wait_procs(family, timeout=30)
    assert not alive
    parts = list(out.glob("part-*.parquet"))
    assert 0 < len(parts) < 1500 and not list(out.glob(".softfuse-*"))
    assert {row["result"] for row in rows_in(out)} == {"converged"}


@pytest.mark.slow
def test_a_finger_is_pressed_while_its_cable_is_shortened(
    linear_finger: Callable[..., Path], plan: Callable[[str], Path]
) -> None:
    path = linear_finger()
    config = load(path)
    text = (
        '[places]\ntype = "electrodes"\nnames = ["tip left"]\n[forces]\nvalues = ["0 N", "0.2 N"]\n'
        '[[cable]]\nname = "palm"\nshortening = { values = ["5 mm"] }\n'
    )
    (chunk,) = chunks_of(path.read_text(), config, load_plan(plan(text)))
    alone, both = solve_chunk(chunk)
    names = [column.name for column in chunk.swept.table(config).columns]
    found = dict(zip(names, both, strict=True))
    assert found["hand_place"] == "tip left" and found["palm_mm"] == 5.0
    assert alone[names.index("force_N")] == 0.0 and found["force_N"] == found["hand_force_N"] == 0.2

    robot = build_robot(config)
    cable, gas = robot.model.actuators
    shortened = ShortenedCable.of(cable, robot.model.body)
    model = replace(swept_model(robot, {"palm": "shortening"}), actuators=(shortened, gas))
    places = jnp.asarray(config.places["tip left"][None])
    drive = jnp.array([0.1, 0.1, 5e-3, *6 * [101325.0]])
    reading = model.reading(simulate(model, places, drive, model.rest_state(places)).state)
    scale = np.array([1.0, *6 * [1e9], *6 * [1.0]])
    chambers = [each.replace(" ", "_") for each in CHAMBERS]
    read = ["palm_N", *(f"{each}_mm3" for each in chambers), *(f"{each}_Pa" for each in chambers)]
    np.testing.assert_allclose([found[name] for name in read], scale * reading, rtol=1e-8)


@pytest.mark.slow
def test_chambers_and_cables_of_a_trunk_are_driven_and_nothing_presses(plan: Callable) -> None:
    path = PAD.parent / "trunk.toml"
    config = load(path)
    text = (
        '[[cable]]\nname = "cable 1"\nshortening = { values = ["3 mm"] }\n'
        '[[chamber]]\nname = "chamber 2"\npressure = { values = ["2 kPa"] }\n'
    )
    (chunk,) = chunks_of(path.read_text(), config, load_plan(plan(text)))
    (row,) = solve_chunk(chunk)
    found = dict(zip([column.name for column in chunk.swept.table(config).columns], row, strict=True))
    assert found["contacts"] == 0 and found["cable_1_mm"] == 3.0 and found["chamber_2_Pa"] == 2000.0
    trial = Trial.of(build_robot(config), cables=["cable 1=3 mm"], pressures=["chamber 2=2 kPa"])
    numbers = trial.numbers(trial.solved())
    np.testing.assert_allclose(found["cable_1_N"], numbers["cables"]["cable 1"]["tension_N"], rtol=1e-6)
    volume = numbers["chambers"]["chamber 2"]["volume_change_mm3"]
    np.testing.assert_allclose(found["chamber_2_mm3"], volume, rtol=1e-6)


def test_a_worker_of_another_kind_is_refused(pad: Path) -> None:
    there = Swept(pad.read_text(), str(pad), digest(load(pad)), 1)
    with pytest.raises(SoftfuseError, match="a worker has softfuse .*, here it is 9.9: install the same"):
        prepared("9.9", solve_chunk, Chunk(0, there, ()))
    with pytest.raises(SoftfuseError, match="a worker finds other files than here"):
        solve_chunk(Chunk(0, replace(there, digest="0"), ()))


def test_a_device_is_built_once(pad: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    built = []
    monkeypatch.setattr(
        "softfuse.experiment.sweep.build_robot", lambda config: built.append(1) or build_robot(config)
    )
    text = pad.read_text() + "\n# not built before\n"
    there = Swept(text, str(pad), digest(load(pad)), 1)
    assert [solve_chunk(Chunk(number, there, ())) for number in range(3)] == [[], [], []]
    assert len(built) == 1


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ({"sweep.json": "[]"}, "sweep.json does not tell of a sweep"),
        ({"sweep.json": "{"}, "sweep.json does not tell of a sweep"),
        ({"part-00000.parquet": ""}, "holds parts of a sweep without sweep.json"),
    ],
)
def test_a_folder_of_something_else_is_refused(
    code_of: Callable[..., int],
    capsys: pytest.CaptureFixture[str],
    pad: Path,
    plan: Callable[[str], Path],
    tmp_path: Path,
    content: dict[str, str],
    told: str,
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    for name, text in content.items():
        (out / name).write_text(text)
    assert code_of("sweep", pad, plan(PLAN), "--out", out) == 2
    err = capsys.readouterr().err
    assert told in err and err.count("\n") == 1


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--scheduler", "tcp://127.0.0.1:1", "--workers", "2"), "--workers are processes on this computer"),
        (("--scheduler", "nowhere://127.0.0.1:1"), "--scheduler nowhere://127.0.0.1:1: no Dask scheduler"),
        (("--scheduler", "tcp://127.0.0.1:1"), "--scheduler tcp://127.0.0.1:1: no Dask scheduler answers"),
    ],
)
def test_a_mistake_is_one_line(
    code_of: Callable[..., int],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    pad: Path,
    plan: Callable[[str], Path],
    tmp_path: Path,
    options: tuple[str, ...],
    told: str,
) -> None:
    monkeypatch.setattr("softfuse.computing.cluster._ANSWER_S", 2)
    assert code_of("sweep", pad, plan(PLAN), "--out", tmp_path / "out", *options) == 2
    err = capsys.readouterr().err
    assert told in err and err.count("\n") == 1


def test_without_dask_it_is_told_how_to_get_it(
    code_of: Callable[..., int],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    pad: Path,
    plan: Callable[[str], Path],
    tmp_path: Path,
) -> None:
    assert importlib.util.find_spec("distributed") is not None
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert code_of("sweep", pad, plan(PLAN), "--out", tmp_path / "out") == 2
    err = capsys.readouterr().err
    assert "pip install 'softfuse[sweep]'" in err and err.count("\n") == 1
