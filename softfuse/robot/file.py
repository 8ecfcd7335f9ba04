"""Configuration files: TOML in, validated settings out, and edited copies with comments and units kept."""

import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import tomlkit
import tomlkit.exceptions
from pydantic import ValidationError
from tomlkit.items import InlineTable

from softfuse.errors import ConfigError
from softfuse.io.problems import key_path, problem_lines
from softfuse.io.settings import FileSettings
from softfuse.robot.settings import RobotSettings

TopTable = TypeVar("TopTable", bound=FileSettings)

Key = tuple[str | int, ...]
"""Where a value is: ("body", "material", 0, "young")."""

Edits = Mapping[Key, str | float | list[str] | list[float] | dict[str, float] | None]
"""New values by key, such as "0.55 MPa"; None takes the key away, a dictionary is a table on one line."""


def load(path: str | Path) -> RobotSettings:
    """The configuration in a TOML file, all quantities in SI.

    Raises ConfigError, one line for each mistake with the file and the key's path, when the file is missing
    or no TOML, a key is missing or unknown, a value has the wrong unit or is impossible, or a file that it
    names does not exist.
    """
    return parse(file_text(Path(path)), Path(path))


def parse(text: str, path: Path) -> RobotSettings:
    """The configuration in a TOML text; relative files start in the folder of path, which messages name.

    Raises ConfigError as `load` does.
    """
    return validated(text, path, RobotSettings)


def validated(text: str, path: Path, model: type[TopTable]) -> TopTable:
    """The settings of a kind in a TOML text; relative files start in the folder of path, which messages name.

    Raises ConfigError as `load` does.
    """
    try:
        raw = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: not valid TOML: {error}") from error
    try:
        return model.model_validate(raw, context={"folder": path.parent, "path": path})
    except ValidationError as error:
        lines = problem_lines(error, raw, model)
        raise ConfigError("\n".join(f"{path}: {line}" for line in lines)) from error


def save_edited(source: str | Path, target: str | Path, edits: Edits) -> RobotSettings:
    """Write a copy of a configuration with some values changed, comments and layout kept, and return it.

    Keys that the source has not are added, with the tables that they are in. Relative files are rewritten to
    be found from the target's folder; those of edits start there. Raises ConfigError when an edited table of
    a list is not in the source, the result is not valid (nothing is written then), or the target cannot be
    written.
    """
    source, target = Path(source), Path(target)
    load(source)
    document = moved(source, target)
    for place, value in edits.items():
        edit(document, place, value, source)
    return saved(tomlkit.dumps(document), target)


def moved(source: Path, target: Path) -> Any:
    """The document of a configuration, to be changed, whose relative files are found from the folder of
    target.
    """
    document: Any = tomlkit.parse(file_text(source))
    body, estimator = document["body"]["source"], document.get("estimator", {})
    for table, key in ((body, "file"), (estimator, "reading_spread")):
        if key in table:
            table[key] = _moved_file(table[key], source.parent, target.parent)
    for chamber in document.get("chamber", []):
        if "file" in chamber:
            chamber["file"] = _moved_file(chamber["file"], source.parent, target.parent)
    if "inserts" in body:
        body["inserts"] = [_moved_file(name, source.parent, target.parent) for name in body["inserts"]]
    return document


def saved(text: str, target: Path) -> RobotSettings:
    """Write the TOML text of a configuration to a file and return it.

    Raises ConfigError when it is not valid (nothing is written then), or the file cannot be written.
    """
    config = parse(text, target)
    try:
        target.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{target} cannot be written: {error.strerror}") from error
    return config


def file_text(path: Path) -> str:
    """The text of a file; raises ConfigError, which names it, when it cannot be read or is not UTF-8."""
    try:
        return path.read_bytes().decode("utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: not valid TOML: it is not UTF-8 text") from error


def edit(document: Any, key: Key, value: object, source: Path) -> None:
    """Change a value of a document that came from `source`, None to take the key away; tables that it lacks
    are added. Raises ConfigError when a table of a list is not there.
    """
    table = document
    try:
        for part in key[:-1]:
            if isinstance(part, str) and part not in table:
                table[part] = tomlkit.table()
            table = table[part]
        if value is None:
            table.remove(key[-1])
        else:
            table[key[-1]] = _on_one_line(value) if isinstance(value, dict) else value
    except (tomlkit.exceptions.NonExistentKey, IndexError, TypeError, AttributeError) as error:
        raise ConfigError(f"{source}: {key_path(key)}: there is no such key to change") from error


def _on_one_line(values: dict[str, float]) -> InlineTable:
    table = tomlkit.inline_table()
    table.update(values)
    return table


def _moved_file(name: str, old: Path, new: Path) -> str:
    path = Path(name).expanduser()
    return name if path.is_absolute() else Path(os.path.relpath(old / path, new)).as_posix()
