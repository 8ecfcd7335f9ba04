"""Files hold the solids, in millimetres, to the byte the same each time."""

from dataclasses import replace

import numpy as np
import pytest

from softfuse.design.casting import casting
from softfuse.design.casting_files import named_solids, read_solid, write_casting
from softfuse.design.mould import MouldShape, mould
from softfuse.design.port import Port
from softfuse.errors import MeshError, SoftfuseError
from softfuse.mesh.files import read_surface

SHAPE = MouldShape(0.008, 0.002, 0.004, 0.0001, 0.0001, (-0.03, 0.03), 0.003, (0.03, -0.03), 0.001)


def test_files_are_the_solids_when_read_back(pad_cast, tmp_path) -> None:
    parts = mould(pad_cast, SHAPE)
    files = write_casting(tmp_path / "cast", pad_cast, parts)
    names = ["body", "body_with_ports", *(f"core_{k}" for k in range(4)), "mould_lower", "mould_upper"]
    assert [file.name for file in files] == [f"{name}.stl" for name in names]
    for file, solid in zip(files, named_solids(pad_cast, parts).values(), strict=True):
        read = read_solid(file)
        assert read.volume() == pytest.approx(solid.volume(), rel=1e-6)
        np.testing.assert_allclose(read.bounding_box(), solid.bounding_box(), atol=1e-8)


def test_a_file_is_in_millimetres_and_closed_for_others(pad_cast, tmp_path) -> None:
    files = write_casting(tmp_path, pad_cast)
    core = read_surface(files[2], scale=1e-3)
    np.testing.assert_allclose(np.ptp(core.nodes, axis=0), [0.043, 0.028, 0.006], atol=2e-5)
    (count,) = np.frombuffer(files[2].read_bytes()[80:84], "<u4")
    assert len(files[2].read_bytes()) == 84 + 50 * count


def test_the_same_layout_makes_the_same_bytes(pad, pad_cast, tmp_path) -> None:
    ports = [Port(rod.cavity, rod.side, rod.radius) for rod in pad_cast.rods]
    again = casting(pad, pad.start, ports, beyond=0.006, wall=0.002, chord=20e-6)
    first = write_casting(tmp_path / "a", pad_cast, mould(pad_cast, SHAPE))
    second = write_casting(tmp_path / "b", again, mould(again, SHAPE))
    assert [a.read_bytes() for a in first] == [b.read_bytes() for b in second]


def test_names_become_names_of_files(pad_cast, tmp_path) -> None:
    named = replace(pad_cast, names=("front left", "front/right", "back_left", "../back"))
    solids = list(named_solids(named))
    assert solids[2:] == ["core_front-left", "core_front-right", "core_back_left", "core_---back"]
    with pytest.raises(SoftfuseError, match="rename 'Left 1'"):
        named_solids(replace(pad_cast, names=("left-1", "Left 1", "a", "b")))


def test_a_folder_that_cannot_be_made_and_a_file_that_lacks_a_triangle_are_refused(
    pad_cast, tmp_path
) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(MeshError, match="cannot be written"):
        write_casting(tmp_path / "file", pad_cast)
    path = write_casting(tmp_path, pad_cast)[2]
    data = bytearray(path.read_bytes()[:-50])
    data[80:84] = (int.from_bytes(data[80:84], "little") - 1).to_bytes(4, "little")
    path.write_bytes(bytes(data))
    with pytest.raises(MeshError, match="do not close a solid"):
        read_solid(path)
