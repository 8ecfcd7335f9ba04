"""What a design run writes for casting: surfaces of body, cores and mould, and the table of their checks."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from softfuse.design.casting import casting, cavity_solids
from softfuse.design.casting_check import SolidCheck, checked_solids
from softfuse.design.casting_files import write_casting
from softfuse.design.mould import MouldShape, mould
from softfuse.design.plan import DesignPlan
from softfuse.design.port import nearest_ports
from softfuse.robot.layout.layout import AbstractLayout


def cast(
    plan: DesignPlan, layout: AbstractLayout, theta: Float[np.ndarray, " p"], folder: Path
) -> tuple[SolidCheck, ...]:
    """Write the surfaces of a layout with parameters (p,) as STL, in mm, and return what was checked.

    Raises SoftfuseError where a cavity has no way out for its port, or the body cannot be demoulded.
    """
    shape = plan.mould
    cavities = cavity_solids(layout, theta, shape.facets)
    ports = nearest_ports(
        layout,
        theta,
        cavities,
        radius=shape.port_radius,
        wall=0.5 * plan.walls.thickness,
        chord=shape.facets,
    )
    solids = casting(
        layout,
        theta,
        ports,
        beyond=shape.thickness,
        wall=0.5 * plan.walls.thickness,
        chord=shape.facets,
        names=[f"{k}_{cavity.name}" for k, cavity in enumerate(plan.cavities)],
    )
    low, high = layout.outline.low, layout.outline.high
    corner = 2.0 * shape.port_radius
    parts = mould(
        solids,
        MouldShape(
            thickness=shape.thickness,
            pin_radius=shape.pin_radius,
            pin_length=shape.pin_length,
            pin_room=shape.room,
            rod_room=shape.room,
            filled_at=(float(low[0] + 2 * corner), float(low[1] + 2 * corner)),
            filling_radius=corner,
            vented_at=(float(high[0] - corner), float(high[1] - corner)),
            vent_radius=0.5 * corner,
        ),
    )
    checks = checked_solids(solids, parts)
    write_casting(folder, solids, parts)
    return checks
