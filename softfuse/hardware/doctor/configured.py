"""What is found out about a robot's configuration."""

from pathlib import Path

from softfuse.errors import ConfigError
from softfuse.hardware.doctor.finding import Finding
from softfuse.robot.file import load
from softfuse.robot.settings import RobotSettings


def check_config(config: Path) -> tuple[RobotSettings | None, list[Finding]]:
    """The settings in a file, None where they are wrong, and what is to be said of them."""
    try:
        settings = load(config)
    except ConfigError as error:
        lines = str(error).split("\n")
        return None, [
            Finding(str(config), "problem", line.removeprefix(f"{config}: "), "correct the file, or its name")
            for line in lines
        ]
    if not settings.sensors:
        return settings, [Finding(str(config), "note", "it has no [sensors]", "add them for live estimates")]
    heard = "" if settings.sources else "; it has no [[source]], --port listens to a device"
    return settings, [Finding(str(config), "ok", f"{settings.robot.name}{heard}")]
