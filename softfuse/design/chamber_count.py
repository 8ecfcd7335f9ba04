"""The sensors of a device that gets another number of cavities than it has."""

from softfuse.design.plan import DesignPlan
from softfuse.errors import ConfigError
from softfuse.robot.file import Edits
from softfuse.robot.settings import RobotSettings


def channel_edits(plan: DesignPlan, config: RobotSettings) -> Edits:
    """The edits of a config that give each cavity of a plan a channel: its own as far as there are some, then
    one named after the cavity.

    Raises ConfigError when the device has something for each cavity that the plan's cannot have.
    """
    count = len(plan.cavities)
    if count == len(config.cavities):
        return {}
    sensors = config.sensors
    sensing = None if sensors is None else sensors.vented or sensors.sealed
    lists = {
        "gas.dead_volume": () if config.gas is None else config.gas.dead_volume,
        "gain of [sensors.flow] or [sensors.pressure]": () if sensing is None else sensing.gain,
    }
    for key, values in lists.items():
        if len(values) > 1:
            raise ConfigError(
                f"{plan.path}: cavity: {count} of them, but {config.path} has {len(values)} values of {key}: "
                "give one for all there, or draw as many cavities"
            )
    if sensors is None or sensing is None:
        return {}
    names = [*sensing.channels[:count]]
    for cavity in plan.cavities[len(names) :]:
        names.append(f"{cavity.name} {'V' if sensors.vented else 'pressure V'}")
    return {("sensors", "flow" if sensors.vented else "pressure", "channels"): names}
