"""What one state of a robot means for people: where its named points are, how it is bent, what its actuators
do.

Points are carried by the nodes of the element that they lie in, x = Σ_a N_a x_a. Bending is that of
`functional.centreline`. A contact presses where its patch of the surface is now, along the current normal.
"""

from dataclasses import dataclass, fields

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.functional.cavity import Cavity
from softfuse.functional.centreline import bending, tip_turn
from softfuse.functional.chart import direction_of
from softfuse.functional.contact import ContactSurface, EveryFace
from softfuse.functional.material_points import MaterialPoints
from softfuse.mechanics.model import Model
from softfuse.mechanics.solution import State
from softfuse.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class Posture:
    """One state: p points, l links of the centreline, a actuators' drives.

    `point_m` (p, 3): where the points are; `turn` (l,) [rad] and `curvature` (l,) [1/m] of the centreline's
    links; `tip_turn` [rad] of its last link against its direction at rest, NaN without a centreline;
    `drives`, `answers` (a,): what the actuators are driven with, and what answers that, such as tensions [N]
    and shortenings [m]; `volume_m3` (k,): by how much each chamber has grown; `moved_m`: how far the node has
    moved that has most.
    """

    point_m: Float[np.ndarray, "p 3"]
    turn: Float[np.ndarray, " l"]
    curvature: Float[np.ndarray, " l"]
    tip_turn: Float[np.ndarray, ""]
    drives: Float[np.ndarray, " a"]
    answers: Float[np.ndarray, " a"]
    volume_m3: Float[np.ndarray, " k"]
    moved_m: Float[np.ndarray, ""]

    def unknown(self) -> "Posture":
        """The same sizes, with NaN for every number."""
        return Posture(*(np.full(np.shape(getattr(self, each.name)), np.nan) for each in fields(self)))


class _Carried(eqx.Module):
    """g points that nodes (g, a) carry with weights (g, a) [-]."""

    nodes: Int[Array, "g a"]
    weight: Float[Array, "g a"]

    @classmethod
    def of(cls, points: MaterialPoints, rest: Float[Array, "k 3"]) -> "_Carried":
        if not points.nodes.shape[0]:
            return cls(points.nodes, jnp.zeros(points.nodes.shape))
        return cls(points.nodes, points.shape(rest))

    def __call__(self, positions: Float[Array, "k 3"]) -> Float[Array, "g 3"]:
        return jnp.einsum("ga,gai->gi", self.weight, positions[self.nodes])


class Watched(eqx.Module):
    """The points, the centreline if there is one, the chambers of a robot, and its outward faces (f, s)."""

    model: Model
    points: _Carried
    centreline: _Carried | None
    chambers: tuple[Cavity, ...]
    faces: Int[Array, "f s"]

    @classmethod
    def on(cls, robot: Robot) -> "Watched":
        """What is watched on a robot; raises ConfigError for a point outside the body."""
        rest, chain = robot.model.body.rest, robot.centreline()
        return cls(
            robot.model,
            _Carried.of(robot.points(), rest),
            None if chain is None else _Carried.of(chain, rest),
            tuple(chamber.cavity for chamber in robot.parts.chambers.values()),
            jnp.asarray(robot.parts.faces),
        )

    def posture(self, state: State) -> Posture:
        """What the state says; compiled with its first use."""
        return Posture(*(np.asarray(values) for values in _posture(self, state)))

    def pressed(
        self, places: Float[np.ndarray, "c 3 3"], state: State
    ) -> tuple[Float[np.ndarray, "c 3"], Float[np.ndarray, "c 3"]]:
        """Where contacts at places (c, 3, 3) are in a state (c, 3) [m], and the unit normals (c, 3) into the
        body there; NaN for places that are off the surface.
        """
        points, normals = _pressed(self, jnp.asarray(places), state)
        return np.asarray(points), np.asarray(normals)


@eqx.filter_jit
def _posture(watched: Watched, state: State) -> tuple[Array, ...]:
    body = watched.model.body
    now = body.rest + body.displacement(state.z)
    if watched.centreline is None:
        turn, curvature, tip = jnp.zeros(0), jnp.zeros(0), jnp.asarray(jnp.nan)
    else:
        chain, before = watched.centreline(now), watched.centreline(body.rest)
        bent = bending(chain, before)
        turn, curvature, tip = bent.turn, bent.curvature, tip_turn(chain, before)
    answers = watched.model.answers(state)
    drives = state.drive[state.drive.shape[0] - answers.shape[0] :]
    volume = jnp.array([cavity(now) - cavity(body.rest) for cavity in watched.chambers])
    moved = jnp.sqrt(jnp.max(jnp.sum((now - body.rest) ** 2, axis=1)))
    return watched.points(now), turn, curvature, tip, drives, answers, volume, moved


@eqx.filter_jit
def _pressed(watched: Watched, places: Float[Array, "c 3 3"], state: State) -> tuple[Array, Array]:
    body = watched.model.body
    now = body.rest + body.displacement(state.z)

    def one(place):
        search = EveryFace(len(watched.faces))
        surface = ContactSurface(watched.faces, direction_of(place), place[:0:-1], search)
        on = surface.land(body.rest, place[:1])
        point = jnp.einsum("a,ai->i", on.shape[0], now[on.nodes[0]])
        tangents = jnp.einsum("ak,ai->ki", on.slopes[0], now[on.nodes[0]])
        across = jnp.cross(tangents[0], tangents[1])
        inward = across / jnp.linalg.norm(across)
        known = on.met[0] & jnp.all(jnp.isfinite(place))
        return tuple(jnp.where(known, each, jnp.nan) for each in (point, inward))

    return jax.lax.map(one, places)
