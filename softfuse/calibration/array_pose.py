"""Fitting the pose of an electrode array to presses of known place (`crossed.sensor`).

To first order a contact at x is placed at l, x − l = c + α (−l_y, l_x) + (ε_x l_x, ε_y l_y), with normal
priors of the shift c, the turn α and the stretches ε. What then is left has the variance f² σ² + κ² d²,
with the σ that the fit of the peak promises and the depth d of the dent; it is alike in the samples of one
press (ρ, as in `robust`), and lets go of a press that nothing explains (`robust`). A few presses hardly
tell f and κ: f² and κ² are their means over what the locations leave open of them, under normal priors of
ln f and of κ ≥ 0.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float, Int

from softfuse.calibration.adjustment import Measure
from softfuse.calibration.fit import AbstractPosterior
from softfuse.calibration.robust import Explained, Linear, alike_in_press, explained
from softfuse.errors import SoftfuseError
from softfuse.estimation.model_error import whitening

_ALIKE = 0.8
"""Correlation of the locations of one press: the one that makes the nominal recording of the reference block
likeliest.
"""

_LN_FACTORS = np.log(np.geomspace(0.2, 10.0, 17))
"""ln f over which its variance is averaged."""

_PARTS = np.append(0.0, np.geomspace(0.005, 0.5, 13))
"""κ over which its variance is averaged."""

_WIDTHS = np.gradient(_PARTS) * np.where(np.isin(_PARTS, _PARTS[[0, -1]]), 0.5, 1.0)
"""How much of κ each of them stands for."""


@dataclass(frozen=True, eq=False)
class Located:
    """s samples of presses at places (s, 2) m, where the array placed them (s, 2) m, with which standard
    deviations (s, 2) m, how deep their dents are (s,) m, and the number of the press (s,) each belongs to.
    """

    place_m: Float[np.ndarray, "s 2"]
    location_m: Float[np.ndarray, "s 2"]
    sigma_m: Float[np.ndarray, "s 2"]
    dent_m: Float[np.ndarray, " s"]
    press: Int[np.ndarray, " s"]

    @property
    def slope(self) -> Float[np.ndarray, "s 2 5"]:
        """Of place minus location in the five parameters of `PoseFit`."""
        return pose_slopes(self.location_m)


def pose_slopes(location_m: Float[np.ndarray, "s 2"]) -> Float[np.ndarray, "s 2 5"]:
    """Of places on the body minus locations (s, 2) m in the five parameters of `PoseFit`."""
    x, y = location_m.T
    one, none = np.ones_like(x), np.zeros_like(x)
    along_x = np.stack([one, none, -y, x, none], axis=1)
    along_y = np.stack([none, one, x, none, y], axis=1)
    return np.stack([along_x, along_y], axis=1)


@dataclass(frozen=True)
class PosePrior:
    """Standard deviations of the shift [m], the turn [rad], the stretches [-], of ln f, and of κ [-]."""

    shift_m: float
    turn: float
    stretch: float
    ln_factor: float
    dent_part: float

    @property
    def sigma(self) -> Float[np.ndarray, "5"]:
        """Of the five parameters of `PoseFit`; none is quite 0."""
        each = [self.shift_m, self.shift_m, self.turn, self.stretch, self.stretch]
        return np.maximum(each, 1e-12)


@dataclass(frozen=True, eq=False)
class PoseFit(AbstractPosterior):
    """Shift along x and y [m], turn [rad] and ln of the stretches along x and y: `value` (5,), `covariance`
    (5, 5), `prior_sigma` (5,); `factor` f [-], with what is not known of these; `dent_part` κ [-];
    `before_m`, `after_m` (s, 2): place minus location, as configured and as fitted.
    """

    names: ClassVar[tuple[str, ...]] = (
        "array shift x",
        "array shift y",
        "array turn",
        "array stretch x",
        "array stretch y",
    )
    measures: ClassVar[tuple[Measure, ...]] = (
        Measure.length,
        Measure.length,
        Measure.angle,
        Measure.factor,
        Measure.factor,
    )

    value: Float[np.ndarray, "5"]
    covariance: Float[np.ndarray, "5 5"]
    prior_sigma: Float[np.ndarray, "5"]
    factor: float
    dent_part: float
    before_m: Float[np.ndarray, "s 2"]
    after_m: Float[np.ndarray, "s 2"]


def fit_pose(located: Located, prior: PosePrior, area_m: Float[np.ndarray, "a 2"]) -> PoseFit:
    """The pose that presses tell; area (a, 2) m: where what is not known of it is averaged for the factor.

    Raises SoftfuseError when nothing explains the presses.
    """
    sigma = prior.sigma

    # Without dents that spread places there is one κ, 0.
    likely_parts = len(_PARTS) if prior.dent_part > 0 else 1
    ln_factors, parts = np.meshgrid(_LN_FACTORS, _PARTS[:likely_parts], indexing="ij")

    def likely(ln_factor: float, part: float) -> float:
        try:
            found, ln_det = _explained(located, float(np.exp(ln_factor)), part, sigma)
        except SoftfuseError:
            # Where hardly a press fits into so small a spread, the search for what fits need not end.
            return -np.inf
        unlikely = (ln_factor / prior.ln_factor) ** 2 + (part / max(prior.dent_part, 1e-12)) ** 2
        return found.ln_evidence - 0.5 * (ln_det + unlikely)

    evidence = np.vectorize(likely)(ln_factors, parts) + np.log(_WIDTHS[:likely_parts])
    if not np.isfinite(evidence).any():
        raise SoftfuseError(
            "no spread explains where the electrodes placed the presses: check the true places, and that the "
            "electrodes' channels are in the order of their lines"
        )
    weight = np.exp(evidence - evidence.max())
    factor, part = (
        float(np.sqrt(np.sum(weight * square) / np.sum(weight)))
        for square in (np.exp(2 * ln_factors), parts**2)
    )
    found, _ = _explained(located, factor, part, sigma)
    value = found.z * sigma
    covariance = np.linalg.inv(found.information) * np.outer(sigma, sigma)
    slopes = pose_slopes(area_m)
    unknown = np.einsum("sip,pq,siq->si", slopes, covariance, slopes).mean()
    before = located.place_m - located.location_m
    return PoseFit(
        value,
        covariance,
        sigma,
        float(np.sqrt(factor**2 + unknown / np.mean(located.sigma_m**2))),
        part,
        before,
        before - located.slope @ value,
    )


def _explained(
    located: Located, factor: float, part: float, prior: Float[np.ndarray, "5"]
) -> tuple[Explained, float]:
    """The likeliest parameters, in prior standard deviations, with f and κ, and ln det of the covariance."""
    _, press = np.unique(located.press, return_inverse=True)
    count = len(press)
    alike = alike_in_press(press, _ALIKE)
    left, slope, ln_det = [], [], 0.0
    away = located.place_m - located.location_m
    for axis in range(2):
        spread = np.hypot(factor * located.sigma_m[:, axis], part * located.dent_m)
        white = whitening(alike * np.outer(spread, spread), np.ones(count, bool))
        left.append(white @ away[:, axis])
        slope.append(white @ (located.slope[:, axis] * prior))
        ln_det -= 2 * float(np.sum(np.log(np.diag(white))))
    group = np.concatenate([press, press.max() + 1 + press])
    linear = Linear(np.concatenate(left), np.concatenate(slope), group, np.ones(2 * count, bool))
    return explained(linear, int(group.max()) + 1), ln_det
