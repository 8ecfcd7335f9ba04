"""The pad of configs/pad.toml on other meshes."""

from pathlib import Path

from softfuse.robot.file import RobotSettings, parse

CONFIG = Path(__file__).parents[1] / "configs" / "pad.toml"


def pad_on(surface_size: str, base_size: str, fine_depth: str) -> RobotSettings:
    """The pad's config with other values of these keys of [body.source]."""
    text = CONFIG.read_text()
    for key, value in (("surface_size", surface_size), ("base_size", base_size), ("fine_depth", fine_depth)):
        start = text.index(f"{key} = ") + len(f"{key} = ")
        end = text.index('"', start + 1) + 1
        text = f'{text[:start]}"{value}"{text[end:]}'
    return parse(text, CONFIG)
