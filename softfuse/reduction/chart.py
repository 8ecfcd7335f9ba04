"""The reduced body around some places of its loads, from the full body and nothing else.

A chart holds where its loads act: forces for which its basis has no attachment modes push a body that cannot
answer, and nodes that it does not watch give NaN.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.body.base import AbstractBody
from softfuse.body.body import Body
from softfuse.equilibrium.linear_solver import AbstractLinearSolver
from softfuse.equilibrium.load import Loads
from softfuse.errors import SolveError
from softfuse.reduction.basis import Basis, basis_of, force_span
from softfuse.reduction.cubature import Cubature
from softfuse.reduction.mode_points import mode_points
from softfuse.reduction.projection import project
from softfuse.reduction.reduced_body import ReducedBody
from softfuse.reduction.rest_stiffness import RestStiffness, rest_responses, rest_stiffness
from softfuse.reduction.sampling import sampled
from softfuse.reduction.snapshots import snapshots

LoadsAt = Callable[[AbstractBody, Array], Loads]
"""The loads on a body at a place."""


@dataclass(frozen=True)
class ChartSettings:
    """How fine a chart is: numbers of `corrections` beyond the attachment modes and of `pressures`, the
    relative `tolerance` of the cubature, and the `most_points` it may take.
    """

    corrections: int = 40
    pressures: int = 60
    tolerance: float = 1e-2
    most_points: int = 700


class Chart(NamedTuple):
    """A reduced body, and what it was made of: its basis, the tangent at rest, the training states'
    amplitudes (t, r) and the cubature.
    """

    body: ReducedBody
    basis: Basis
    stiffness: RestStiffness
    amplitudes: Float[np.ndarray, "t r"]
    cubature: Cubature


def chart(
    linear: AbstractLinearSolver,
    body: Body,
    loads_at: LoadsAt,
    *,
    around: Iterable[Array],
    presses: Sequence[Array],
    levels: Float[np.ndarray, "l D"],
    watched: Int[np.ndarray, " w"],
    settings: ChartSettings = ChartSettings(),
) -> Chart:
    """Reduce a body for loads at all places near those of `around`, close enough to each other that no force
    is missed between them.

    `presses`: places where equilibria are solved for, at drives (l, D); `watched` (w,): the nodes that
    functionals look at; those that loads act on are added. Raises SolveError where a press has no
    equilibrium.
    """

    @eqx.filter_jit
    def rows_at(body, place):
        return loads_at(body, place).rows(body, jnp.zeros(body.n))

    forces = force_span(np.asarray(rows_at(body, place)) for place in around)
    answers = rest_responses(linear, body, forces)
    found = snapshots(linear, body, loads_at, presses, levels)
    if not found.found.all():
        place, level = np.argwhere(~found.found)[0]
        raise SolveError(
            f"press {place} at {np.ravel(presses[place])} finds no equilibrium at drives {levels[level]}: "
            "lower the largest force, or refine the mesh there"
        )
    stiffness = rest_stiffness(body)
    basis = basis_of(
        stiffness,
        answers,
        found.states,
        corrections=settings.corrections,
        pressures=settings.pressures,
    )
    amplitudes = amplitudes_of(found.states, basis, stiffness)
    points = mode_points(body, *basis)
    cubature = sampled(points, amplitudes, tolerance=settings.tolerance, most=settings.most_points)
    pushed = np.append(np.any(forces != 0, axis=1), False)[np.asarray(body.displacement_index)].any(axis=1)
    seen = np.union1d(watched, np.flatnonzero(pushed))
    softest = float(np.max(np.einsum("nf,nf->f", forces, answers)))
    reduced = project(body, basis, stiffness, points, cubature, seen, 1 / softest)
    return Chart(reduced, basis, stiffness, amplitudes, cubature)


def amplitudes_of(
    states: Float[np.ndarray, "t n"], basis: Basis, stiffness: RestStiffness
) -> Float[np.ndarray, "t r"]:
    """Amplitudes (t, r) of the modes that come closest to states (t, n) of the full body."""
    u = stiffness.n_displacements
    moves = states[:, :u] @ (stiffness.displacement @ basis.displacement)
    return np.concatenate([moves, states[:, u:] @ (stiffness.pressure @ basis.pressure)], axis=1)
