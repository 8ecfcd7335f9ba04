"""From settings to the measurement model of a grid of mutual capacitances."""

import jax.numpy as jnp

from softfuse.config.contact import DiscSettings
from softfuse.config.device import DeviceConfig
from softfuse.errors import ConfigError
from softfuse.sensors.mutual_senses import MutualSenses


def build_mutual_senses(config: DeviceConfig) -> MutualSenses:
    """The flow sensors and the grid; raises ConfigError when the device has others, or no discs press."""
    if config.sensors is None:
        raise ConfigError(f"{config.path}: sensors: missing, needed to estimate from a recording")
    if not isinstance(config.contact, DiscSettings):
        raise ConfigError(f'{config.path}: contact.model: a grid finds "punch" or "uniform" discs')
    area = config.contact.workspace
    return MutualSenses(
        config.sensors.flow.filter(),
        config.sensors.mutual.grid(),
        jnp.stack([jnp.asarray(area.x), jnp.asarray(area.y)], axis=1),
        contacts=config.contact.max_contacts,
    )
