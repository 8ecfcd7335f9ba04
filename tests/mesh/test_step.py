"""STEP files, with the extra that reads them and without it."""

import sys
from pathlib import Path

import numpy as np
import pytest

from softfuse.errors import MeshError
from softfuse.mesh.files import read_surface
from softfuse.mesh.shell import shell_parts
from softfuse.mesh.surface import enclosed_volume

BLOCK = Path(__file__).parents[1] / "data" / "block.step"
"""20 x 12 x 10 mm with a spherical void of 3 mm radius, written by Open CASCADE in mm."""


def test_a_solid_with_a_void_is_read_in_metres() -> None:
    pytest.importorskip("cascadio")
    shell = read_surface(BLOCK, scale=1.0)
    np.testing.assert_allclose(np.ptp(shell.nodes, axis=0), [0.020, 0.012, 0.010], rtol=1e-6)
    assert len(shell_parts(shell)) == 2
    expected = 2400e-9 - 4 / 3 * np.pi * 27e-9
    assert enclosed_volume(shell.nodes, shell.faces) == pytest.approx(expected, rel=5e-4)


def test_a_damaged_file_is_told(tmp_path: Path) -> None:
    pytest.importorskip("cascadio")
    (tmp_path / "bad.step").write_text("rubbish")
    with pytest.raises(MeshError, match="bad.step cannot be read as STEP"):
        read_surface(tmp_path / "bad.step")


def test_without_the_extra_it_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cascadio", None)
    with pytest.raises(MeshError, match=r'need the extra "cad": pip install "softfuse\[cad\]", or export'):
        read_surface(BLOCK)
