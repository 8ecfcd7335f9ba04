"""Loads as they are met while a body is linearised: on springs, and by laws to first order."""

import equinox as eqx
from jaxtyping import Array, Float

from softfuse.mechanics.load import Loads


class HeldLoads(eqx.Module):
    """Loads as the linearised body meets them, its ports supported by springs.

    A cable under tension can hold a body that would buckle by itself; the body's own tangent is then singular
    although the equilibrium is not. So springs k are added to the tangent at such ports and taken off the
    forces again: K + G k Gᵀ answers to f̃ = f + k (y − y_at), and the laws see f. That is exact for any k.

    `around` (M,): internal unknowns around which, and y_at, smooth laws are taken to first order; None for
    laws as they are. On a body that turns by 90° where it is linearised no path is as short as a cable.
    """

    loads: Loads
    at: Float[Array, " P"]
    around: Float[Array, " M"] | None = None

    def force(self, held: Float[Array, " Q"], y: Float[Array, " P"]) -> Float[Array, " Q"]:
        """The forces f (Q,) behind f̃ (Q,) at ports' values y (P,)."""
        return held - self.loads.supports * (y - self.at)[self.loads.carrying]

    def units(self) -> Float[Array, " QM"]:
        """Those of the loads (Q + M,)."""
        return self.loads.units()

    def equations(
        self,
        held: Float[Array, " Q"],
        internal: Float[Array, " M"],
        y: Float[Array, " P"],
        drive: Float[Array, " D"],
    ) -> Float[Array, " QM"]:
        """The laws (Q + M,) at f̃ (Q,)."""
        given = self.force(held, y), internal, y, drive
        if self.around is None:
            return self.loads.equations(*given)
        return self.loads.equations_near(*given, (self.around, self.at))
