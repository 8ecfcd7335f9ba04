"""What a robot answers to presses of a real force, by the equilibria themselves and not by their slopes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.design.facing import Facing
from softfuse.design.straining import largest_stretch
from softfuse.errors import SolveError
from softfuse.estimation.batch import side_by_side
from softfuse.mechanics.model import Model, simulate
from softfuse.mechanics.solution import RESULTS


@dataclass(frozen=True, eq=False)
class Pressed:
    """Answers to s presses with one force: `by_force` (s, k) [reading's SI unit/N], changes of readings since
    rest over the force; `softness` (s,) [m/N], depths over the force; `open_part` (s,) [-], the least part of
    the distance between opposite walls of cavities that is left; `stretch` (s,) [-], the largest length over
    that at rest, at a quadrature point; number of the mesh's `nodes`.
    """

    by_force: Float[np.ndarray, "s k"]
    softness: Float[np.ndarray, " s"]
    open_part: Float[np.ndarray, " s"]
    stretch: Float[np.ndarray, " s"]
    nodes: int

    @property
    def sensitivity(self) -> Float[np.ndarray, " s"]:
        """Norms (s,) [SI/N]."""
        return np.linalg.norm(self.by_force, axis=1)

    @property
    def unevenness(self) -> float:
        """Coefficient of variation [-] of the sensitivity."""
        return float(np.std(self.sensitivity) / np.mean(self.sensitivity))


def pressed(
    model: Model,
    walls: Sequence[Int[np.ndarray, "_ c"]],
    places: Array,
    force_N: float,
    *,
    seen: Callable[[], None] = lambda: None,
) -> Pressed:
    """Press at places (s, 3, 3) with a force [N], in equal parts on the patches of an electrode.

    walls: faces of each cavity, see `Facing.of`; `seen` is called after each place.

    Raises SolveError where there is no equilibrium.
    """
    body = model.body.full
    facing = Facing.of(np.asarray(body.rest), walls)
    rest = np.asarray(model.rest_state(places[:1]).drive)
    kind = model.contacts[0]
    drive = np.concatenate([force_N * kind.shares, rest[kind.drives :]])

    def one(place: np.ndarray) -> tuple[np.ndarray, ...]:
        answer, result = _pressed(model, facing, jnp.asarray(place), jnp.asarray(drive))
        if not bool(result == RESULTS.converged):
            raise SolveError(f"no equilibrium under {force_N:g} N at {place[0].tolist()}: {RESULTS[result]}")
        seen()
        return tuple(np.asarray(each) for each in answer)

    reading, depth, opened, stretch = side_by_side(one, np.asarray(places))
    return Pressed(reading / force_N, depth / force_N, opened, stretch, len(body.rest))


@eqx.filter_jit
def _pressed(model: Model, facing: Facing, place: Array, drive: Array) -> tuple[tuple[Array, ...], RESULTS]:
    at, body = place[None], model.body.full
    solution = simulate(model, at, drive)
    state, rest = solution.state, model.rest_state(at)
    reading = model.reading(state, at) - model.reading(rest, at)
    opened = facing.gaps(body.rest + body.displacement(state.z)) / facing.gaps(body.rest)
    answer = reading, model.depth(at, state), jnp.min(opened), largest_stretch(body, state.z)
    return answer, solution.result
