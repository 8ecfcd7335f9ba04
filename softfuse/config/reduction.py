"""How the body is reduced for real time."""

from softfuse.config.quantity import PositiveInteger, PositiveLength, PositiveNumber
from softfuse.config.settings import Settings


class ReductionSettings(Settings):
    """One chart for each cell of the workspace, no edge of which is longer than `cell` in m.

    displacements, pressures: numbers of modes; sampling: relative error of the sum over points, of which
    there are at most `points`; side: presses are followed at side x side places of a cell, each through
    `levels` up to the largest force, with so many others `near` each.
    """

    cell: PositiveLength = 5e-3
    displacements: PositiveInteger = 96
    pressures: PositiveInteger = 24
    sampling: PositiveNumber = 0.01
    points: PositiveInteger = 256
    side: PositiveInteger = 2
    levels: PositiveInteger = 4
    near: PositiveInteger = 10
