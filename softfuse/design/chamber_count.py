"""The sensors of a robot that gets another number of chambers than it has."""

from collections.abc import Sequence

from softfuse.design.plan import DesignPlan
from softfuse.errors import ConfigError
from softfuse.robot.file import Edits, Key
from softfuse.robot.settings import RobotSettings
from softfuse.sensors.flow.sensor import FlowSettings
from softfuse.sensors.pressure.sensor import PressureSettings


def with_chambers(plan: DesignPlan, config: RobotSettings) -> RobotSettings:
    """The robot with the chambers of a plan, and its sensors on them; see `channel_edits` for the errors."""
    edits = channel_edits(plan, config)
    sensors = list(config.sensors)
    for key, value in edits.items():
        _, k, name = key
        assert isinstance(k, int) and isinstance(value, list)  # these are lists of a sensor
        sensors[k] = sensors[k].model_copy(update={name: tuple(value)})
    first = config.chambers[0]
    chambers = tuple(
        first.model_copy(
            update={
                "name": cavity.name,
                "centre": tuple(cavity.centre),
                "shift": (0.0, 0.0, 0.0),
                "growth": (0.0, 0.0, 0.0),
            }
        )
        for cavity in plan.cavities
    )
    return config.model_copy(update={"chambers": chambers, "sensors": tuple(sensors)})


def channel_edits(plan: DesignPlan, config: RobotSettings) -> Edits:
    """The edits of a config that put its flow and pressure sensors on all chambers of a plan: each has its
    own channel as far as there are some, then one named after the chamber.

    Raises ConfigError when the robot has something for each chamber that the plan's cannot have.
    """
    names = [cavity.name for cavity in plan.cavities]
    if not config.chambers:
        raise ConfigError(f"{config.path}: chamber: missing: a design changes the chambers that there are")
    edits: dict[Key, list[str]] = {}
    for k, sensor in enumerate(config.sensors):
        if not isinstance(sensor, FlowSettings | PressureSettings):
            continue
        if len(sensor.gain) > 1 and len(names) != len(sensor.chambers):
            raise ConfigError(
                f"{plan.path}: cavity: {len(names)} of them, but {config.path} has {len(sensor.gain)} values "
                f"of gain of sensor[{k}]: give one for all there, or draw as many chambers"
            )
        unit = "V" if isinstance(sensor, FlowSettings) else "pressure V"
        edits["sensor", k, "chambers"] = names
        edits["sensor", k, "channels"] = _channels(sensor.channels, names, unit)
    return edits


def _channels(channels: Sequence[str], names: Sequence[str], unit: str) -> list[str]:
    own = list(channels[: len(names)])
    return own + [f"{name} {unit}" for name in names[len(own) :]]
