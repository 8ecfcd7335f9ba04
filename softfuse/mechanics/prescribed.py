"""Ports on which the force is prescribed, or the displacement.

With `LinearPorts` a force is a dead load or a free force vector on a point, with `VolumePorts` a gauge
pressure; a displacement is a support that moves and holds in both directions, its force the multiplier.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from softfuse.body.base import AbstractBody
from softfuse.mechanics.load import AbstractLoad, AbstractPorts, Sizes


class PrescribedForce(AbstractLoad):
    """f = u on every port; `rest` (p,): the ports' values at rest, `unit` (p,): typical sizes of the forces,
    in SI units.
    """

    ports: AbstractPorts
    rest: Float[Array, " p"]
    unit: Float[Array, " p"]

    @classmethod
    def on(cls, ports: AbstractPorts, body: AbstractBody, unit: Float[Array, " p"]) -> "PrescribedForce":
        """Forces of typical sizes `unit` (p,) on ports of a body."""
        return cls(ports, ports.values(body, jnp.zeros(body.n)), unit)

    @property
    def sizes(self):
        """As many forces and drives as ports."""
        p = self.unit.shape[0]
        return Sizes(ports=p, forces=p, internal=0, drives=p)

    def start(self):
        """No force."""
        p = self.unit.shape[0]
        return jnp.zeros(p), jnp.zeros(0), jnp.zeros(p)

    def units(self):
        """The given ones."""
        return self.unit

    def equations(self, force, internal, y, drive):
        """f − u = 0 (p,)."""
        del internal, y
        return force - drive

    def conjugate(self, force, internal, y):
        """How far the ports have moved (p,)."""
        del force, internal
        return y - self.rest


class PrescribedDisplacement(AbstractLoad):
    """y − y_rest = u on every port, whatever force that takes; fields as those of `PrescribedForce`."""

    ports: AbstractPorts
    rest: Float[Array, " p"]
    unit: Float[Array, " p"]

    @classmethod
    def on(
        cls, ports: AbstractPorts, body: AbstractBody, unit: Float[Array, " p"]
    ) -> "PrescribedDisplacement":
        """Displacements whose forces have typical sizes `unit` (p,) on ports of a body."""
        return cls(ports, ports.values(body, jnp.zeros(body.n)), unit)

    @property
    def sizes(self):
        """As many forces and drives as ports."""
        p = self.unit.shape[0]
        return Sizes(ports=p, forces=p, internal=0, drives=p)

    def start(self):
        """No force, no displacement."""
        p = self.unit.shape[0]
        return jnp.zeros(p), jnp.zeros(0), jnp.zeros(p)

    def units(self):
        """The given ones."""
        return self.unit

    def equations(self, force, internal, y, drive):
        """y − y_rest − u = 0 (p,)."""
        del force, internal
        return y - self.rest - drive

    def conjugate(self, force, internal, y):
        """The forces (p,)."""
        del internal, y
        return force
