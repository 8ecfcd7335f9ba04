"""What one state of a device means for people: where named points and pressed patches are, how it is bent.

Points are carried by the nodes of the element or face that they lie in, x = Σ_a N_a x_a. A patch also
carries the current normal into the body, the cross product of its tangents. Bending is that of
`functional.centreline`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.functional.centreline import bending, tip_turn
from softfuse.functional.chart import direction_of
from softfuse.functional.contact import ContactSurface
from softfuse.functional.material_points import MaterialPoints
from softfuse.mechanics.model import Model
from softfuse.mechanics.solution import State


@dataclass(frozen=True, eq=False)
class Posture:
    """One state: p points, l links of the centreline, m patches on each of e electrodes, a attached loads.

    `point_m` (p, 3): where the points are; `turn` (l,) [rad] and `curvature` (l,) [1/m] of the centreline's
    links; `tip_turn` [rad] of its last link against its direction at rest, NaN without a centreline;
    `patch_m` (e, m, 3): middles of the patches; `inward` (e, m, 3): unit normals into the body there;
    `answers` (a,): what answers the attached loads' drives, such as shortenings [m] and pressures [Pa].
    """

    point_m: Float[np.ndarray, "p 3"]
    turn: Float[np.ndarray, " l"]
    curvature: Float[np.ndarray, " l"]
    tip_turn: Float[np.ndarray, ""]
    patch_m: Float[np.ndarray, "e m 3"]
    inward: Float[np.ndarray, "e m 3"]
    answers: Float[np.ndarray, " a"]

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
    """The points, the centreline if there is one, and the electrodes' patches of a device."""

    device: Model
    points: _Carried
    centreline: _Carried | None
    patches: _Carried
    slopes: Float[Array, "g a 2"]
    electrodes: int = eqx.field(static=True)

    @classmethod
    def on(
        cls,
        device: Model,
        points: MaterialPoints,
        centreline: MaterialPoints | None,
        faces: Int[np.ndarray, "f s"],
        at: Float[np.ndarray, "e 3 3"],
        arms: Sequence[float],
    ) -> "Watched":
        """Points and centreline in the device's body, and the patches of e electrodes on its outward faces.

        `at` (e, 3, 3): the electrodes' places; `arms` (m,) [m]: of their patches, see `PatchContact`.
        """
        rest = device.body.rest
        landed = [
            ContactSurface.pressed(faces, np.asarray(direction_of(place))).land(
                rest, jnp.asarray(place[0] + np.outer(arms, place[1]))
            )
            for place in at
        ]
        together = jax.tree.map(lambda *each: jnp.concatenate(each), *landed)
        chain = None if centreline is None else _Carried.of(centreline, rest)
        carried = _Carried(together.nodes, together.shape)
        return cls(device, _Carried.of(points, rest), chain, carried, together.slopes, len(landed))

    def posture(self, state: State) -> Posture:
        """What the state says; compiled with its first use."""
        return Posture(*(np.asarray(values) for values in _posture(self, state)))


@eqx.filter_jit
def _posture(watched: Watched, state: State) -> tuple[Array, ...]:
    body = watched.device.body
    now = body.rest + body.displacement(state.z)
    if watched.centreline is None:
        turn, curvature, tip = jnp.zeros(0), jnp.zeros(0), jnp.asarray(jnp.nan)
    else:
        chain, before = watched.centreline(now), watched.centreline(body.rest)
        bent = bending(chain, before)
        turn, curvature, tip = bent.turn, bent.curvature, tip_turn(chain, before)
    tangents = jnp.einsum("gak,gai->gki", watched.slopes, now[watched.patches.nodes])
    across = jnp.cross(tangents[:, 0], tangents[:, 1])
    inward = across / jnp.linalg.norm(across, axis=1, keepdims=True)
    each = (watched.electrodes, -1, 3)
    patch = watched.patches(now).reshape(each)
    answers = watched.device.answers(state)
    return watched.points(now), turn, curvature, tip, patch, inward.reshape(each), answers
