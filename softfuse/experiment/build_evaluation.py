"""From settings to the evaluation of Navarro et al. 2020: the body of a test bed, and what is done to it.

The body is made as the config draws it, but not as the estimator's model is: its own mesh, finer than that of
configs/pad.toml and configs/finger.toml, silicone of another law, cavities (cables, necks) off their places
by some tenths of a millimetre, a stiffness off by up to a tenth (of a pad), sensors with zeros, gains and
drift of their own; a punch with a skin presses through other cells, round tips push a finger. All of that
follows one seed.
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from softfuse.config.contact import DiscSettings
from softfuse.experiment.build_virtual import build_plan
from softfuse.experiment.build_virtual_finger import FingerPlan
from softfuse.experiment.build_virtual_pad import PadPlan, within
from softfuse.experiment.finger_bed import TABLE_III
from softfuse.experiment.finger_pushes import Push, Steps, equilibria
from softfuse.experiment.virtual_finger import DRAWING, FingerErrors, FingerSettings
from softfuse.experiment.virtual_pad import PadErrors, Touch
from softfuse.robot.settings import RobotSettings

_REACH = 28 / 30
"""How far the grid reaches from the middle of the workspace to its ends: 28 mm of 30 mm."""

_FITTED_TO = ((0.0, 0.0), (-0.6, -0.6), (-0.6, 0.6), (0.6, -0.6), (0.6, 0.6))
"""Where a pad is pressed to be calibrated, from the middle of the workspace to its ends (±1)."""

_PAD_MESH = (0.125, 0.15, 0.5)
"""Longest edge at the top and largest box of the grid under it, as parts of the pad's length, and growth."""

_SKIN = 0.2e-9
"""Compliance [m/Pa] of what the punch presses through: a tenth of a millimetre of silicone."""

_STIFFNESS = 0.1
"""Bound of a pad's error of stiffness, as a part of it."""


@dataclass(frozen=True, eq=False)
class Bed:
    """A test bed: what its body is, and each thing done to it, with a name; the first `fitted_to` of them are
    for calibration. `equilibria`: how many have to be found; `seed`: of everything that is drawn; `told`:
    what makes it differ from the estimator's model, for people.
    """

    plan: PadPlan | FingerPlan
    names: tuple[str, ...]
    fitted_to: int
    equilibria: int
    seed: int
    told: dict[str, str]


def build_bed(config: RobotSettings, *, grid: int, seed: int) -> Bed:
    """The pad's presses on a grid of `grid` times `grid` places at three forces, or the finger's pushes.

    Raises ConfigError when the config is none of a pad, a layout or a finger with sensors.
    """
    plan = build_plan(config)
    if isinstance(plan, FingerPlan):
        return _finger_bed(plan, seed)
    assert isinstance(config.contact, DiscSettings)  # the plan has told
    forces, along = plan.touches[0].forces, _REACH * np.linspace(-1.0, 1.0, grid)
    at = within(config.contact, [*_FITTED_TO, *product(along, along)])
    length = max(plan.settings.drawing.size[:2])
    surface, base, growth = _PAD_MESH
    # Not from the stream of the cavities' errors.
    off = np.random.default_rng((seed, 1)).uniform(-_STIFFNESS, _STIFFNESS)
    settings = replace(
        plan.settings,
        shear_modulus=(1.0 + off) * plan.settings.shear_modulus,
        surface_size=surface * length,
        base_size=base * length,
        growth=growth,
        layer=_SKIN,
        errors=PadErrors(seed=seed),
    )
    touches = tuple(Touch((float(x), float(y)), forces) for x, y in at)
    names = [f"calibration_{k}" for k in range(len(_FITTED_TO))]
    names += [f"press_{k:03d}" for k in range(grid**2)]
    return Bed(
        replace(plan, settings=settings, touches=touches),
        tuple(names),
        len(_FITTED_TO),
        len(touches) * len(forces),
        seed,
        {
            "material": f"{settings.silicone} (Yeoh), stiffness off by {100 * off:+.1f} %",
            "cavities": f"places off by up to {1e3 * settings.errors.cavity_place:g} mm, sizes by up to "
            f"{1e3 * settings.errors.cavity_size:g} mm",
            "mesh": f"of its own, edges of {1e3 * settings.surface_size:g} mm at the top",
            "punch": f"{sum(settings.sectors)} cells of its own, a skin of {1e9 * _SKIN:g} mm/MPa under it",
            "forces": ", ".join(f"{force:g} N" for force in forces),
            "electrodes": "a field of their own, parasitics, gains, drift and noise",
            "flow sensors": "zeros, gains, wander and noise of their own, on a converter of 12 bits",
        },
    )


def _finger_bed(plan: FingerPlan, seed: int) -> Bed:
    """Table III of a finger of its length, on its last two segments."""
    drawn, usual = plan.settings, FingerSettings()
    scale = drawn.drawing.size[0] / DRAWING.size[0]
    last, most = len(drawn.segment_x) - 1, len(usual.segment_x) - 1
    pushes = tuple(
        Push(
            tuple((max(last - most + segment, 0), side) for segment, side in push.contacts),
            scale * push.cable,
            tuple(scale * depth for depth in push.depths),
        )
        for push in TABLE_III
    )
    settings = replace(
        drawn,
        wall_size=scale * usual.wall_size,
        base_size=scale * usual.base_size,
        growth=usual.growth,
        patch_points=usual.patch_points,
        errors=FingerErrors(seed=seed),
    )
    steps = Steps()
    names = tuple(f"push_{k}" for k in range(len(pushes)))
    count = sum(equilibria(push, steps) for push in pushes)
    errors = settings.errors
    told = {
        "material": f"{settings.silicone} (Yeoh)",
        "cavities": f"places off by up to {1e3 * errors.cavity_place:g} mm, sizes by up to "
        f"{1e3 * errors.cavity_size:g} mm",
        "necks, guides, anchor": f"off by up to {1e3 * errors.neck_height:g}, {1e3 * errors.guide:g} and "
        f"{1e3 * errors.anchor_radius:g} mm",
        "mesh": f"of its own, edges of {1e3 * settings.wall_size:g} mm at the cavities",
        "tips": f"rigid and round, radius {1e3 * settings.tip_radius:g} mm, without friction",
        "pressure sensors": "zeros, gains, drift and noise of their own, on a converter of 12 bits",
    }
    return Bed(replace(plan, settings=settings, pushes=pushes, steps=steps), names, 0, count, seed, told)
