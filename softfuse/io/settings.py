"""What all tables of a configuration have in common: no unknown keys, no change, finite numbers."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, PrivateAttr, ValidationInfo

from softfuse.errors import ConfigError, MeshError
from softfuse.io.quantity import Length, Number, wrong_value


class Settings(BaseModel):
    """A table of a configuration file; quantities in SI."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class FileSettings(Settings):
    """A table that knows the file it comes from."""

    _path: Path = PrivateAttr(default=Path("config"))

    def model_post_init(self, context: Any, /) -> None:
        """Remember where the configuration comes from, for messages."""
        if context:
            self._path = context["path"]

    @property
    def path(self) -> Path:
        """The file that the configuration comes from."""
        return self._path

    @contextmanager
    def told(self, key: str) -> Iterator[None]:
        """A MeshError from within becomes a ConfigError that names the file and the key."""
        try:
            yield
        except MeshError as error:
            raise ConfigError(f"{self.path}: {key}: {error}") from error


def listed(value: Any) -> Any:
    """A value that is no list as a list of one, before it is validated."""
    return value if isinstance(value, list | tuple) else [value]


def _given(values: tuple[object, ...]) -> tuple[object, ...]:
    # pydantic's own least length also counts items that are wrong, and complains twice.
    if not values:
        raise wrong_value("the list is empty: give at least one")
    return values


def _ascending(values: tuple[float, ...]) -> tuple[float, ...]:
    if any(b <= a for a, b in zip(values[:-1], values[1:], strict=True)):
        raise wrong_value("the values must ascend")
    return values


def _not_descending(values: tuple[float, float]) -> tuple[float, float]:
    if values[1] < values[0]:
        raise wrong_value("the first value must not exceed the second")
    return values


def _with_length(direction: tuple[float, float, float]) -> tuple[float, float, float]:
    if direction == (0.0, 0.0, 0.0):
        raise wrong_value("the direction has no length; use [0, 0, -1] for downwards")
    return direction


def _existing(path: Path, info: ValidationInfo) -> Path:
    """The path seen from the folder of the configuration."""
    context: dict[str, Any] = info.context or {}
    full = context.get("folder", Path()) / path.expanduser()
    if not full.is_file():
        raise wrong_value(f"there is no file {full}; paths are relative to the folder of the configuration")
    return full


NotEmpty = AfterValidator(_given)
"""Marks a list that needs an item."""

Span = Annotated[tuple[Length, Length], AfterValidator(_not_descending)]
"""Lowest and highest value, which may be the same, in m."""

Range = Annotated[tuple[Length, Length], AfterValidator(_ascending)]
"""Lowest and highest value, in m."""

Ascending = AfterValidator(_ascending)
"""Marks a list whose values must ascend."""

Positions = Annotated[tuple[Length, ...], AfterValidator(_ascending)]
"""Ascending positions along an axis, in m."""

Vector = tuple[Length, Length, Length]
"""x, y, z in m."""

Direction = Annotated[tuple[Number, Number, Number], AfterValidator(_with_length)]
"""A vector (3,) of any length but 0."""

ExistingFile = Annotated[Path, AfterValidator(_existing)]
"""A file that exists; a relative path starts in the folder of the configuration."""
