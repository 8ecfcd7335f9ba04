"""Arrays kept on disk: found again, made anew when anything is wrong with them, never unpickled."""

import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from softfuse.experiment.episodes import Touch
from softfuse.experiment.pose_cache import Arrays, kept, settings_digest
from softfuse.sensors.crossed.field import CrossedLines, FieldSettings

NAMES = frozenset({"force", "volume"})


class Maker:
    """Makes arrays and counts how often, and how often it is started."""

    def __init__(self) -> None:
        self.times, self.starts = 0, 0

    def __call__(self) -> Callable[[int], Arrays]:
        self.starts += 1

        def compute(k: int) -> Arrays:
            self.times += 1
            return {"force": np.arange(3.0) + k, "volume": np.ones((3, 4)) / 3}

        return compute


def one(folder: Path | None, file: str, make: Maker) -> Arrays:
    (arrays,) = kept(folder, [file], NAMES, make)
    return arrays


def check(arrays: Arrays) -> None:
    np.testing.assert_array_equal(arrays["force"], np.arange(3.0))
    np.testing.assert_array_equal(arrays["volume"], np.ones((3, 4)) / 3)


def test_arrays_are_made_once(tmp_path: Path) -> None:
    make, folder = Maker(), tmp_path / "not" / "there yet"
    for _ in range(3):
        check(one(folder, "pad", make))
    assert make.times == 1
    check(one(folder, "another", make))
    check(one(None, "pad", make))
    assert make.times == 3
    assert sorted(path.name for path in folder.iterdir()) == ["another.npz", "pad.npz"]


def test_of_several_only_those_that_are_not_there_are_made(tmp_path: Path) -> None:
    make, files = Maker(), [f"pad-{k}" for k in range(5)]
    first = kept(tmp_path, files, NAMES, make)
    assert [arrays["force"][0] for arrays in first] == [0, 1, 2, 3, 4] and (make.starts, make.times) == (1, 5)
    for k in (1, 3):
        (tmp_path / f"pad-{k}.npz").unlink()
    again = kept(tmp_path, files, NAMES, make)
    assert [arrays["force"][0] for arrays in again] == [0, 1, 2, 3, 4] and (make.starts, make.times) == (2, 7)
    kept(tmp_path, files, NAMES, make)
    assert make.starts == 2


def test_what_is_made_before_a_failure_is_kept(tmp_path: Path) -> None:
    def start() -> Callable[[int], Arrays]:
        def compute(k: int) -> Arrays:
            if k == 2:
                raise RuntimeError("no equilibrium")
            return Maker()()(k)

        return compute

    with pytest.raises(RuntimeError, match="no equilibrium"):
        kept(tmp_path, [f"pad-{k}" for k in range(50)], NAMES, start)
    made = {path.stem for path in tmp_path.iterdir()}
    assert {"pad-0", "pad-1"} <= made and len(made) < 50


def test_a_damaged_file_is_made_anew(tmp_path: Path) -> None:
    make = Maker()
    one(tmp_path, "pad", make)
    path = tmp_path / "pad.npz"
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    damaged = [b"", b"PK", whole[: len(whole) // 2], b"\x93NUMPY", pickle.dumps({"force": 1})]
    for at in rng.integers(0, len(whole), 300).tolist():
        damaged.append(whole[:at] + bytes([whole[at] ^ (1 << int(rng.integers(8)))]) + whole[at + 1 :])
    for data in damaged:
        path.write_bytes(data)
        arrays = one(tmp_path, "pad", make)
        assert set(arrays) == NAMES
        check(arrays)


def test_other_arrays_are_made_anew(tmp_path: Path) -> None:
    make = Maker()
    whole = {"force": np.arange(3.0), "volume": np.ones((3, 4)) / 3}
    for other in ({"force": whole["force"]}, whole | {"depth": np.ones(3)}):
        np.savez(tmp_path / "pad.npz", allow_pickle=False, **other)
        check(one(tmp_path, "pad", make))
    assert make.times == 2


def test_objects_are_not_unpickled(tmp_path: Path) -> None:
    make = Maker()
    np.savez(tmp_path / "pad.npz", force=np.array([Path("x")], dtype=object), volume=np.ones(1))
    check(one(tmp_path, "pad", make))
    assert make.times == 1


def test_a_folder_that_cannot_be_is_done_without(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "file").touch()
    make = Maker()
    check(one(tmp_path / "file", "pad", make))
    assert make.times == 1 and "cannot be kept" in caplog.text


def test_settings_have_names_of_their_own() -> None:
    lines = CrossedLines((0.0, 1e-3), (0.0, 1e-3), 1e-3, 1.5e-3)
    names = {
        settings_digest(lines, FieldSettings(), (Touch("a", ((0.0, 0.0, 0.0),), (1.0,)),)),
        settings_digest(lines, FieldSettings(radius=9e-3), (Touch("a", ((0.0, 0.0, 0.0),), (1.0,)),)),
        settings_digest(lines, FieldSettings(), (Touch("a", ((0.0, 0.0, 0.0),), (1.0, 2.0)),)),
        settings_digest(lines, FieldSettings(), (Touch("a", ((0.0, 1e-9, 0.0),), (1.0,)),)),
    }
    assert len(names) == 4
    assert settings_digest(lines) == settings_digest(CrossedLines((0.0, 1e-3), (0.0, 1e-3), 1e-3, 1.5e-3))
