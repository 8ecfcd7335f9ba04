"""A chart from load paths: snapshots, their modes, and the points that measure the energy of both."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from softfuse.body.body import Body
from softfuse.errors import SolveError
from softfuse.mechanics.linear_solver import AbstractLinearSolver
from softfuse.mechanics.load import Loads
from softfuse.rom.basis import Basis, RestStiffness, basis_of
from softfuse.rom.known_inverses import far_apart
from softfuse.rom.load_paths import LoadPath
from softfuse.rom.mode_points import mode_points
from softfuse.rom.sampling import Sampling, sampled
from softfuse.rom.snapshots import LoadsAt, snapshots

_TYPICAL = 32
"""States that live steps know the inverse tangent in."""


class Chart(NamedTuple):
    """What makes a reduced body around some places of its loads: small enough to be kept in a file.

    It holds where its loads act: other states than those that it was taught are combinations of its modes
    only as far as they look alike, and nodes that it does not watch give NaN.

    The `basis` of r modes; the `sampling` of the body's points, at which its energy is measured; the nodes
    `watched` (w,) that loads and functionals look at; how far each mode goes, the root mean square `reach`
    (r,) of the amplitudes it was taught; some `typical` (t, r) of these, far from each other; and the largest
    `compliance` [m/N] under one force of its loads.
    """

    basis: Basis
    sampling: Sampling
    watched: Int[np.ndarray, " w"]
    reach: Float[np.ndarray, " r"]
    typical: Float[np.ndarray, "t r"]
    compliance: float


@dataclass(frozen=True)
class ChartSettings:
    """How fine a chart is: numbers of modes of `displacements` and `pressures`, the `tolerance` [-] of the
    cubature, see `sampled`, and the `most_points` it may take.
    """

    displacements: int = 128
    pressures: int = 40
    tolerance: float = 1e-3
    most_points: int = 400


def teach(
    linear: AbstractLinearSolver,
    body: Body,
    stiffness: RestStiffness,
    loads_at: LoadsAt,
    paths: Sequence[LoadPath],
    *,
    around: Iterable[Array],
    settings: ChartSettings = ChartSettings(),
) -> Chart:
    """The chart of a body, with its tangent at rest, for loads like those of some load paths.

    `around`: places (c, 3, 3) so close to each other that no node which contacts may act on is missed between
    them. It watches these nodes and those that move furthest. Raises SolveError where a path has no
    equilibrium.
    """
    found = snapshots(linear, body, loads_at, paths)
    if not found.found[:, :, 0].all():
        path, level = np.argwhere(~found.found[:, :, 0])[0]
        raise SolveError(
            f"load path {path} at {np.ravel(paths[path].place)} finds no equilibrium at drives "
            f"{paths[path].levels[level]}: lower the largest force, or refine the mesh there"
        )
    basis = basis_of(
        stiffness, found.states, displacements=settings.displacements, pressures=settings.pressures
    )
    amplitudes = basis.amplitudes(found.z.reshape(-1, body.n), stiffness).reshape(*found.found.shape, -1)
    sampling = sampled(
        mode_points(body, basis),
        amplitudes.reshape(-1, *amplitudes.shape[2:]),
        found.found.reshape(-1, found.found.shape[2]),
        tolerance=settings.tolerance,
        most=settings.most_points,
    )
    pushed = np.any([np.asarray(_pushed(loads_at, body, place)) for place in around], axis=0)
    return Chart(
        basis,
        sampling,
        np.union1d(_furthest(body, found.states), np.flatnonzero(pushed)),
        np.sqrt(np.mean(amplitudes[found.found] ** 2, axis=0)),
        far_apart(amplitudes[found.found], _TYPICAL),
        float(_softest(loads_at, linear, body, paths[0].place)),
    )


def _contacts(loads_at: LoadsAt, body: Body, place: Array) -> Loads:
    return Loads(loads_at(body, place).parts[: len(place)])


@eqx.filter_jit
def _pushed(loads_at: LoadsAt, body: Body, place: Array) -> Bool[Array, " k"]:
    """Which nodes (k,) the contacts at places (c, 3, 3) act on, held ones among them."""
    index = jnp.arange(body.rest.size).reshape(body.rest.shape)
    loose = replace(body, displacement_index=index, n_displacements=index.size, n=index.size)
    rows = _contacts(loads_at, loose, place).rows(loose, jnp.zeros(loose.n))
    return jnp.any(rows.reshape(*index.shape, -1) != 0, axis=(1, 2))


def _furthest(body: Body, states: Float[np.ndarray, "s n"]) -> Int[np.ndarray, " w"]:
    """The nodes (w,) that move furthest in one of some states (s, n)."""
    free = np.pad(states[:, : body.n_displacements], ((0, 0), (0, 1)))
    index = np.minimum(np.asarray(body.displacement_index), body.n_displacements)
    return np.unique([np.argmax(np.sum(state[index] ** 2, axis=1)) for state in free])


@eqx.filter_jit
def _softest(loads_at: LoadsAt, linear: AbstractLinearSolver, body: Body, place: Array) -> Float[Array, ""]:
    """The largest compliance [m/N] of a body at rest under one force of the contacts at places (c, 3, 3)."""
    loads = _contacts(loads_at, body, place)
    solver, rows = linear.rough(), loads.rows(body, jnp.zeros(body.n))[:, loads.carrying]
    answers = solver.solve(solver.factor(body.element_tangents(jnp.zeros(body.n))), rows)
    return jnp.max(jnp.sum(rows * answers, axis=0))
