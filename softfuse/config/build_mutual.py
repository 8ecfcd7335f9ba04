"""From settings to the measurement model of a grid of mutual capacitances."""

import jax.numpy as jnp
import numpy as np

from softfuse.config.build_sensors import flow_sensor
from softfuse.config.contact import DiscSettings
from softfuse.robot.settings import RobotSettings
from softfuse.config.mutual import MutualSettings
from softfuse.errors import ConfigError
from softfuse.functional.chart import FlatChart
from softfuse.sensors.capacitive import capacitive_array
from softfuse.sensors.mutual import MutualGrid
from softfuse.sensors.mutual_fit import splitting
from softfuse.sensors.mutual_model import mutual_model
from softfuse.sensors.mutual_senses import MutualSenses
from softfuse.sensors.touch_tracks import touch_follower


def build_mutual_senses(config: RobotSettings) -> MutualSenses:
    """The flow sensors and the grid; raises ConfigError when the device has others, or no discs press."""
    if config.sensors is None:
        raise ConfigError(f"{config.path}: sensors: missing, needed to estimate from a recording")
    if not isinstance(config.contact, DiscSettings):
        raise ConfigError(f'{config.path}: contact.model: a grid finds "punch" or "uniform" discs')
    area = config.contact.workspace
    return MutualSenses(
        flow_sensor(config.sensors.flow),
        mutual_grid(config.sensors.mutual),
        jnp.stack([jnp.asarray(area.x), jnp.asarray(area.y)], axis=1),
        FlatChart.along(np.array(config.contact.direction)),
        contacts=config.contact.max_contacts,
    )


def mutual_grid(settings: MutualSettings) -> MutualGrid:
    """The grid, what touches it, and how its baseline and its touches are followed."""
    shape, rule, touch = settings.shape, settings.splitting, settings.touch
    return MutualGrid(
        array=capacitive_array(
            noise_counts=settings.noise_counts,
            lowest_counts=settings.lowest_counts,
            highest_counts=settings.highest_counts,
            stuck_frames=settings.stuck_frames,
            baseline_time_s=settings.baseline.time,
            creep_time_s=settings.baseline.creep_time,
            # Signals of both signs are physical here.
            negative_sigma=np.inf,
        ),
        model=mutual_model(
            jnp.asarray(settings.column_x),
            jnp.asarray(settings.row_y),
            contact_counts=shape.contact_counts,
            electrode_width_m=shape.electrode_width,
            depth_m=shape.depth,
            finger_radius_m=shape.finger_radius,
            gain=None if shape.gain is None else np.reshape(shape.gain, (4, 4)).T,
            shield_sigma=shape.shield_sigma,
            noise_counts=settings.noise_counts,
            crosstalk=shape.crosstalk,
            common_error=shape.common_error,
            model_error=shape.model_error,
        ),
        splitting=splitting(
            worth_sigma=rule.worth_sigma,
            apart_pitches=rule.apart_pitches,
            weakest=rule.weakest,
            faintest=rule.faintest,
            lift_sigma=rule.lift_sigma,
            slide_sigma=rule.slide_sigma,
            wander_m=rule.wander,
        ),
        follower=touch_follower(
            contact_on=touch.contact_on,
            coupling_on=touch.coupling_on,
            coupling_off=touch.coupling_off,
            faint=touch.faint,
            firm_on=touch.firm_on,
            firm_off=touch.firm_off,
            gate_m=touch.gate,
            memory_s=touch.memory,
            longest_touch_s=touch.longest_touch,
            on_frames=touch.on_frames,
            off_frames=touch.off_frames,
        ),
        near_sigma=jnp.asarray(touch.near_sigma),
        touches=settings.touches,
    )
