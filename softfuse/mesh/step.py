"""Surfaces of STEP files, the exchange format of CAD programs, through Open CASCADE (cascadio, an extra).

Curved faces are cut into triangles that are off by at most a chord of 10 µm and turn by at most 0.2 rad from
one to the next. Lengths are in metres, whatever unit the file has: it says so itself.
"""

import io
from pathlib import Path

import numpy as np

from softfuse.errors import MeshError
from softfuse.mesh.shell import Shell, checked

_CHORD_MM, _TURN_RAD = 0.01, 0.2


def read_step(path: Path) -> Shell:
    """The closed surfaces of all solids in a STEP file, in m.

    Raises MeshError when the extra is not installed, the file is damaged or holds no solid, and where
    `softfuse.mesh.shell.checked` does.
    """
    try:
        import cascadio  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise MeshError(
            f'{path}: STEP files need the extra "cad": pip install "softfuse[cad]", or export it as STL'
        ) from error
    import trimesh

    try:
        made = cascadio.to_glb_bytes(path.read_bytes(), tol_linear=_CHORD_MM, tol_angular=_TURN_RAD)
        if not made:
            raise ValueError("no shapes are found in it")
        scene = trimesh.load_scene(io.BytesIO(made), file_type="glb")
    except (RuntimeError, ValueError, OSError, LookupError) as error:
        raise MeshError(f"{path} cannot be read as STEP ({error}): export it again, or as STL") from error
    parts = [each for each in scene.dump() if isinstance(each, trimesh.Trimesh)]
    if not parts:
        raise MeshError(f"{path} holds no solid: export the body as a solid, not as curves or a sketch")
    starts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    try:
        return checked(
            np.vstack([part.vertices for part in parts]),
            np.vstack([part.faces + start for part, start in zip(parts, starts, strict=True)]),
        )
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from error
