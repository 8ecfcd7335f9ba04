"""Static equilibrium: loads, Newton with damping and continuation, linear solvers, implicit
differentiation.
"""

from softfuse.equilibrium.linear_solver import AbstractLinearSolver, tangent_inverse
from softfuse.equilibrium.load import AbstractLoad, AbstractPorts, LinearPorts, Loads
from softfuse.equilibrium.multifrontal import Multifrontal
from softfuse.equilibrium.newton import Newton, solve
from softfuse.equilibrium.prescribed import PrescribedDisplacement, PrescribedForce
from softfuse.equilibrium.punch import Punch, PunchContact
from softfuse.equilibrium.solution import RESULTS, Solution, State, Stats

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
    "PunchContact",
    "Solution",
    "State",
    "Stats",
    "solve",
    "tangent_inverse",
]
