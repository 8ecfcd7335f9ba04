"""Folders of results that a command continues when it is run again: whose results they hold, and files that
appear when they are whole.
"""

import json
import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

from softfuse.errors import SoftfuseError


def claim(
    folder: Path,
    mark: str,
    what: str,
    identity: Mapping[str, str],
    *,
    about: Mapping[str, Any] | None = None,
    parts: str,
) -> dict[str, str]:
    """Make the folder of `what`, such as "a sweep", or find the same in it: its identity with the version.

    mark: name of the file that tells whose it is; identity: what must be the same besides the version of
    softfuse; about: what the file says besides; parts: pattern of the results' files. Raises SoftfuseError
    when there are results of something else in it, or it cannot be written.
    """
    file, whole = folder / mark, {"softfuse": version("softfuse"), **identity}
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        if file.exists():
            _check(file, what, whole)
        elif any(folder.glob(parts)):
            raise SoftfuseError(f"{folder} holds parts of {what} without {mark}: give another folder")
        else:
            text = json.dumps({**whole, **(about or {})}, indent=2, ensure_ascii=False)
            with put_in_place(file) as part:
                part.write_text(text + "\n", encoding="utf-8")
    return whole


def _check(file: Path, what: str, identity: Mapping[str, str]) -> None:
    try:
        found = json.loads(file.read_bytes())
        there = {key: str(found[key]) for key in identity}
    except (ValueError, KeyError, TypeError) as error:
        raise SoftfuseError(f"{file} does not tell of {what}: give another folder") from error
    other = [key for key in identity if there[key] != identity[key]]
    if not other:
        return
    different = [key for key in other if key != "softfuse"]
    if different:
        by = f"another {different[0]}"
    else:
        by = f"softfuse {there['softfuse']}, this is {identity['softfuse']}"
    raise SoftfuseError(f"{file.parent} holds {what} by {by}: give another folder")


@contextmanager
def put_in_place(target: Path) -> Iterator[Path]:
    """A file to be written, which gets its name when it is whole."""
    with tempfile.TemporaryDirectory(dir=target.parent, prefix=".softfuse-") as folder:
        part = Path(folder) / target.name
        yield part
        os.replace(part, target)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Say that the path cannot be written where that is so: raises SoftfuseError."""
    try:
        yield
    except OSError as error:
        raise SoftfuseError(f"cannot write to {path}: {error.strerror or error}") from error
