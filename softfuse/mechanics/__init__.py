"""Static equilibrium: loads, Newton with damping and continuation, linear solvers, implicit
differentiation.
"""

from softfuse.mechanics.linear_solver import AbstractLinearSolver, tangent_inverse
from softfuse.mechanics.load import AbstractLoad, AbstractPorts, LinearPorts, Loads
from softfuse.mechanics.multifrontal import Multifrontal
from softfuse.mechanics.newton import Newton, solve
from softfuse.mechanics.prescribed import PrescribedDisplacement, PrescribedForce
from softfuse.mechanics.punch import Punch
from softfuse.mechanics.solution import RESULTS, Solution, State, Stats

__all__ = [
    "RESULTS",
    "AbstractLinearSolver",
    "AbstractLoad",
    "AbstractPorts",
    "LinearPorts",
    "Loads",
    "Multifrontal",
    "Newton",
    "PrescribedDisplacement",
    "PrescribedForce",
    "Punch",
    "Solution",
    "State",
    "Stats",
    "solve",
    "tangent_inverse",
]
