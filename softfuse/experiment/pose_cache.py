"""Arrays that take long to compute, kept in a folder: one npz file for each set of settings.

A file's name holds a digest of the settings, of the code's revision and of the package's version, so that
what is found was made by the same from the same. A file that cannot be read is made anew; a folder that
cannot be written is done without.
"""

import hashlib
import importlib.metadata
import logging
import zipfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from softfuse.estimation.batch import shared_out
from softfuse.io.result_folder import put_in_place

log = logging.getLogger(__name__)

REVISION = 2
"""To be raised when other arrays come of the same settings."""

Arrays = Mapping[str, np.ndarray]


def settings_digest(*settings: object) -> str:
    """A name for settings whose representations say all about them, such as dataclasses of numbers."""
    said = repr((importlib.metadata.version("softfuse"), REVISION, settings))
    return hashlib.sha256(said.encode()).hexdigest()[:24]


def kept(
    folder: Path | None,
    files: Sequence[str],
    names: frozenset[str],
    start: Callable[[], Callable[[int], Arrays]],
) -> list[Arrays]:
    """The arrays `names` of each of some files in the folder, those that are not there computed and kept;
    without a folder, computed.

    `start` is called when something must be computed, and gives what computes the arrays of the k-th file; it
    is shared out over the cores, and each file is written when it is computed.
    """
    paths = [None if folder is None else folder / f"{file}.npz" for file in files]
    found = [None if path is None else _read(path, names) for path in paths]
    missing = [k for k, arrays in enumerate(found) if arrays is None]
    if missing:
        compute = start()

        def make(k: int) -> Arrays:
            arrays, path = compute(k), paths[k]
            if path is not None:
                _write(path, arrays)
            return arrays

        for k, arrays in zip(missing, shared_out(make, missing), strict=True):
            found[k] = arrays
    return [arrays for arrays in found if arrays is not None]


def _read(path: Path, names: frozenset[str]) -> Arrays | None:
    try:
        with np.load(path, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
    except FileNotFoundError:
        return None
    except (OSError, ValueError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        log.warning("%s cannot be read and is made anew: %s", path, error)
        return None
    if set(arrays) != names:
        log.warning("%s does not hold what it should and is made anew", path)
        return None
    return arrays


def _write(path: Path, arrays: Arrays) -> None:
    """Under another name first: another process must not find half a file."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with put_in_place(path) as part, part.open("wb") as stream:
            np.savez(stream, **dict(arrays), allow_pickle=False)
    except OSError as error:
        log.warning("%s cannot be kept: %s", path, error.strerror or error)
