"""Files hold the solids, in millimetres, to the byte the same each time."""

from dataclasses import replace

import numpy as np
import pytest

from softfuse.design.casting import casting
from softfuse.design.casting_files import named_solids, read_solid, solid_shell, write_casting
from softfuse.design.mould import MouldShape, mould
from softfuse.design.port import Port
from softfuse.errors import MeshError, SoftfuseError
from softfuse.mesh.files import read_surface
from softfuse.mesh.surface import winding_number

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


def test_surfaces_do_not_pass_through_themselves(pad_cast) -> None:
    parts = mould(pad_cast, SHAPE)
    random = np.random.default_rng(0)
    for solid in (pad_cast.cores[0], parts.lower, parts.upper):
        shell = solid_shell(solid)
        low, high = np.reshape(solid.bounding_box(), (2, 3))
        anywhere = low + (high - low) * random.random((300, 3))
        a, b, c = (shell.nodes[shell.faces[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        some = random.choice(len(a), 300)
        middles, out = ((a + b + c) / 3.0)[some], 2e-7 * normals[some]
        turns = [
            winding_number(p, shell.nodes, shell.faces) for p in (middles - out, middles + out, anywhere)
        ]
        # Once around what is inside, never around what is outside: no part of it is covered twice.
        np.testing.assert_allclose(turns[0], 1.0, atol=1e-6)
        np.testing.assert_allclose(turns[1], 0.0, atol=1e-6)
        np.testing.assert_allclose(turns[2], np.clip(np.round(turns[2]), 0.0, 1.0), atol=1e-6)


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
