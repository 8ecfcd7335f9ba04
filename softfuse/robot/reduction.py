"""How the body is reduced for real time."""

from softfuse.io.quantity import PositiveForce, PositiveInteger, PositiveLength, PositiveNumber
from softfuse.io.settings import Settings


class ReductionSettings(Settings):
    """One chart for each electrode, or for each cell of the workspace, whose edges are not longer than `cell`
    in m.

    displacements, pressures: numbers of modes; sampling: the part of a state that may be missed because
    energy is measured at points, at most `points` of them; side: presses are followed at side x side places
    of a cell, each through `levels` up to the largest force, with so many others `near` each; travel in m:
    charts are good for contacts that push no node further, by the compliance at rest; tension in N: and for
    cables that pull no harder; None: for all that the config's contact and cables may do.
    """

    cell: PositiveLength = 5e-3
    displacements: PositiveInteger = 96
    pressures: PositiveInteger = 24
    sampling: PositiveNumber = 1e-3
    points: PositiveInteger = 512
    side: PositiveInteger = 3
    levels: PositiveInteger = 4
    near: PositiveInteger = 10
    travel: PositiveLength | None = None
    tension: PositiveForce | None = None
