"""What may touch a body's surface anywhere, each a load for every place (3, 3), see `Skin`."""

from abc import abstractmethod
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.body.base import AbstractBody
from softfuse.functional.contact import Contact, ContactSurface
from softfuse.functional.pressure_cells import PressureCells, even, flat_punch
from softfuse.functional.skin import Skin
from softfuse.material.base import constant
from softfuse.mechanics.load import AbstractContact
from softfuse.mechanics.patch import NormalPatches, PatchForces, frame_ports
from softfuse.mechanics.punch import Punch, PunchAtDepth
from softfuse.mechanics.round_indenter import RoundIndenter, RoundIndenterAtDepth

Surface = Skin | ContactSurface
"""Pressed anywhere along its own normals; or along one direction, with the tangents that belong to it,
whatever frame a place has: flat tops, whose faces are found faster so."""


def disc_at(
    surface: Surface,
    cells: PressureCells,
    radius: Float[Array, ""],
    body: AbstractBody,
    place: Float[Array, "3 3"],
    *,
    compliance: Float[Array, ""] | float = 0.0,
) -> Contact:
    """The disc of `radius` [m] over a place (3, 3) of a body's surface."""
    return Contact(surface.around(body.rest, place), cells, place[0], radius, compliance)


class AbstractIndenter(AbstractContact):
    """Something rigid that presses with one force, or to one depth."""

    @property
    def arms(self):
        """The total force, at the place."""
        return jnp.zeros(1)

    def at_depth(self):
        """The indenter."""
        return AtDepth(self)

    @abstractmethod
    def load(self, body: AbstractBody, place: Array) -> Punch | RoundIndenter:
        """The indenter at a place (3, 3), driven by its force [N]."""


class FlatIndenter(AbstractIndenter):
    """A flat disc of `radius` [m], through a layer of `compliance` [m/Pa]."""

    surface: Surface
    cells: PressureCells
    radius: Float[Array, ""] = eqx.field(converter=constant)
    compliance: Float[Array, ""] = eqx.field(default=0.0, converter=constant)

    def discs(self, body, place):
        """The disc, with its layer."""
        return [disc_at(self.surface, self.cells, self.radius, body, place, compliance=self.compliance)]

    def stands(self, body, place):
        """With all of its face: over an edge a rigid disc would tilt."""
        return self.overlap(body, place) >= 1.0

    def recut(self, rims, sectors):
        """Such a punch; the same where the pressure is even."""
        return self if self.cells.count == 1 else replace(self, cells=flat_punch(rims, sectors))

    def load(self, body, place):
        """The disc at a place (3, 3), driven by its force [N]."""
        (disc,) = self.discs(body, place)
        return Punch.of(disc, body)


class SphereIndenter(AbstractIndenter):
    """A sphere of `radius` R [m] that may touch the surface within `extent` [m] of a place, at `cells`."""

    surface: Surface
    cells: PressureCells
    radius: Float[Array, ""] = eqx.field(converter=constant)
    extent: Float[Array, ""] = eqx.field(converter=constant)

    def discs(self, body, place):
        """Where it may touch."""
        return [disc_at(self.surface, self.cells, self.extent, body, place)]

    def recut(self, rims, sectors):
        """With such cells where it may touch."""
        return replace(self, cells=even(rims, sectors))

    def load(self, body, place):
        """The sphere at a place (3, 3), driven by its force [N]."""
        (disc,) = self.discs(body, place)
        return RoundIndenter.of(disc, body, self.radius, jnp.zeros(2))


class CylinderIndenter(AbstractIndenter):
    """A cylinder of `radius` R [m] along the unit vector `axis` (2,) in a place's tangents u, v, that may
    touch the surface at `cells`, in units of `extent` [m]: a strip whose half length that is.
    """

    surface: Surface
    cells: PressureCells
    radius: Float[Array, ""] = eqx.field(converter=constant)
    extent: Float[Array, ""] = eqx.field(converter=constant)
    axis: Float[Array, "2"] = eqx.field(default=(1.0, 0.0), converter=constant)

    @property
    def seen_axis(self) -> Float[Array, "2"]:
        """The axis in the tangents of what is seen along d, which are u and −v of a place."""
        return self.axis * jnp.array([1.0, -1.0])

    def discs(self, body, place):
        """The strip where it may touch."""
        axis = self.seen_axis
        turned = jnp.stack([axis, jnp.array([-1.0, 1.0]) * axis[::-1]])
        cells = eqx.tree_at(lambda c: c.points, self.cells, self.cells.points @ turned)
        return [disc_at(self.surface, cells, self.extent, body, place)]

    def load(self, body, place):
        """The cylinder at a place (3, 3), driven by its force [N]."""
        (disc,) = self.discs(body, place)
        return RoundIndenter.of(disc, body, self.radius, self.seen_axis)


class AtDepth(AbstractContact):
    """An indenter that is driven by its depth [m] from where it first touches the body at rest."""

    indenter: AbstractIndenter

    @property
    def arms(self):
        """The depth, at the place."""
        return jnp.zeros(1)

    def load(self, body: AbstractBody, place: Array) -> PunchAtDepth | RoundIndenterAtDepth:
        """The indenter at a place (3, 3), driven by its depth."""
        return self.indenter.load(body, place).at_depth()

    def discs(self, body, place):
        """Those of the indenter."""
        return self.indenter.discs(body, place)

    def stands(self, body, place):
        """Where the indenter does."""
        return self.indenter.stands(body, place)

    def recut(self, rims, sectors):
        """The indenter with such cells."""
        return replace(self, indenter=self.indenter.recut(rims, sectors))


class SurfacePatches(AbstractContact):
    """Uniform patches of `radius` [m] at `offsets` (c,) [m] along u from a place, each pressed along its
    current normal. Forces on two stand for one force anywhere between them.
    """

    surface: Surface
    cells: PressureCells
    radius: Float[Array, ""] = eqx.field(converter=constant)
    offsets: Float[Array, " c"] = eqx.field(default=(0.0,), converter=constant)

    @property
    def arms(self):
        """Those of the patches."""
        return self.offsets

    def discs(self, body, place):
        """The patches."""
        return [
            disc_at(
                self.surface, self.cells, self.radius, body, jnp.asarray(place).at[0].add(offset * place[1])
            )
            for offset in self.offsets
        ]

    def load(self, body, place) -> NormalPatches:
        """The patches at a place (3, 3), driven by their forces [N]."""
        return NormalPatches.of(self.discs(body, place), body)


class SurfaceForce(AbstractContact):
    """A uniform patch of `radius` [m] that is pushed with a force vector: along its current normal, and along
    the tangents that u and v become.
    """

    surface: Surface
    cells: PressureCells
    radius: Float[Array, ""] = eqx.field(converter=constant)

    @property
    def arms(self):
        """Normal force, and two tangential ones, all at the place."""
        return jnp.zeros(3)

    @property
    def shares(self):
        """All on the first."""
        return np.array([1.0, 0.0, 0.0])

    def discs(self, body, place):
        """The patch."""
        return [disc_at(self.surface, self.cells, self.radius, body, place)]

    def load(self, body, place) -> PatchForces:
        """The patch at a place (3, 3), driven by its force vector [N]."""
        return PatchForces(frame_ports(self.discs(body, place), body))
