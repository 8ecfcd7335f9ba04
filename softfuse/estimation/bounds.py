"""What the estimate of a robot may be: bounds of forces and actuators, and how its steps are damped."""

import jax.numpy as jnp
import numpy as np

from softfuse.estimation.estimator import StepSettings
from softfuse.estimation.limits import Limits
from softfuse.robot.robot import Robot

_KILOPASCAL = 1e3
"""Counts as a newton in the damping of pressures."""
_GAS = 1e-3
"""Of the atmosphere: counts as a newton in the damping of sealed gas."""


def limits_of(robot: Robot) -> Limits:
    """Bounds and regularisation of the forces of all contacts, then of the actuators' drives.

    Forces lie between 0 and max_force, those along tangents to either side, tensions between 0 and
    max_tension, driven pressures within their range; the gas that was sealed in stays.
    """
    settings = robot.settings
    damping = settings.estimator.regularisation
    driven = [each.bounds for each in settings.contacts for _ in range(each.at_once)]
    low, high = robot.ranges
    pushed, units = sum(len(least) for least, _ in driven), np.ones(len(low))
    for chamber in settings.chambers:
        if chamber.gas != "vented":
            unit = _GAS * settings.environment.atmosphere if chamber.gas == "sealed" else _KILOPASCAL
            units[robot.addresses.drives[chamber.name]] = unit
    lower, upper = (np.concatenate(each) for each in zip(*driven, (low, high), strict=True))
    regularisation = damping / np.append(np.ones(pushed), units) ** 2
    motion = settings.estimator.largest_motion
    lines = [each.line for each in settings.contacts if each.line]
    place = lines[0][1] if lines else None
    strokes = None
    if any(command.of_answer for command in robot.commands):
        endless = jnp.full(len(lower), jnp.inf)
        strokes = -endless, endless
    return Limits(
        jnp.asarray(lower),
        jnp.asarray(upper),
        jnp.asarray(regularisation),
        strokes=strokes,
        motion=None if motion is None else jnp.asarray(motion),
        place=None if place is None else jnp.asarray(place),
    )


def step_settings(robot: Robot) -> StepSettings:
    """How the estimate steps are run."""
    given = robot.settings.estimator
    return StepSettings(steps_per_frame=given.steps_per_frame, catch_up_steps=given.catch_up_steps)
