"""Which modes a reduced body needs: what loads do to the body at rest, and what is left of its equilibria.

Attachment modes K₀⁻¹g are the body's responses at rest to unit forces g, for all forces that the loads
can exert. They hold the whole linear behaviour, wherever between the trained ones the forces act, and most
of what is nonlinear near a contact, for their amplitudes are free. What equilibria have beyond them is
smooth, and a few proper modes hold it. Source for the term: Craig and Kurdila, Fundamentals of Structural
Dynamics, 2006, ch. 17.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from softfuse.reduction.modes import orthonormal, proper_modes
from softfuse.reduction.rest_stiffness import RestStiffness

_DEPENDENT = 1e-7
"""Of the largest singular value: forces below are combinations of others."""


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


def force_span(rows: Iterable[Float[np.ndarray, "n p"]]) -> Float[np.ndarray, "n f"]:
    """The fewest orthonormal forces (n, f) that all forces of some loads, rows (n, p) of each, are
    combinations of.
    """
    every = np.concatenate(list(rows), axis=1)
    touched = np.flatnonzero(np.any(every != 0, axis=1))
    left, size, _ = np.linalg.svd(every[touched], full_matrices=False)
    kept = size > _DEPENDENT * size[:1].sum()
    span = np.zeros((every.shape[0], int(kept.sum())))
    span[touched] = left[:, kept]
    return span


def basis_of(
    stiffness: RestStiffness,
    attachments: Float[np.ndarray, "n f"],
    snapshots: Float[np.ndarray, "s n"],
    *,
    corrections: int,
    pressures: int,
) -> Basis:
    """The attachment modes K₀⁻¹g (n, f), so many `corrections` that equilibria (s, n) have beyond them, and
    so many `pressures`.

    All states count by their shape, not by their size. Fewer modes where the states span less.
    """
    u = stiffness.n_displacements

    def stiff(x):
        return stiffness.displacement @ x

    attached, states = (_scaled(each, u) for each in (attachments.T, snapshots))
    # As many as are independent: proper modes of all responses.
    first = proper_modes(attached[:, :u], stiff, most=attachments.shape[1]).vectors
    left = states[:, :u] - (states[:, :u] @ stiff(first)) @ first.T
    moves = [first]
    if corrections and len(left):
        found = proper_modes(left, stiff, most=corrections).vectors
        moves.append(found - first @ (first.T @ stiff(found)))
    pressed = np.zeros((snapshots.shape[1] - u, 0))
    if pressures and len(pressed):
        both = np.concatenate([attached[:, u:], states[:, u:]])
        pressed = proper_modes(both, lambda x: stiffness.pressure @ x, most=pressures).vectors
    return Basis(orthonormal(np.concatenate(moves, axis=1), stiff), pressed)


def _scaled(states: Float[np.ndarray, "s n"], u: int) -> Float[np.ndarray, "s n"]:
    """States (s, n), each with the largest displacement 1."""
    if not len(states):
        return states
    return states / np.max(np.abs(states[:, :u]), axis=1, keepdims=True)
