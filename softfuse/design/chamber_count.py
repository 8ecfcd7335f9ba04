"""The chambers of a robot that gets those of a plan, perhaps others in number, and its sensors on them."""

from softfuse.design.plan import DesignPlan
from softfuse.errors import ConfigError
from softfuse.robot.file import Edits, Key
from softfuse.robot.settings import RobotSettings
from softfuse.sensors.transfer import PartSettings

OWN = ("name", "centre", "shift", "growth")
"""What a plan's chamber has of its own: how one was made differs from its drawing."""

_CHANNELS = {"volume": "V", "pressure": "pressure V"}
"""How the name of a channel ends that tells such a quantity of a chamber."""


def with_chambers(plan: DesignPlan, config: RobotSettings) -> RobotSettings:
    """The robot with the chambers of a plan, and its sensors on them; raises ConfigError as `kept_chambers`
    and `channel_edits` do.
    """
    sensors = list(config.sensors)
    for (_, k, name), value in channel_edits(plan, config).items():
        assert isinstance(k, int) and isinstance(name, str) and isinstance(value, list)  # of a sensor
        sensors[k] = sensors[k].model_copy(update={name: tuple(value)})
    none = (0.0, 0.0, 0.0)
    chambers = tuple(
        config.chambers[k].model_copy(
            update={"name": cavity.name, "centre": tuple(cavity.centre), "shift": none, "growth": none}
        )
        for k, cavity in zip(kept_chambers(plan, config), plan.cavities, strict=True)
    )
    return config.model_copy(update={"chambers": chambers, "sensors": tuple(sensors)})


def kept_chambers(plan: DesignPlan, config: RobotSettings) -> list[int]:
    """Of each chamber of a plan the number of the robot's whose gas and all else it has: its own where there
    are as many, else that of all.

    Raises ConfigError when there are none, or others in number that differ from each other.
    """
    count = len(plan.cavities)
    if not config.chambers:
        raise ConfigError(f"{config.path}: chamber: missing: a design changes the chambers that there are")
    if count == len(config.chambers):
        return list(range(count))
    first, *others = (each.model_dump(exclude=set(OWN)) for each in config.chambers)
    for key, value in first.items():
        if any(other[key] != value for other in others):
            raise ConfigError(
                f"{plan.path}: cavity: {count} of them, but {config.path} has {len(config.chambers)} "
                f"chambers that differ in {key}: give all the same, or draw as many"
            )
    return [0] * count


def channel_edits(plan: DesignPlan, config: RobotSettings) -> Edits:
    """The edits of a config that put its flow and pressure sensors on the chambers of a plan. Where these are
    others in number, a sensor has to be on all: each has its own channel as far as there are some, then one
    named after the chamber.

    Raises ConfigError when a sensor has something for each chamber that the plan's cannot have.
    """
    names, before = ([each.name for each in chambers] for chambers in (plan.cavities, config.chambers))
    edits: dict[Key, list[str]] = {}
    for sensor in config.sensors_of(PartSettings):
        k = config.sensors.index(sensor)
        if len(names) == len(before):
            edits["sensor", k, "chambers"] = [names[before.index(name)] for name in sensor.chambers]
            continue
        if len(sensor.gain) > 1 or sorted(sensor.chambers) != sorted(before):
            what = f"{len(sensor.gain)} values of gain" if len(sensor.gain) > 1 else "only some chambers"
            raise ConfigError(
                f"{plan.path}: cavity: {len(names)} of them, but sensor[{k}] of {config.path} has {what}: "
                "give it one for all, or draw as many cavities"
            )
        end, own = _CHANNELS[sensor.quantity], list(sensor.channels[: len(names)])
        edits["sensor", k, "chambers"] = names
        edits["sensor", k, "channels"] = own + [f"{name} {end}" for name in names[len(own) :]]
    return edits
