"""A flat disc with a prescribed total force: no tension, no penetration.

The ports are the displacements g (m,) under the cells of a `Contact`, counted from its gaps at rest on a
curved surface, the forces those of the cells a (m,),
the internal unknown the disc's depth d. Between the rigid disc and the body lies a layer of springs
(Winkler's foundation: a padded indenter, a thin skin) of compliance c [m/Pa], which a cell of area A
compresses by s a, s = c/A; c = 0 is a bare rigid disc. With the gap h = g + s a − d a cell touches where h =
0 and has lifted off where h > 0: 0 ≤ a ⊥ h ≥ 0, Σ a = F. As equations: with v = a − γ h a cell is on where
v > 0, and then h = 0, else a = 0. The choice of γ > 0 [N/m] does not move the solution. A disc weighs one
nanonewton, so that without a force it rests on those cells that a force would press. Source of the layer:
Johnson, Contact Mechanics, 1985, sec. 4.3.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from softfuse.body.base import AbstractBody
from softfuse.functional.contact import Contact
from softfuse.mechanics.load import AbstractLoad, AbstractPorts, Sizes
from softfuse.mechanics.surface_ports import CellPorts

_WEIGHT = 1e-9  # N
_SOFTENING = 1e-10  # of 1/γ: cells that a coarse mesh cannot tell apart share their force


class Punch(AbstractLoad):
    """The disc's cells as ports, the compliance s (m,) [m/N] of the layer under each, and the stiffness γ
    [N/m] that weighs gaps against forces.
    """

    ports: AbstractPorts
    layer: Float[Array, " m"]
    stiffness: Float[Array, ""]

    @classmethod
    def of(cls, contact: Contact, body: AbstractBody) -> "Punch":
        """The disc of a contact on a body; γ is μ times the disc's radius."""
        return cls.on(CellPorts.of(contact, body), contact, body)

    @classmethod
    def on(cls, ports: CellPorts, contact: Contact, body: AbstractBody) -> "Punch":
        """The disc of a contact with known ports of its cells."""
        gamma = jax.lax.stop_gradient(body.pressure_unit * contact.radius)
        return cls(ports, contact.compliance / contact.areas, gamma)

    def at_depth(self) -> "PunchAtDepth":
        """The same disc, driven by its depth."""
        return PunchAtDepth(self.ports, self.layer, self.stiffness)

    @property
    def sizes(self):
        """m ports with as many forces; the depth; the total force."""
        m = self.layer.shape[0]
        return Sizes(ports=m, forces=m, internal=1, drives=1)

    def start(self):
        """No force, no depth."""
        return jnp.zeros(self.sizes.forces), jnp.zeros(1), jnp.zeros(1)

    def units(self):
        """Forces in N, the depth in F/γ of 1 N."""
        return jnp.append(jnp.ones(self.sizes.forces), 1 / self.stiffness)

    def equations(self, force, internal, y, drive):
        """γ h = 0 or a = 0 for each cell (m,), then Σ a − F = 0 [N]."""
        shut = self.stiffness * _gap(self, force, y, internal[0]) + _SOFTENING * force
        law = jnp.where(self.touching(force, internal, y), shut, force)
        return jnp.append(law, jnp.sum(force) - drive[0] - _WEIGHT)

    def conjugate(self, force, internal, y):
        """The depth (1,) [m]."""
        del force, y
        return internal

    def touching(
        self, force: Float[Array, " m"], internal: Float[Array, " 1"], y: Float[Array, " m"]
    ) -> Bool[Array, " m"]:
        """Which cells are on (m,); one always is, or nothing would hold the disc."""
        v = force - self.stiffness * _gap(self, force, y, internal[0])
        return (v > 0) | (v >= jnp.max(v))


class PunchAtDepth(AbstractLoad):
    """The same disc with a prescribed depth d [m], counted from where it first touches the body at rest;
    above the body it rests on nothing.
    """

    ports: AbstractPorts
    layer: Float[Array, " m"]
    stiffness: Float[Array, ""]

    @property
    def sizes(self):
        """m ports with as many forces; the depth."""
        m = self.layer.shape[0]
        return Sizes(ports=m, forces=m, internal=0, drives=1)

    def start(self):
        """No force, no depth."""
        return jnp.zeros(self.sizes.forces), jnp.zeros(0), jnp.zeros(1)

    def units(self):
        """Forces in N."""
        return jnp.ones(self.sizes.forces)

    def equations(self, force, internal, y, drive):
        """γ h = 0 or a = 0 for each cell (m,) [N]."""
        del internal
        gap = self.stiffness * _gap(self, force, y, drive[0])
        return jnp.where(force - gap > 0, gap + _SOFTENING * force, force)

    def conjugate(self, force, internal, y):
        """The total force (1,) [N]."""
        del internal, y
        return jnp.sum(force, keepdims=True)


def _gap(
    punch: Punch | PunchAtDepth, force: Float[Array, " m"], y: Float[Array, " m"], depth: Float[Array, ""]
) -> Float[Array, " m"]:
    """h (m,) [m]."""
    return y + punch.layer * force - depth
