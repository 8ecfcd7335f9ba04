"""Gas in sealed cavities: it pushes on the walls, and its pressure is what a sensor reads.

The absolute pressure p and the volume V of gas in the cavity and in the tube and port behind it, V_dead, obey
p (V + V_dead)^κ = const: κ = 1 isothermal (slow), κ = 1.4 adiabatic air (fast). Gauge pressure is p − p_atm.
The drive is the absolute pressure P₀ [Pa] that the same gas has at rest volume V₀ + V_dead: p_atm when sealed
at rest, more after pumping, less after a leak. Source: Navarro et al. 2020, eqs. 5 to 7, which leave the
pressure on the walls out.
"""

from dataclasses import replace

import jax.numpy as jnp
from jaxtyping import Array, Float

from softfuse.body.base import AbstractBody
from softfuse.functional.cavity import Cavity
from softfuse.mechanics.load import AbstractLoad, AbstractPorts, Sizes
from softfuse.mechanics.volume import VolumePorts


class SealedGas(AbstractLoad):
    """Gas in k cavities of rest volumes `rest` (k,) [m³] and dead volumes `dead` (k,) [m³].

    `atmosphere` [Pa]: outside, absolute; `exponent` κ [-].
    """

    ports: AbstractPorts
    rest: Float[Array, " k"]
    dead: Float[Array, " k"]
    atmosphere: Float[Array, ""]
    exponent: Float[Array, ""]

    @classmethod
    def of(
        cls,
        cavities: tuple[Cavity, ...],
        body: AbstractBody,
        dead: Float[Array, " k"],
        *,
        atmosphere: float = 101325.0,
        exponent: float = 1.0,
    ) -> "SealedGas":
        """Gas in cavities of a body at rest. Raises MeshError as `VolumePorts.of` does."""
        ports = VolumePorts.of(cavities, body)
        rest = jnp.stack([cavity(body.rest) for cavity in cavities])
        return cls(ports, rest, jnp.asarray(dead, float), jnp.asarray(atmosphere), jnp.asarray(exponent))

    def sealed_in(self, body: AbstractBody) -> "SealedGas":
        """The same in the cavities of a body of other rest nodes."""
        return replace(self, rest=self.ports.values(body, jnp.zeros(body.n)))

    @property
    def sizes(self):
        """One port, force and drive for each cavity."""
        k = self.rest.shape[0]
        return Sizes(ports=k, forces=k, internal=0, drives=k)

    def start(self):
        """No gauge pressure: sealed at rest under the atmosphere."""
        k = self.rest.shape[0]
        return jnp.zeros(k), jnp.zeros(0), jnp.full(k, self.atmosphere)

    def units(self):
        """A thousandth of the atmosphere."""
        return jnp.full(self.rest.shape, 1e-3 * self.atmosphere)

    def pressure(self, volume: Float[Array, " k"], filling: Float[Array, " k"]) -> Float[Array, " k"]:
        """Gauge pressures (k,) [Pa] at cavity volumes (k,) [m³] of gas whose pressure at rest is
        `filling`.
        """
        ratio = (self.rest + self.dead) / (volume + self.dead)
        return filling * ratio**self.exponent - self.atmosphere

    def equations(self, force, internal, y, drive):
        """p_gauge − P₀ ((V₀ + V_dead) / (V + V_dead))^κ + p_atm = 0 (k,)."""
        del internal
        return force - self.pressure(y, drive)

    def conjugate(self, force, internal, y):
        """The gauge pressures (k,) [Pa]."""
        del internal, y
        return force
