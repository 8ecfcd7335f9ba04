"""What a tracker is given and what it says, frame by frame."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from jaxtyping import Bool, Float

from softfuse.sensors.zero_drift import ReadingDrift


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame of raw readings (n,) in the order of the robot's channels, commands last, at a time [s].

    NaN stands for what is missing.
    """

    time_s: float
    raw: Float[np.ndarray, " n"]


def along(places: Float[np.ndarray, "c 3 3"], points: Float[np.ndarray, "c 3"]) -> Float[np.ndarray, " 2*c"]:
    """How far points (c, 3) m are along the tangents of places (c, 3, 3), one after the other (2 c,) [m]."""
    return np.einsum("cti,ci->ct", places[:, 1:], points).ravel()


def along_axes(
    places: Float[np.ndarray, "c 3 3"], sigma_m: Float[np.ndarray, "c 2"]
) -> Float[np.ndarray, "c 3"]:
    """Standard deviations (c, 3) [m] along x, y and z of points with such along the tangents (c, 2) [m]."""
    return np.sqrt(np.einsum("ck,cki->ci", sigma_m**2, places[:, 1:] ** 2))


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the readings of one frame say of the drives and of places, whatever was known before: those are
    off by `misfit` from drives u₀ at places p₀ on, y − s(u₀, p₀) = W (u − u₀) + G (p − p₀) + error.

    `misfit` (k,) in SI, NaN where a reading took no part; `sigma` (k,) of the readings; `drive` u₀ (D,);
    `compliance` W (k, D); `place_m` p₀ (P,): along both tangents of each contact, and `by_place` G (k, P), 0
    where readings were not to tell places; `seen_m`, `seen_sigma_m` (P,): what the senses alone say of
    places, and its standard deviation, NaN where they say nothing; `acting` (D,): drives that may be other
    than 0; `model` (k, k): covariance of the model's error; `drift`: what readings drift by.
    """

    misfit: Float[np.ndarray, " k"]
    sigma: Float[np.ndarray, " k"]
    drive: Float[np.ndarray, " D"]
    compliance: Float[np.ndarray, "k D"]
    place_m: Float[np.ndarray, " P"]
    by_place: Float[np.ndarray, "k P"]
    seen_m: Float[np.ndarray, " P"]
    seen_sigma_m: Float[np.ndarray, " P"]
    acting: Bool[np.ndarray, " D"]
    model: Float[np.ndarray, "k k"]
    drift: ReadingDrift

    @classmethod
    def of_rest(
        cls,
        reading: Float[np.ndarray, " k"],
        sigma: Float[np.ndarray, " k"],
        drives: int,
        contacts: int,
        drift: ReadingDrift,
    ) -> Self:
        """Readings (k,) of standard deviations (k,) of a body on which none of so many drives acts."""
        k, places = len(reading), 2 * contacts
        nowhere = np.full(places, np.nan)
        unmoved = np.zeros(drives), np.zeros((k, drives)), np.zeros(places), np.zeros((k, places))
        return cls(
            reading, sigma, *unmoved, nowhere, nowhere, np.zeros(drives, bool), np.zeros((k, k)), drift
        )


@dataclass(frozen=True, eq=False)
class Tracked:
    """What one frame says of c contacts, k readings and what is attached.

    `touching` (c,): what touches; `location_m` (c, 3): where on the body at rest, as contacts are seen and,
    as far as that leaves open, as the readings tell, NaN where unknown; `location_sigma_m` (c, 2): standard
    deviations along the tangents, NaN where unknown; `contact_force_N` (c,): NaN where unknown, 0 where
    nothing touches; `force_covariance_N2` (c, c): see `posterior_covariance`, NaN where the force is;
    `places` (c, 3, 3): where the robot's contact was taken to press; `covariance` (m, m): of all drives in
    their units, then of places along their tangents [m], if readings may tell them; `attached`
    (a,): what the attached loads are driven with; `reading`, `sigma` (k,): measured, and which count, `valid`
    (k,); `misfit` (k,): measured minus modelled, NaN without an estimate and where a reading took no part;
    `evidence`: for smoothing, None where readings do not drift, the state was lost, or only readings tell of
    a place; `details`: what each sensor knows besides, by its name; `latency_s`: wall time of the frame.
    """

    time_s: float
    touching: Bool[np.ndarray, " c"]
    location_m: Float[np.ndarray, "c 3"]
    location_sigma_m: Float[np.ndarray, "c 2"]
    contact_force_N: Float[np.ndarray, " c"]
    force_covariance_N2: Float[np.ndarray, "c c"]
    places: np.ndarray
    covariance: Float[np.ndarray, "m m"]
    attached: Float[np.ndarray, " a"]
    reading: Float[np.ndarray, " k"]
    sigma: Float[np.ndarray, " k"]
    valid: Bool[np.ndarray, " k"]
    misfit: Float[np.ndarray, " k"]
    evidence: Evidence | None
    details: Any
    statuses: tuple[str, ...]
    latency_s: float

    @property
    def contacts(self) -> int:
        """How many touch."""
        return int(self.touching.sum())

    @property
    def force_N(self) -> float:
        """Sum of the contacts' forces [N]; NaN when one is unknown."""
        return float(np.sum(self.contact_force_N))

    @property
    def contact_sigma_N(self) -> Float[np.ndarray, " c"]:
        """Standard deviation (c,) of each contact's force [N]."""
        return np.sqrt(np.diag(self.force_covariance_N2))

    @property
    def force_sigma_N(self) -> float:
        """Standard deviation of the sum of the contacts' forces [N]; NaN when one is unknown."""
        return float(np.sqrt(np.sum(self.force_covariance_N2)))

    @property
    def centre_m(self) -> Float[np.ndarray, "3"]:
        """Force-weighted middle of the contacts (3,) [m]; their mean without forces, NaN without contacts."""
        if not self.contacts:
            return np.full(3, np.nan)
        return self._shares[self._shares > 0] @ self.location_m[self._shares > 0]

    @property
    def _shares(self) -> Float[np.ndarray, " c"]:
        """How much each contact counts for their middle (c,), in all 1 where there are some."""
        force = np.where(self.touching, self.contact_force_N, 0.0)
        weight = force if force.sum() > 0 else self.touching.astype(float)
        return np.where(weight > 0, weight, 0.0) / max(weight[weight > 0].sum(), np.finfo(float).tiny)

    @property
    def axis_sigma_m(self) -> Float[np.ndarray, "c 3"]:
        """Standard deviations (c, 3) [m] of the contacts' places along x, y and z; NaN where unknown."""
        return along_axes(self.places, self.location_sigma_m)

    @property
    def centre_sigma_m(self) -> Float[np.ndarray, "3"]:
        """Standard deviations (3,) [m] of the middle along x, y and z, of contacts that are located
        independently; NaN where one is unknown.
        """
        share = self._shares[self._shares > 0]
        if not self.contacts:
            return np.full(3, np.nan)
        return np.sqrt(share**2 @ self.axis_sigma_m[self._shares > 0] ** 2)

    @property
    def residual(self) -> float:
        """Root mean square misfit [standard deviations] of readings with a part; NaN without an estimate."""
        known = np.isfinite(self.misfit)
        return (
            float(np.sqrt(np.mean((self.misfit[known] / self.sigma[known]) ** 2))) if known.any() else np.nan
        )
