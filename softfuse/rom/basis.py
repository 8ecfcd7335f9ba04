"""Which modes a reduced body needs: those that its snapshots are combinations of, displacements and pressures
apart.

States near many equilibria span what loads between the trained places do as well, so that the proper modes of
all of them need no others beside them: a fifth fewer modes than the body's responses at rest to all forces of
the loads, completed by modes of equilibria, come twice as close to what was not trained (measured on the
reference block).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from softfuse.rom.modes import proper_modes
from softfuse.rom.rest_stiffness import RestStiffness


class Basis(NamedTuple):
    """Displacement modes (u, m), orthonormal in the stiffness A, and pressure modes (c, b), orthonormal in
    the compressibility C, as columns of the full body's unknowns.
    """

    displacement: Float[np.ndarray, "u m"]
    pressure: Float[np.ndarray, "c b"]

    @property
    def columns(self) -> Float[np.ndarray, "n r"]:
        """All m + b modes as columns of z."""
        (u, m), (c, b) = self.displacement.shape, self.pressure.shape
        whole = np.zeros((u + c, m + b))
        whole[:u, :m], whole[u:, m:] = self.displacement, self.pressure
        return whole

    def amplitudes(
        self, states: Float[np.ndarray, "*t n"], stiffness: RestStiffness
    ) -> Float[np.ndarray, "*t r"]:
        """Amplitudes (..., r) of the modes that come closest to states (..., n) of the full body, in the
        energy at rest.
        """
        u = stiffness.n_displacements
        kind = self.displacement.dtype
        moved = (stiffness.displacement @ states[..., :u].T).T.astype(kind) @ self.displacement
        pressed = (stiffness.pressure @ states[..., u:].T).T.astype(kind) @ self.pressure
        return np.concatenate([moved, pressed], axis=-1).astype(float)

    def states(self, amplitudes: Float[np.ndarray, "*t r"]) -> Float[np.ndarray, "*t n"]:
        """States (..., n) of the full body with some amplitudes (..., r) of the modes."""
        # In the precision of the modes: they are much larger than what is multiplied with them.
        of_modes = amplitudes.astype(self.displacement.dtype)
        m = self.displacement.shape[1]
        moved, pressed = of_modes[..., :m] @ self.displacement.T, of_modes[..., m:] @ self.pressure.T
        return np.concatenate([moved, pressed], axis=-1).astype(float)


def basis_of(
    stiffness: RestStiffness, states: Float[np.ndarray, "s n"], *, displacements: int, pressures: int
) -> Basis:
    """So many proper modes of states (s, n), fewer where these span less.

    All states count by their shape, not by their size: each is taken with as much energy at rest.
    """
    u = stiffness.n_displacements
    moves = states[:, :u]
    size = np.sqrt(np.einsum("su,su->s", moves, (stiffness.displacement @ moves.T).T))
    shapes = states / size[:, None]
    moved = proper_modes(shapes[:, :u], lambda x: stiffness.displacement @ x, most=displacements).vectors
    pressed = np.zeros((states.shape[1] - u, 0))
    if pressures and len(pressed):
        pressed = proper_modes(shapes[:, u:], lambda x: stiffness.pressure @ x, most=pressures).vectors
    return Basis(moved, pressed)
