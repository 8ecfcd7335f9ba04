"""Contacts at electrodes against truth: forces, contacts that were missed or found elsewhere, phantom forces.

An estimated contact belongs to the true one at the same electrode. Force error: |F − F_true| / F_true. A
phantom force is an estimated one while nothing presses.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from softfuse.experiment.accuracy import Spread, spread

NOWHERE = -1
"""The electrode of a contact that is none."""


@dataclass(frozen=True, eq=False)
class ContactSamples:
    """Estimates and truth at the instants that count, with c estimated and t true contacts.

    `level` (s,): which depth, from 1; `electrode` (s, c), `true_electrode` (s, t): where they are, `NOWHERE`
    where there is none; `force_N` (s, c): NaN where there is no estimate; `true_force_N` (s, t): 0 without
    contact.
    """

    level: Int[np.ndarray, " s"]
    electrode: Int[np.ndarray, "s c"]
    force_N: Float[np.ndarray, "s c"]
    true_electrode: Int[np.ndarray, "s t"]
    true_force_N: Float[np.ndarray, "s t"]

    @property
    def true(self) -> Bool[np.ndarray, "s t"]:
        """Where something truly presses on an electrode (s, t)."""
        return (self.true_force_N > 0) & (self.true_electrode != NOWHERE)

    @property
    def _same(self) -> Bool[np.ndarray, "s t c"]:
        same = self.true_electrode[:, :, None] == self.electrode[:, None, :]
        return same & self.true[:, :, None]

    @property
    def matched_N(self) -> Float[np.ndarray, "s t"]:
        """Estimated forces of the true contacts (s, t) [N], NaN where a contact is missed or has none."""
        force = np.where(self._same, self.force_N[:, None, :], 0.0).sum(axis=2)
        return np.where(self._same.any(axis=2), force, np.nan)

    @property
    def force_error(self) -> Float[np.ndarray, "s t"]:
        """|F − F_true| / F_true (s, t) [-], NaN where there is no contact or no estimate."""
        known = np.where(self.true, self.true_force_N, np.nan)
        return np.abs(self.matched_N / known - 1)

    @property
    def missed(self) -> int:
        """How many true contacts no estimated one stands at."""
        return int(np.sum(self.true & ~self._same.any(axis=2)))

    @property
    def misplaced(self) -> int:
        """How many estimated contacts stand where truly nothing presses."""
        return int(np.sum((self.electrode != NOWHERE) & ~self._same.any(axis=1)))


def contact_force_table(samples: ContactSamples) -> dict[str, Spread]:
    """Force error [-] over all true contacts, by number of the contact, then by level."""
    error = samples.force_error
    by_contact = {f"contact{c}": spread(error[:, c]) for c in range(error.shape[1])}
    levels = {f"level_{k}": spread(error[samples.level == k].ravel()) for k in np.unique(samples.level)}
    return {"all": spread(error.ravel())} | by_contact | levels


def largest_force(force_N: Float[np.ndarray, " n"], where: Bool[np.ndarray, " n"]) -> float:
    """Largest of those forces (n,) [N] that are known, among the frames where it counts; NaN if none is."""
    known = force_N[where & np.isfinite(force_N)]
    return float(known.max()) if known.size else float("nan")
