"""A virtual finger pushed again and again: what its channels say; motion as in `finger_motion`.

Noiseless, in the units of the channels: pressures [V] of an MPX5100A on its nominal supply, electrodes
[counts], shortening of the cable [mm]; what parts add is in `finger_channels`. Truth columns are those of
`finger_bed`.
"""

from collections.abc import Sequence

import numpy as np

from softfuse.experiment.finger_bed import truth_columns
from softfuse.experiment.finger_electronics import Electronics, nearness
from softfuse.experiment.finger_motion import Motion
from softfuse.experiment.programme import Programme
from softfuse.sensors.electronics import ChannelElectronics, equal_channels, side_by_side

CABLE_STEP_MM = 1e-3
"""Step in which the cable's shortening is told [mm]."""

_DRIFT_TIME_S = 600.0
"""How long a pressure's zero drifts one way: it wanders by drift times this [s]."""


def finger_programme(
    moved: Motion,
    electronics: Electronics,
    radius: float,
    half: float,
    channels: Sequence[str],
    electrodes: Sequence[int],
) -> Programme:
    """What the sensors say along a motion, which ends as it begins.

    radius, half: of the tips, their half length, in m. channels: names of the pressures (k), of the
    electrodes and of the cable; electrodes: for each of them its number on the virtual finger.
    """
    poses = moved.poses
    absolute = electronics.atmosphere_Pa + poses.gauge
    volts = electronics.supply_V * (0.009e-3 * absolute - 0.095)
    near = nearness(poses, radius, half, electronics.reach_m)
    counts = electronics.baseline_counts + electronics.contact_counts * near
    truth = {name: np.asarray(values, float) for name, (_, values) in truth_columns(moved).items()}
    stepped = {name for name in truth if name in ("press", "sample") or name.endswith("_electrode")}
    readings = np.concatenate([volts, counts[:, list(electrodes)], 1e3 * poses.cable[:, None]], axis=1)
    # The last frame is at rest like the first, which follows it.
    return Programme(
        float(moved.time[1] - moved.time[0]),
        tuple(channels),
        readings[:-1],
        {name: values[:-1] for name, values in truth.items()},
        frozenset(stepped),
    )


def finger_channels(
    electronics: Electronics, pressures: int, electrodes: int, seed: int
) -> ChannelElectronics:
    """The channels of so many pressures, then of so many electrodes, then of a cable; parts drawn from a
    seed.
    """
    rng = np.random.default_rng(np.random.SeedSequence([seed, 0]))
    step = electronics.adc_V / 2**electronics.adc_bits
    per_pascal = 0.009e-3 * electronics.supply_V
    pressure = equal_channels(
        pressures,
        gain=1.0 + rng.normal(0.0, electronics.gain_sigma, pressures),
        zero=rng.uniform(-electronics.zero_bound_V, electronics.zero_bound_V, pressures),
        slow_sigma=per_pascal * electronics.drift_sigma_Pa_s * _DRIFT_TIME_S,
        slow_time=_DRIFT_TIME_S,
        noise=electronics.pressure_noise_V,
        step=step,
        low=0.0,
        high=step * (2**electronics.adc_bits - 1),
    )
    spread = electronics.contact_bound_counts / electronics.contact_counts
    bound = electronics.baseline_bound_counts
    electrode = equal_channels(
        electrodes,
        nothing=electronics.baseline_counts,
        gain=1.0 + rng.uniform(-spread, spread, electrodes),
        zero=rng.uniform(-bound, bound, electrodes),
        noise=electronics.electrode_noise_counts,
        step=1.0,
        low=0.0,
        high=float(electronics.highest_counts),
    )
    cable = equal_channels(1, noise=1e3 * electronics.cable_noise_m, step=CABLE_STEP_MM, low=-1e3, high=1e3)
    return side_by_side([pressure, electrode, cable])
