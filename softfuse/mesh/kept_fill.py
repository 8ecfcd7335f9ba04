"""Fills of surfaces, kept so that the same surface gives the same mesh.

fTetWild inserts the triangles of a surface in an order that it shuffles by a number from the hardware, with
no way to give it a seed: each fill of one surface has other nodes. (With that number fixed from outside its
results are the same bit for bit, on one thread and on several.) So the first fill of a surface with some
settings is kept in the user's cache folder, by a digest of all that went into it, and every later one is it:
meshing, simulating, estimating and reduced models of one configuration share a mesh. On another machine, or
with an empty cache, it is another one: `softfuse mesh` writes it to a file, which can be a body's source.
"""

import contextlib
import hashlib
import importlib.metadata
import logging
import os
import tempfile
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import platformdirs
from jaxtyping import Float, Int

log = logging.getLogger(__name__)

Fill = tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "m 4"]]
"""Nodes (n, 3) m and tetrahedra (m, 4)."""


def kept_fill(make: Callable[[], Fill], *of: np.ndarray | float) -> Fill:
    """What `make` gave when it was first called with arrays and numbers of these values, here or before.

    A folder that cannot be written is done without.
    """
    said = hashlib.sha256(importlib.metadata.version("pytetwild").encode())
    for each in of:
        array = np.ascontiguousarray(each)
        said.update(f"{array.dtype.str}{array.shape}".encode() + array.tobytes())
    path = platformdirs.user_cache_path("softfuse") / "fills" / f"{said.hexdigest()[:32]}.npz"
    found = _read(path)
    if found is None:
        found = _keep(path, make())
    return found


def _read(path: Path) -> Fill | None:
    try:
        with np.load(path, allow_pickle=False) as stored:
            return stored["nodes"], stored["tets"]
    except OSError:
        return None
    except (ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        log.warning("%s cannot be read and is made anew: %s", path, error)
        with contextlib.suppress(OSError):
            path.unlink()
        return None


def _keep(path: Path, made: Fill) -> Fill:
    """Write a fill unless another process was faster; the one that is in the folder now."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=".softfuse-") as folder:
            part = Path(folder) / path.name
            np.savez_compressed(part, nodes=made[0], tets=made[1])
            os.link(part, path)
    except FileExistsError:
        return _read(path) or made
    except OSError as error:
        log.info("the fill of a surface is not kept in %s: %s", path, error.strerror or error)
    return made
