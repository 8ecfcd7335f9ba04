"""What is asked of a layout: one measure as small as possible, others within limits, walls of a thickness.

    minimise m₀(θ)   over   lower ≤ θ ≤ upper
    with   low_i ≤ m_i(θ) ≤ high_i,   t_j(θ) ≥ t_least,j,   what the shapes need to exist ≥ 0

m are measures of how the robot answers (`objective`), t its walls (`thickness`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.design.facing import Facing
from softfuse.design.layout_model import model_at
from softfuse.design.limits import Limit
from softfuse.design.objective import AbstractMeasure, Answers, measured
from softfuse.design.straining import largest_strain
from softfuse.errors import SoftfuseError
from softfuse.estimation.rest_response import place_response, rest_response
from softfuse.functional.material_points import MaterialPoints
from softfuse.mechanics.model import Model
from softfuse.mesh.block import Fineness
from softfuse.mesh.surface import Surface
from softfuse.robot.layout.layout import AbstractLayout
from softfuse.robot.layout.layout_mesh import LayoutMesh, layout_mesh, remade
from softfuse.robot.layout.thickness import clearances, slacks, wall_names, wall_thicknesses


@dataclass(frozen=True, eq=False)
class Walls:
    """Least thickness [m] of all walls, and of those whose name begins as given, see `wall_names`, such as
    {"cavity 0, high z": 0.004}.
    """

    thickness_m: float
    special: Mapping[str, float]

    def least(self, layout: AbstractLayout) -> Float[np.ndarray, " t"]:
        """Of each wall (t,) [m]; raises SoftfuseError where no wall has a special one's name."""
        names = wall_names(layout)
        least = np.full(len(names), self.thickness_m)
        for begin, thickness in self.special.items():
            chosen = [k for k, name in enumerate(names) if name.startswith(begin)]
            if not chosen:
                raise SoftfuseError(f'no wall is called "{begin}": there are {", ".join(names)}')
            least[chosen] = thickness
        return least


def no_guides(theta: Array) -> Float[Array, "0 3"]:
    """No points in the material that keep away from cavities."""
    del theta
    return jnp.zeros((0, 3))


def untouched(theta: Array) -> Float[Array, "1 2 2"]:
    """No electrodes that tell anything of a place."""
    del theta
    return jnp.zeros((1, 2, 2))


class Watched(eqx.Module):
    """What is watched of a robot on one mesh besides its readings: the points whose motion counts, and
    opposite walls of its cavities.
    """

    points: MaterialPoints | None
    facing: Facing


@dataclass(frozen=True, eq=False)
class Problem:
    """A design task.

    build: the robot on a mesh with parameters (p,), such as `build_robot` makes it; places (s, ...): where
    it is pressed, see `Model.contact`; noise (k,) [SI]: standard deviations of readings; by_place: whether
    it counts how readings change with the place; watch: the points of a robot whose motion counts, such as
    `MaterialPoints.embedded` finds them; follow: what else of a robot follows parameters (p,) besides its
    cavities, differentiably; guides: points (m, 3) m in the material with parameters (p,) that have to be as
    far from cavities as walls are thick, such as those of a cable; touched: information (s, 2, 2) 1/m² of
    electrodes on each place with parameters (p,), differentiable, see `sensors.place_information`.
    """

    layout: AbstractLayout
    fineness: Fineness
    build: Callable[[LayoutMesh, Float[np.ndarray, " p"]], Model]
    places: Array
    noise: Float[np.ndarray, " k"]
    objective: AbstractMeasure
    limits: tuple[Limit, ...] = ()
    walls: Walls = Walls(0.0, {})
    by_place: bool = False
    watch: Callable[[Model], MaterialPoints | None] = lambda model: None
    follow: Callable[[Model, Array], Model] = lambda model, theta: model
    guides: Callable[[Array], Array] = no_guides
    touched: Callable[[Array], Array] = untouched

    @property
    def measures(self) -> tuple[AbstractMeasure, ...]:
        """The objective, then those of the limits."""
        return (self.objective, *(limit.measure for limit in self.limits))

    def watched(self, model: Model, walls: Sequence[Surface]) -> Watched:
        """What is watched of a robot whose cavities have these walls, normals into the material."""
        facing = Facing.of(np.asarray(model.body.rest), [wall.faces for wall in walls])
        return Watched(self.watch(model), facing)

    def answers(self, model: Model, watched: Watched, theta: Float[Array, " p"]) -> Answers:
        """How a robot answers to the presses, with electrodes of parameters (p,); differentiable in both."""
        if self.by_place:
            found, by_place = place_response(model, self.places)
        else:
            found = rest_response(model, self.places)
            by_place = jnp.zeros((*found.by_force.shape, 2))
        body, points, facing = model.body.full, watched.points, watched.facing
        motion = found.motion[:, :0]
        if points is not None:
            motion = jnp.einsum("ga,sgai->sgi", points.shape(body.rest), found.motion[:, points.nodes])
        apart = facing.gaps(body.rest)
        closing, strain = jax.lax.map(
            lambda moved: (jnp.max(-facing.gaps(moved) / apart), largest_strain(body, moved)), found.motion
        )
        noise = jnp.asarray(self.noise)
        touched = jnp.broadcast_to(self.touched(theta), (len(self.places), 2, 2))
        return Answers(found.by_force, by_place, found.softness, motion, closing, strain, noise, touched)

    def answered(self, model: Model, walls: Sequence[Surface], theta: Float[np.ndarray, " p"]) -> Answers:
        """The answers of a robot whose cavities have these walls, with electrodes of parameters (p,),
        compiled for it.
        """
        return eqx.filter_jit(self.answers)(model, self.watched(model, walls), jnp.asarray(theta))

    def on_mesh(self, theta: Float[np.ndarray, " p"]) -> "MeshedProblem":
        """The problem on a mesh made for parameters (p,); raises MeshError where there is none."""
        mesh = layout_mesh(self.layout, theta, self.fineness)
        return MeshedProblem(self, mesh, self.build(mesh, theta))

    @cached_property
    def measured(self) -> Callable[..., Array]:
        """The measures (m,) of a robot on a mesh, with what is watched of it and parameters (p,), one
        program for all meshes of the same tetrahedra.
        """
        return eqx.filter_jit(self._measured)

    @cached_property
    def valued(self) -> Callable[..., tuple[Array, Array]]:
        """The same and its derivatives (m, p)."""

        def valued(model, mesh, watched, theta):
            value, back = jax.vjp(lambda at: self._measured(model, mesh, watched, at), theta)
            return value, jax.lax.map(lambda each: back(each)[0], jnp.eye(len(value)))

        return eqx.filter_jit(valued)

    def _measured(
        self, model: Model, mesh: LayoutMesh, watched: Watched, theta: Float[Array, " p"]
    ) -> Float[Array, " m"]:
        answers = self.answers(self.follow(model_at(model, mesh, theta), theta), watched, theta)
        return measured(self.measures, answers)


