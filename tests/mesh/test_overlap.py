"""Parts of a surface that cross, touch or lie inside each other, whatever the order and winding of a file."""

import numpy as np
import pytest
import trimesh

from softfuse.errors import MeshError
from softfuse.mesh.shell import Shell, checked, shell_parts
from softfuse.mesh.surface import enclosed_volume


def box(size: float, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> trimesh.Trimesh:
    return trimesh.creation.box((size,) * 3).apply_translation(at)


def surface(*parts: trimesh.Trimesh) -> Shell:
    starts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    faces = [part.faces + start for part, start in zip(parts, starts, strict=True)]
    return checked(1e-3 * np.vstack([part.vertices for part in parts]), np.vstack(faces))


def volume(shell: Shell) -> float:
    return 1e9 * enclosed_volume(shell.nodes, shell.faces)


@pytest.mark.parametrize("turn", [False, True])
@pytest.mark.parametrize(
    ("parts", "expected", "count"),
    [
        ([box(10), box(4, (5, 0, 0))], 1032.0, 1),  # half of the boss sticks out
        ([box(10), box(4, (6.9, 0, 0))], 1064.0 - 0.1 * 16, 1),  # a corner of which alone tells nothing
        ([box(10), box(4, (7, 0, 0))], 1064.0, 1),  # touches
        ([box(10), box(4, (7.1, 0, 0))], 1064.0, 2),  # does not
        ([box(10), box(4)], 936.0, 2),
        ([box(10), box(4), box(4, (2, 0, 0))], 1000 - 96.0, 2),  # two holes that cross are one
        ([box(10), box(6), box(2)], 1000 - 216 + 8.0, 3),
        ([box(10), box(4, (5, 0, 0)), box(4, (-5, 0, 0)), box(2)], 1064 - 8.0, 2),
    ],
)
def test_the_volume_is_that_of_the_union(
    parts: list[trimesh.Trimesh], expected: float, count: int, turn: bool
) -> None:
    shell = surface(*(parts[::-1] if turn else parts))
    assert volume(shell) == pytest.approx(expected, rel=1e-6)
    assert len(shell_parts(shell)) == count


def test_what_is_joined_is_told(caplog: pytest.LogCaptureFixture) -> None:
    surface(box(10), box(4, (5, 0, 0)))
    assert "parts 0, 1 of the surface cross or touch: joined to one of 1032 mm³" in caplog.text


def test_parts_that_cannot_be_meant_are_named() -> None:
    hole = box(4, (5, 0, 0))
    hole.invert()
    with pytest.raises(
        MeshError, match=r"parts 0 \(around \[0.0, .*\] mm\) and 1 \(around \[5.0, .* as a hole"
    ):
        surface(box(10), hole)
    with pytest.raises(MeshError, match="touch, the one inside the other: leave a wall"):
        surface(box(10), box(4, (3, 0, 0)))
