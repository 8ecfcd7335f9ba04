"""Arrays kept on disk: found again, made anew when anything is wrong with them, never unpickled."""

import pickle
from pathlib import Path

import numpy as np
import pytest

from softfuse.experiment.pad_field import CrossedLines, FieldSettings
from softfuse.experiment.pose_cache import Arrays, kept, settings_digest
from softfuse.experiment.virtual_pad import Touch

NAMES = frozenset({"force", "volume"})


class Maker:
    """Makes arrays and counts how often."""

    def __init__(self) -> None:
        self.times = 0

    def __call__(self) -> Arrays:
        self.times += 1
        return {"force": np.arange(3.0), "volume": np.ones((3, 4)) / 3}


def check(arrays: Arrays) -> None:
    np.testing.assert_array_equal(arrays["force"], np.arange(3.0))
    np.testing.assert_array_equal(arrays["volume"], np.ones((3, 4)) / 3)


def test_arrays_are_made_once(tmp_path: Path) -> None:
    make, folder = Maker(), tmp_path / "not" / "there yet"
    for _ in range(3):
        check(kept(folder, "pad", NAMES, make))
    assert make.times == 1
    check(kept(folder, "another", NAMES, make))
    check(kept(None, "pad", NAMES, make))
    assert make.times == 3
    assert sorted(path.name for path in folder.iterdir()) == ["another.npz", "pad.npz"]


def test_a_damaged_file_is_made_anew(tmp_path: Path) -> None:
    make = Maker()
    kept(tmp_path, "pad", NAMES, make)
    path = tmp_path / "pad.npz"
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    damaged = [b"", b"PK", whole[: len(whole) // 2], b"\x93NUMPY", pickle.dumps({"force": 1})]
    for at in rng.integers(0, len(whole), 300).tolist():
        damaged.append(whole[:at] + bytes([whole[at] ^ (1 << int(rng.integers(8)))]) + whole[at + 1 :])
    for data in damaged:
        path.write_bytes(data)
        arrays = kept(tmp_path, "pad", NAMES, make)
        assert set(arrays) == NAMES
        check(arrays)


def test_other_arrays_and_numbers_that_are_none_are_made_anew(tmp_path: Path) -> None:
    make = Maker()
    for other in ({"force": np.arange(3.0)}, {"force": np.arange(3.0), "volume": np.full((3, 4), np.nan)}):
        np.savez(tmp_path / "pad.npz", **other)
        check(kept(tmp_path, "pad", NAMES, make))
    assert make.times == 2


def test_objects_are_not_unpickled(tmp_path: Path) -> None:
    make = Maker()
    np.savez(tmp_path / "pad.npz", force=np.array([Path("x")], dtype=object), volume=np.ones(1))
    check(kept(tmp_path, "pad", NAMES, make))
    assert make.times == 1


def test_a_folder_that_cannot_be_is_done_without(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "file").touch()
    make = Maker()
    check(kept(tmp_path / "file", "pad", NAMES, make))
    assert make.times == 1 and "cannot be kept" in caplog.text


def test_settings_have_names_of_their_own() -> None:
    lines = CrossedLines((0.0, 1e-3), (0.0, 1e-3), 1e-3, 1.5e-3)
    names = {
        settings_digest(lines, FieldSettings(), (Touch((0.0, 0.0), (1.0,)),)),
        settings_digest(lines, FieldSettings(radius=9e-3), (Touch((0.0, 0.0), (1.0,)),)),
        settings_digest(lines, FieldSettings(), (Touch((0.0, 0.0), (1.0, 2.0)),)),
        settings_digest(lines, FieldSettings(), (Touch((0.0, 1e-9), (1.0,)),)),
    }
    assert len(names) == 4
    assert settings_digest(lines) == settings_digest(CrossedLines((0.0, 1e-3), (0.0, 1e-3), 1e-3, 1.5e-3))