@dataclass(frozen=True, eq=False)
class Value:
    """Measures (1 + l,) in SI, the objective first, and their derivatives (1 + l, p) in the parameters."""

    measures: Float[np.ndarray, " m"]
    slopes: Float[np.ndarray, "m p"]


@dataclass(frozen=True, eq=False)
class MeshedProblem:
    """A problem whose robot, built on `mesh`, follows the parameters."""

    problem: Problem
    mesh: LayoutMesh
    model: Model

    def remade(self, theta: Float[np.ndarray, " p"]) -> "MeshedProblem":
        """On a mesh made for parameters (p,), if possible of the same tetrahedra.

        Raises MeshError where there is none.
        """
        mesh = remade(self.mesh, theta, self.problem.fineness)
        model = self.problem.build(mesh, theta)
        if mesh.tets is self.mesh.tets:
            # The same plan, so that no program is compiled again.
            model = eqx.tree_at(lambda each: each.linear, model, self.model.linear)
        return MeshedProblem(self.problem, mesh, model)

    def measures(self, theta: Float[np.ndarray, " p"]) -> Float[np.ndarray, " m"]:
        """The measures (m,) with parameters (p,), in SI."""
        return np.asarray(self.problem.measured(*self._given, jnp.asarray(theta)))

    def value(self, theta: Float[np.ndarray, " p"]) -> Value:
        """The measures with parameters (p,) and their derivatives."""
        return Value(*map(np.asarray, self.problem.valued(*self._given, jnp.asarray(theta))))

    @cached_property
    def watched(self) -> Watched:
        """What is watched of its robot."""
        return self.problem.watched(self.model, self.mesh.walls)

    @property
    def _given(self) -> tuple[Model, LayoutMesh, Watched]:
        # A number that is no array is part of the program.
        return self.model, replace(self.mesh, made_quality=1.0), self.watched


class Geometry:
    """What a layout has to keep and needs no robot: by how much (c,) [m] walls are thicker than they must be
    and guides farther from cavities, then how much room shapes have to exist; not negative where the layout
    can be made.
    """

    def __init__(
        self, layout: AbstractLayout, walls: Walls, guides: Callable[[Array], Array] = no_guides
    ) -> None:
        """guides: points (m, 3) m in the material with parameters (p,), see `Problem`. Compiled once."""
        least = jnp.asarray(walls.least(layout))

        def spare(theta: Float[Array, " p"]) -> Float[Array, " c"]:
            clear = clearances(layout, theta, guides(theta)) - walls.thickness_m
            return jnp.concatenate([wall_thicknesses(layout, theta) - least, clear, slacks(layout, theta)])

        self._spare, self._slope = jax.jit(spare), jax.jit(jax.jacrev(spare))

    def spare(self, theta: Float[np.ndarray, " p"]) -> Float[np.ndarray, " c"]:
        """With parameters (p,)."""
        return np.asarray(self._spare(jnp.asarray(theta)))

    def slope(self, theta: Float[np.ndarray, " p"]) -> Float[np.ndarray, "c p"]:
        """Its derivatives [m per SI unit]."""
        return np.asarray(self._slope(jnp.asarray(theta)))
