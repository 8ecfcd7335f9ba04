"""Cables that act on a body: pulled with a given tension, or shortened by a given length.

Ports are the positions of the guide points; the law follows their current positions, so a cable needs no
stiffness in the body's tangent. Shortened by δ, the cable has ℓ₀ − δ at its disposal and its tension is the
multiplier of ℓ ≤ ℓ₀ − δ + c T: 0 ≤ T ⊥ ℓ₀ − δ + c T − ℓ ≥ 0, c its own compliance. A slack cable carries
nothing. Pulled with T, its end comes out by δ = ℓ₀ − ℓ + c T.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.body.base import AbstractBody
from softfuse.errors import MeshError
from softfuse.functional.cable import guide_forces, length
from softfuse.functional.material_points import MaterialPoints, ball, nearest_places
from softfuse.mechanics.load import AbstractLoad, Sizes
from softfuse.mechanics.points import AbstractGuides, PointPorts


class PulledCable(AbstractLoad):
    """A cable of given tension, pulled at a fixed point (3,) m; `friction` μ [-] at its guides, `compliance`
    c [m/N] of the cable itself.
    """

    ports: AbstractGuides
    pulled_at: Float[Array, "3"]
    friction: Float[Array, ""]
    compliance: Float[Array, ""]

    @classmethod
    def through(
        cls,
        body: AbstractBody,
        guides: Float[np.ndarray, "g 3"],
        pulled_at: Float[np.ndarray, "3"],
        *,
        friction: float = 0.0,
        compliance: float = 0.0,
        anchor_radius: float = 0.0,
        within: float = 0.0,
    ) -> "PulledCable":
        """A cable through guides (g, 3) m of a body at rest, first the one next to the pulling point (3,) m.

        It ends in a ball of `anchor_radius` [m] around the last guide, or in that point. Guides that are
        `within` [m] outside the body are put onto its surface. Raises MeshError for a guide that is further
        outside, or a ball that reaches out.
        """
        points = MaterialPoints.embedded(body, guides, within=within, named="guide")
        before, anchor = np.asarray(points.location)[:-1], np.asarray(points.location)[-1:]
        if anchor_radius > 0:
            points, anchor = _anchored(body, before, anchor[0], anchor_radius)
        belongs = np.append(np.arange(len(before)), np.full(len(anchor), len(before)))
        share = np.eye(len(before) + 1)[:, belongs]
        ports = PointPorts.shared(points, jnp.asarray(share / share.sum(axis=1, keepdims=True)), body)
        return cls(ports, *(jnp.asarray(each, float) for each in (pulled_at, friction, compliance)))

    @property
    def sizes(self):
        """Three ports and forces for each guide; the tension."""
        count = self.ports.location.size
        return Sizes(ports=count, forces=count, internal=0, drives=1)

    def start(self):
        """No tension."""
        return jnp.zeros(self.sizes.forces), jnp.zeros(0), jnp.zeros(1)

    def units(self):
        """Newtons."""
        return jnp.ones(self.sizes.forces)

    def equations(self, force, internal, y, drive):
        """f_i − f_i(x, T) = 0 for each guide (3 g,) [N]."""
        del internal
        return force - guide_forces(y.reshape(-1, 3), self.pulled_at, drive[0], self.friction).ravel()

    def equations_near(self, force, internal, y, drive, at):
        """The forces' part of first order in the guides' motion."""
        _, near = at
        law, turned = jax.jvp(lambda y: self.equations(force, internal, y, drive), (near,), (y - near,))
        return law + turned

    def conjugate(self, force, internal, y):
        """δ (1,) [m]: by how much the cable has been pulled out."""
        del internal
        guides = y.reshape(-1, 3)
        first = guides[0] - self.pulled_at
        # What the guides feel together is what holds the cable at its other end.
        tension = -jnp.sum(force.reshape(-1, 3), axis=0) @ first / jnp.linalg.norm(first)
        return (_rest_length(self) - length(guides, self.pulled_at) + self.compliance * tension)[None]

    def by_answer(self, body):
        """Shortened."""
        return ShortenedCable.of(self, body)


class ShortenedCable(AbstractLoad):
    """A cable of given shortening δ [m], with the tension as internal unknown.

    `pulled_at`, `friction`, `compliance`: as of `PulledCable`; `stiffness` [N/m]: weighs lengths against
    tensions and does not move the solution.
    """

    ports: AbstractGuides
    pulled_at: Float[Array, "3"]
    friction: Float[Array, ""]
    compliance: Float[Array, ""]
    stiffness: Float[Array, ""]

    @classmethod
    def of(cls, cable: PulledCable, body: AbstractBody) -> "ShortenedCable":
        """The same cable, taut without tension on the body at rest."""
        stiffness = jax.lax.stop_gradient(body.pressure_unit * _rest_length(cable))
        return cls(cable.ports, cable.pulled_at, cable.friction, cable.compliance, stiffness)

    @property
    def sizes(self):
        """Three ports and forces for each guide; the tension; the shortening."""
        count = self.ports.location.size
        return Sizes(ports=count, forces=count, internal=1, drives=1)

    def start(self):
        """Neither tension nor shortening."""
        return jnp.zeros(self.sizes.forces), jnp.zeros(1), jnp.zeros(1)

    def units(self):
        """Newtons."""
        return jnp.ones(self.sizes.forces + 1)

    def equations(self, force, internal, y, drive):
        """The forces of the tension (3 g,) [N], then its complementarity with the slack [N]."""
        shorter, tension = _rest_length(self) - length(y.reshape(-1, 3), self.pulled_at), internal[0]
        return jnp.append(force - self._pushes(y, tension), self._taut(shorter, tension, drive))

    def equations_near(self, force, internal, y, drive, at):
        """The forces and the length of first order in the guides' motion."""
        (before, near), tension = at, internal[0]

        def path(y: Float[Array, " p"]) -> tuple[Float[Array, " p"], Float[Array, ""]]:
            return self._pushes(y, before[0]), length(y.reshape(-1, 3), self.pulled_at)

        (_, long), (turned, longer) = jax.jvp(path, (near,), (y - near,))
        law = force - self._pushes(near, tension) - turned
        return jnp.append(law, self._taut(_rest_length(self) - long - longer, tension, drive))

    def _pushes(self, y: Float[Array, " p"], tension: Float[Array, ""]) -> Float[Array, " p"]:
        """The forces (p,) [N] of a tension on guides at y (p,) m."""
        return guide_forces(y.reshape(-1, 3), self.pulled_at, tension, self.friction).ravel()

    def _taut(
        self, shorter: Float[Array, ""], tension: Float[Array, ""], drive: Float[Array, "1"]
    ) -> Float[Array, ""]:
        """0 ≤ T ⊥ slack ≥ 0 [N] of a path that is shorter by so much [m] than at rest."""
        slack = self.stiffness * (shorter - drive[0] + self.compliance * tension)
        return jnp.where(tension - slack > 0, slack, tension)

    def conjugate(self, force, internal, y):
        """The tension (1,) [N]."""
        del force, y
        return internal

    def by_force(self, internal, drive):
        """Pulled with the tension, whatever the shortening."""
        del drive
        return internal[:0], internal

    @property
    def rest_length(self) -> Float[Array, ""]:
        """ℓ₀ [m] on the body at rest."""
        return _rest_length(self)


def _anchored(
    body: AbstractBody, before: Float[np.ndarray, "b 3"], middle: Float[np.ndarray, "3"], radius: float
) -> tuple[MaterialPoints, Float[np.ndarray, "a 3"]]:
    """Guides (b, 3) m and the points (a, 3) m of a ball of `radius` [m] around `middle` (3,) m, embedded; and
    the latter.
    """
    anchor = ball(middle, radius)
    try:
        return MaterialPoints.embedded(body, np.concatenate([before, anchor])), anchor
    except MeshError as error:
        room = float(nearest_places(body, middle[None]).apart[0])
        raise MeshError(
            f"anchor_radius: the ball of {1e3 * radius:g} mm around guide {len(before)} reaches out of the "
            f"body: at most {1e3 * room:.3g} mm have room there; make it that small, or move the guide"
        ) from error


def _rest_length(cable: PulledCable | ShortenedCable) -> Float[Array, ""]:
    """ℓ₀ [m] on the body at rest."""
    return length(cable.ports.location, cable.pulled_at)
