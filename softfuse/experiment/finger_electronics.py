"""Sensors of a virtual finger: pressures to volts, tips to counts, cable to its measured length.

* Pressure: NXP MPX5100A, V = V_s (1 + ε) (0.009 P/kPa − 0.095) + V_0, P absolute, on a 12-bit converter; part
  spread ε and V_0, a zero that drifts with the gas, white noise.
* Electrodes: counts = baseline + Σ_tips a exp(−d/ℓ) averaged over the electrode, d the distance of its points
  from the surface of a tip. The field of a strip of width w decays like that, ℓ = w/π (Laplace's
  equation between two zeros w apart). In contact d = 0 and the counts saturate at a: no force is in them.
* Cable: its shortening with white noise.

Not modelled: hysteresis, temperature steps of fast gas, electrodes that are stretched with the skin.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from softfuse.experiment.finger_pushes import Pose


@dataclass(frozen=True)
class Electronics:
    """Constants of the sensors.

    `_bound`: one value a channel, uniform in ± that; `_sigma`: one a channel, normal; noise: one a reading,
    normal. Draws follow `seed`.
    """

    atmosphere_Pa: float = 101325.0
    supply_V: float = 5.0
    zero_bound_V: float = 0.025 * 4.5
    gain_sigma: float = 0.005
    drift_sigma_Pa_s: float = 0.2
    pressure_noise_V: float = 1e-3
    adc_bits: int = 12
    adc_V: float = 5.0
    baseline_counts: float = 16000.0
    baseline_bound_counts: float = 3000.0
    contact_counts: float = 3000.0
    contact_bound_counts: float = 450.0
    reach_m: float = 12e-3 / np.pi
    electrode_noise_counts: float = 8.0
    highest_counts: int = 65535
    cable_noise_m: float = 0.05e-3
    seed: int = 2


@dataclass(frozen=True, eq=False)
class Readings:
    """Pressures (n, k) V, electrodes (n, e) counts, cable's shortening (n,) m."""

    pressure_V: Float[np.ndarray, "n k"]
    electrode: Int[np.ndarray, "n e"]
    cable: Float[np.ndarray, " n"]


def readings(
    electronics: Electronics, time: Float[np.ndarray, " n"], poses: Pose, radius: float, half: float
) -> Readings:
    """What the sensors say at times (n,) s in poses with leading axis n.

    The tips are cylinders of a radius [m] and half their length [m].
    """
    pressure, electrode, cable = map(np.random.default_rng, np.random.SeedSequence(electronics.seed).spawn(3))
    return Readings(
        pressure_V=_volts(electronics, time, poses.gauge, pressure),
        electrode=_counts(electronics, nearness(poses, radius, half, electronics.reach_m), electrode),
        cable=poses.cable + cable.normal(0.0, electronics.cable_noise_m, len(time)),
    )


def nearness(poses: Pose, radius: float, half: float, reach: float) -> Float[np.ndarray, "n e"]:
    """Signal (n, e) of electrodes, 1 where one lies wholly on a tip; radius, half length, reach ℓ in m."""
    total = np.zeros(poses.electrodes.shape[:2])
    for k in range(poses.axis.shape[1]):
        tip, axis = poses.tip[:, None, None, k], poses.axis[:, None, None, k]
        apart = poses.electrodes - tip
        along = np.sum(apart * axis, axis=-1)
        across = np.linalg.norm(apart - along[..., None] * axis, axis=-1)
        distance = np.hypot(np.maximum(across - radius, 0.0), np.maximum(np.abs(along) - half, 0.0))
        there = np.any(poses.axis[:, k] != 0, axis=-1)
        total += there[:, None] * np.exp(-distance / reach).mean(axis=-1)
    return total


def _volts(
    electronics: Electronics,
    time: Float[np.ndarray, " n"],
    gauge: Float[np.ndarray, "n k"],
    rng: np.random.Generator,
) -> Float[np.ndarray, "n k"]:
    count = gauge.shape[1]
    zero = rng.uniform(-electronics.zero_bound_V, electronics.zero_bound_V, count)
    gain = 1.0 + rng.normal(0.0, electronics.gain_sigma, count)
    drift = rng.normal(0.0, electronics.drift_sigma_Pa_s, count)
    absolute = electronics.atmosphere_Pa + gauge + time[:, None] * drift
    volts = electronics.supply_V * gain * (0.009e-3 * absolute - 0.095) + zero
    volts += rng.normal(0.0, electronics.pressure_noise_V, gauge.shape)
    codes = 2**electronics.adc_bits
    step = electronics.adc_V / codes
    return step * np.clip(np.rint(volts / step), 0, codes - 1)


def _counts(
    electronics: Electronics, near: Float[np.ndarray, "n e"], rng: np.random.Generator
) -> Int[np.ndarray, "n e"]:
    count, spread = near.shape[1], electronics.contact_bound_counts
    bound = electronics.baseline_bound_counts
    baseline = electronics.baseline_counts + rng.uniform(-bound, bound, count)
    contact = electronics.contact_counts + rng.uniform(-spread, spread, count)
    counts = baseline + contact * near + rng.normal(0.0, electronics.electrode_noise_counts, near.shape)
    return np.clip(np.rint(counts), 0, electronics.highest_counts).astype(int)
