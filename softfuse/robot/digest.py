"""What tells two settings apart: a hash of what they say and of the files that they name."""

import hashlib
import json
from pathlib import Path
from typing import Any

from softfuse.io.settings import FileSettings


def digest(settings: FileSettings, parts: set[str] | None = None) -> str:
    """SHA-256 of validated settings, or only of some parts, in hexadecimal: comments, units and places of
    files do not matter, the contents of files do.

    Raises OSError when a file has gone since.
    """
    text = json.dumps(settings.model_dump(mode="python", include=parts), sort_keys=True, default=_contents)
    return hashlib.sha256(text.encode()).hexdigest()


def _contents(value: Any) -> str:
    if isinstance(value, Path):
        return hashlib.sha256(value.read_bytes()).hexdigest()
    raise TypeError(f"{type(value)} is no setting")
