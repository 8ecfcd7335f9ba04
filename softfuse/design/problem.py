"""What is asked of a layout: one measure as small as possible, others within limits, walls of a thickness.

    minimise m₀(θ)   over   lower ≤ θ ≤ upper
    with   low_i ≤ m_i(θ) ≤ high_i,   t_j(θ) ≥ t_least,j,   what the shapes need to exist ≥ 0

m are measures of how the device answers (`objective`), t its walls (`thickness`).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.design.layout import AbstractLayout
from softfuse.design.layout_device import device_at
from softfuse.design.layout_mesh import Fineness, LayoutMesh, layout_mesh, remade
from softfuse.design.objective import AbstractMeasure, Answers
from softfuse.design.thickness import slacks, wall_names, wall_thicknesses
from softfuse.errors import SoftfuseError
from softfuse.estimation.device import Device
from softfuse.estimation.rest_response import place_response, rest_response
from softfuse.functional.material_points import MaterialPoints


@dataclass(frozen=True, eq=False)
class Limit:
    """What a measure must be at least and at most, in SI; infinite where it need not."""

    measure: AbstractMeasure
    at_least: float = -np.inf
    at_most: float = np.inf

    def missing(self, value: float) -> float:
        """By how much a value misses the limits, in parts of the limit; 0 within."""
        below = (self.at_least - value) / abs(self.at_least) if np.isfinite(self.at_least) else 0.0
        above = (value - self.at_most) / abs(self.at_most) if np.isfinite(self.at_most) else 0.0
        return max(below, above, 0.0)


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


@dataclass(frozen=True, eq=False)
class Problem:
    """A design task.

    build: the device on a mesh with parameters (p,), such as `build_device` makes it; places (s, ...): where
    it is pressed, see `Device.contact`; noise (k,) [SI]: standard deviations of readings; by_place: whether
    it counts how readings change with the place; watch: the points of a device whose motion counts.
    """

    layout: AbstractLayout
    fineness: Fineness
    build: Callable[[LayoutMesh, Float[np.ndarray, " p"]], Device]
    places: Array
    noise: Float[np.ndarray, " k"]
    objective: AbstractMeasure
    limits: tuple[Limit, ...] = ()
    walls: Walls = Walls(0.0, {})
    by_place: bool = False
    watch: Callable[[Device], MaterialPoints | None] = lambda device: None

    @property
    def measures(self) -> tuple[AbstractMeasure, ...]:
        """The objective, then those of the limits."""
        return (self.objective, *(limit.measure for limit in self.limits))

    def answers(self, device: Device, points: MaterialPoints | None = None) -> Answers:
        """How a device answers to the presses, and how `points` of it move; differentiable in the device."""
        if self.by_place:
            found, by_place = place_response(device, self.places)
        else:
            found = rest_response(device, self.places)
            by_place = jnp.zeros((*found.by_force.shape, 2))
        motion = found.motion[:, :0]
        if points is not None:
            shape = points.shape(device.body.rest)
            motion = jnp.einsum("ga,sgai->sgi", shape, found.motion[:, points.nodes])
        return Answers(found.by_force, by_place, found.softness, motion, jnp.asarray(self.noise))

    def on_mesh(self, theta: Float[np.ndarray, " p"]) -> "MeshedProblem":
        """The problem on a mesh made for parameters (p,); raises MeshError where there is none."""
        mesh = layout_mesh(self.layout, theta, self.fineness)
        return MeshedProblem(self, mesh, self.build(mesh, theta))

    @cached_property
    def measured(self) -> Callable[..., Array]:
        """The measures (m,) of a device on a mesh, with points whose motion counts and parameters (p,), one
        program for all meshes of the same tetrahedra.
        """
        return eqx.filter_jit(self._measured)

    @cached_property
    def valued(self) -> Callable[..., tuple[Array, Array]]:
        """The same and its derivatives (m, p)."""

        def valued(device, mesh, points, theta):
            value, back = jax.vjp(lambda at: self._measured(device, mesh, points, at), theta)
            return value, jax.lax.map(lambda each: back(each)[0], jnp.eye(len(value)))

        return eqx.filter_jit(valued)

    def _measured(
        self, device: Device, mesh: LayoutMesh, points: MaterialPoints | None, theta: Float[Array, " p"]
    ) -> Float[Array, " m"]:
        answers = self.answers(device_at(device, mesh, theta), points)
        return jnp.stack([measure(answers) for measure in self.measures])


@dataclass(frozen=True, eq=False)
class Value:
    """Measures (1 + l,) in SI, the objective first, and their derivatives (1 + l, p) in the parameters."""

    measures: Float[np.ndarray, " m"]
    slopes: Float[np.ndarray, "m p"]


@dataclass(frozen=True, eq=False)
class MeshedProblem:
    """A problem whose device, built on `mesh`, follows the parameters."""

    problem: Problem
    mesh: LayoutMesh
    device: Device

    def remade(self, theta: Float[np.ndarray, " p"]) -> "MeshedProblem":
        """On a mesh made for parameters (p,), if possible of the same tetrahedra.

        Raises MeshError where there is none.
        """
        mesh = remade(self.mesh, theta, self.problem.fineness)
        device = self.problem.build(mesh, theta)
        if mesh.tets is self.mesh.tets:
            # The same plan, so that no program is compiled again.
            device = eqx.tree_at(lambda each: each.linear, device, self.device.linear)
        return MeshedProblem(self.problem, mesh, device)

    def measures(self, theta: Float[np.ndarray, " p"]) -> Float[np.ndarray, " m"]:
        """The measures (m,) with parameters (p,), in SI."""
        return np.asarray(self.problem.measured(*self._given, jnp.asarray(theta)))

    def value(self, theta: Float[np.ndarray, " p"]) -> Value:
        """The measures with parameters (p,) and their derivatives."""
        return Value(*map(np.asarray, self.problem.valued(*self._given, jnp.asarray(theta))))

    @property
    def _given(self) -> tuple[Device, LayoutMesh, MaterialPoints | None]:
        # A number that is no array is part of the program.
        return self.device, replace(self.mesh, made_quality=1.0), self.problem.watch(self.device)


class Geometry:
    """What a layout has to keep and needs no device: by how much (c,) [m] walls are thicker than they must
    be, then how much room shapes have to exist; not negative where the layout can be made.
    """

    def __init__(self, layout: AbstractLayout, walls: Walls) -> None:
        """Compiled once."""
        least = jnp.asarray(walls.least(layout))

        def spare(theta: Float[Array, " p"]) -> Float[Array, " c"]:
            return jnp.concatenate([wall_thicknesses(layout, theta) - least, slacks(layout, theta)])

        self._spare, self._slope = jax.jit(spare), jax.jit(jax.jacrev(spare))

    def spare(self, theta: Float[np.ndarray, " p"]) -> Float[np.ndarray, " c"]:
        """With parameters (p,)."""
        return np.asarray(self._spare(jnp.asarray(theta)))

    def slope(self, theta: Float[np.ndarray, " p"]) -> Float[np.ndarray, "c p"]:
        """Its derivatives [m per SI unit]."""
        return np.asarray(self._slope(jnp.asarray(theta)))
