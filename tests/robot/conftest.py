"""Variants of robots of configs/, in files of their own."""

from collections.abc import Callable
from pathlib import Path

import pytest

CONFIGS = Path(__file__).parents[2] / "configs"

Write = Callable[..., Path]


def writer(text: str, path: Path) -> Write:
    """Writes a text to a file with pieces of it replaced: write((old, new), ...)."""

    def write(*replacements: tuple[str, str]) -> Path:
        edited = text
        for old, new in replacements:
            assert edited.count(old) == 1, f"{old!r} stands {edited.count(old)} times in the configuration"
            edited = edited.replace(old, new)
        path.write_text(edited, encoding="utf-8")
        return path

    return write


@pytest.fixture
def pad_text() -> str:
    """The text of configs/pad.toml."""
    return (CONFIGS / "pad.toml").read_text(encoding="utf-8")


@pytest.fixture
def finger_text() -> str:
    """The text of configs/finger.toml."""
    return (CONFIGS / "finger.toml").read_text(encoding="utf-8")


@pytest.fixture
def write(tmp_path: Path, pad_text: str) -> Write:
    """Writes configs/pad.toml with pieces of its text replaced: write((old, new), ...)."""
    return writer(pad_text, tmp_path / "robot.toml")


@pytest.fixture
def write_finger(tmp_path: Path, finger_text: str) -> Write:
    """Writes configs/finger.toml with pieces of its text replaced: write_finger((old, new), ...)."""
    return writer(finger_text, tmp_path / "finger.toml")
