"""Static equilibrium: Newton with damping and continuation, linear solvers, implicit differentiation."""

from softfuse.equilibrium.linear_solver import AbstractLinearSolver, tangent_inverse
from softfuse.equilibrium.multifrontal import Multifrontal
from softfuse.equilibrium.newton import Newton, solve
from softfuse.equilibrium.solution import RESULTS, Solution, State, Stats

__all__ = [
    "RESULTS",
    "AbstractLinearSolver",
    "Multifrontal",
    "Newton",
    "Solution",
    "State",
    "Stats",
    "solve",
    "tangent_inverse",
]
