"""Variants of the pad's configuration, in files of their own."""

from collections.abc import Callable
from pathlib import Path

import pytest

PAD = Path(__file__).parents[2] / "configs" / "pad.toml"

Write = Callable[..., Path]


@pytest.fixture
def pad_text() -> str:
    """The text of configs/pad.toml."""
    return PAD.read_text(encoding="utf-8")


@pytest.fixture
def write(tmp_path: Path, pad_text: str) -> Write:
    """Writes configs/pad.toml with pieces of its text replaced: write((old, new), ...)."""

    def writer(*replacements: tuple[str, str]) -> Path:
        text = pad_text
        for old, new in replacements:
            assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times in pad.toml"
            text = text.replace(old, new)
        path = tmp_path / "device.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return writer
