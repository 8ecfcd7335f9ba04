"""A virtual pad touched again and again: force over time, and what its channels say.

Each touch: the punch waits, goes over the place, comes down, presses to each force and holds it, releases and
goes up again. All ramps are s(τ) = τ² (3 − 2τ) of the elapsed share τ of their time, so that no flow jumps.
In between the equilibria of `PadTouches` values are monotone cubics of the force, and of the gap in air
(Fritsch and Carlson, SIAM J. Numer. Anal. 17 (1980) 238). Quasi-static: flows are

    Q_k = −dV_k/dt = −(dV_k/dF) dF/dt,      volts = zero + sensitivity · Q_k,

and counts are those that `electrode_electronics` make of what the electrodes say. Truth, for evaluation only:

| column | what |
|---|---|
| `press` | number of the touch, from 0 |
| `sample` | 1, 2 ... at one row in the middle of the first, second ... hold, else 0 |
| `true_x_mm`, `true_y_mm` | middle of the punch |
| `true_force_N` | its force |
| `true_depth_mm` | how far it is below the surface at rest; negative in the air |
| `true_dV{k}_mm3` | change of the cavities' volumes |
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator

from softfuse.experiment.pad_electronics import PadElectronics
from softfuse.experiment.pad_touches import PadTouches
from softfuse.experiment.programme import Programme


@dataclass(frozen=True)
class PadTiming:
    """Rows per second; seconds of waiting, of going over the next place, and of holding a force; speeds of
    the ramps, on average over each, in N/s up and down and in m/s through the air.
    """

    rate_Hz: float = 100.0
    wait_s: float = 2.0
    travel_s: float = 1.0
    hold_s: float = 1.0
    press_N_s: float = 6.0
    release_N_s: float = 4.0
    air_m_s: float = 20e-3


@dataclass(frozen=True, eq=False)
class _Rows:
    """n rows: touch (n,), the share (n,) of the way to the next place, gap (n,) m, force (n,) N and its rate
    (n,) N/s, number (n,) of the force held in the middle of its hold.
    """

    touch: np.ndarray
    moved: np.ndarray
    gap: np.ndarray
    force: np.ndarray
    rate: np.ndarray
    sample: np.ndarray


def pad_programme(
    touches: PadTouches,
    timing: PadTiming,
    electronics: PadElectronics,
    flow_channels: tuple[str, ...],
    electrode_channels: tuple[str, ...],
) -> Programme:
    """What flow sensors (k) and electrodes (e) say during the touches; channels in this order."""
    rows = _rows(touches, timing)
    count, cavities = len(rows.touch), touches.volume.shape[2]
    volume, slope, depth = np.zeros((count, cavities)), np.zeros((count, cavities)), -rows.gap
    signal = np.zeros((count, touches.near.shape[2]))
    for t in range(len(touches.at)):
        here = rows.touch == t
        pressed, air = here & (rows.gap == 0.0), here & (rows.gap > 0.0)
        force, gap = rows.force[pressed], rows.gap[air]
        volumes = PchipInterpolator(touches.force[t], touches.volume[t])
        volume[pressed], slope[pressed] = volumes(force), volumes.derivative()(force)
        depth[pressed] = PchipInterpolator(touches.force[t], touches.depth[t])(force)
        signal[pressed] = PchipInterpolator(touches.force[t], touches.pressed[t])(force)
        following = (t + 1) % len(touches.at)
        on_way = rows.moved[air, None]
        signal[air] = (1.0 - on_way) * PchipInterpolator(touches.gap, touches.near[t])(gap)
        signal[air] += on_way * PchipInterpolator(touches.gap, touches.near[following])(gap)
    flow = -slope * rows.rate[:, None]
    following = touches.at[(rows.touch + 1) % len(touches.at)]
    place = touches.at[rows.touch] + rows.moved[:, None] * (following - touches.at[rows.touch])
    truth = {
        "press": rows.touch,
        "sample": rows.sample,
        "true_x_mm": 1e3 * place[:, 0],
        "true_y_mm": 1e3 * place[:, 1],
        "true_force_N": rows.force,
        "true_depth_mm": 1e3 * depth,
        **{f"true_dV{k}_mm3": 1e9 * volume[:, k] for k in range(cavities)},
    }
    return Programme(
        1.0 / timing.rate_Hz,
        (*flow_channels, *electrode_channels),
        electronics.readings(flow, signal),
        truth,
        frozenset({"press", "sample"}),
    )


def _rows(touches: PadTouches, timing: PadTiming) -> _Rows:
    """The rows of all touches, the last of which leads over the place of the first."""
    parts: list[dict[str, np.ndarray]] = []

    def add(touch: int, seconds: float, **values: Float[np.ndarray, " n"] | float) -> None:
        count = max(2, round(seconds * timing.rate_Hz))
        row = {"touch": touch, "moved": 0.0, "gap": 0.0, "force": 0.0, "rate": 0.0, "sample": 0}
        parts.append({name: np.broadcast_to(value, (count,)) for name, value in (row | values).items()})

    def ramp(touch: int, seconds: float, name: str, start: float, end: float) -> None:
        count = max(2, round(seconds * timing.rate_Hz))
        share = np.arange(count) / count
        along, speed = share**2 * (3.0 - 2.0 * share), 6.0 * share * (1.0 - share) * timing.rate_Hz / count
        values = {name: start + (end - start) * along}
        if name == "force":
            values["rate"] = (end - start) * speed
        elif name == "moved":
            values["gap"] = np.full(count, away)
        add(touch, seconds, **values)

    away = float(touches.gap[-1])
    for t, forces in enumerate(touches.force):
        add(t, timing.wait_s, gap=away)
        ramp(t, away / timing.air_m_s, "gap", away, 0.0)
        for level, (before, force) in enumerate(zip(forces[:-1], forces[1:], strict=True), start=1):
            ramp(t, (force - before) / timing.press_N_s, "force", before, force)
            held = max(2, round(timing.hold_s * timing.rate_Hz))
            add(t, timing.hold_s, force=force, sample=np.where(np.arange(held) == held // 2, level, 0))
        ramp(t, forces[-1] / timing.release_N_s, "force", forces[-1], 0.0)
        ramp(t, away / timing.air_m_s, "gap", 0.0, away)
        ramp(t, timing.travel_s, "moved", 0.0, 1.0)
    return _Rows(**{name: np.concatenate([part[name] for part in parts]) for name in parts[0]})
