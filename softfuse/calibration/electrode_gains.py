"""Fitting the gains of crossed electrodes to presses of known place.

A line e with gain exp h_e reads, under a press at x,

    s_e = exp h_e (A f_e(l, R, d + g) + o),

f of `sensors.peak_model`, l where the array's pose has x (`crossed.sensor`). A gain that rises from line
to line looks like a shift, so that the pose is unknown too, to first order and with the priors of
`array_pose`; what it comes to is thrown away, because locations tell it once more when they have the gains.
So are amplitudes A, offsets o, radius R and gap g of each sample, with the priors of the peak fit. They are
many and nearly linear: what is not known of them, J P Jᵀ, is added to the covariance of the sample's signals,
and J is taken anew about what they are found to be.

Priors are normal, h ~ N(0, σ²). How far the lines of one array differ is not known: as likely as not they
are alike, σ = 0, else σ is anything from the tolerance down to a 32nd of it, equally likely in ln σ. The
posterior is the mean over these, each as likely as it makes the signals. So lines are left alike by presses
that could not tell them apart.

Signals miss the model by their noise and by a part of the sample's largest one, alike in the samples of one
press (ρ, as in `robust`); a press that nothing explains is let go of, as in `robust`. The mean of ln
gain over rows, or columns, looks like their amplitude: only its prior tells it, so that a gain is known no
better than that, while it may be over the mean.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.linalg import block_diag

from softfuse.calibration.adjustment import Measure
from softfuse.calibration.array_pose import pose_slopes
from softfuse.calibration.fit import AbstractPosterior
from softfuse.calibration.robust import FREEDOM, alike_in_press
from softfuse.errors import SoftfuseError
from softfuse.estimation.model_error import whitening
from softfuse.sensors.crossed.peak_model import PeakModel, PeakShape, peak_layers, peak_shape
from softfuse.sensors.crossed.sensor import ArrayPose

_ALIKE = 0.98
"""Correlation of the signals' misfits in one press, noise apart: that of the reference block's recordings."""

_PARTS = np.append(0.5 ** np.arange(6), 1e-3)
"""Of the tolerance: how far the lines of an array may differ; the last: they are alike."""

_LIKELY = np.append(np.full(6, 1 / 12), 1 / 2)
"""How likely each of these is beforehand."""

_AMPLITUDE = 10.0
"""Prior standard deviation of an amplitude, in largest signals: hardly any."""

_FARTHEST = 5.0
"""Standard deviations of its prior: farther a sample's own unknown does not go to explain what cannot be."""

_STEPS = 0.5 ** np.arange(7)
"""Parts of a step that are tried: sums over points of the electrodes have kinks, where none leads down."""

_ROUNDS = 30

_EACH = (0, 0, None, 0)
"""What of a signal is each sample's: place, how it goes with the pose, and its own."""

_ACCURACY = 1e-3
"""Of the logarithm of how likely signals are: less is not worth a further step."""


@dataclass(frozen=True, eq=False)
class LineSignals:
    """s samples of presses at places (s, 2) m on the body: signals (s, e) counts, rows first, which of them
    are told (s, e), and the number of the press (s,) each belongs to.
    """

    place_m: Float[np.ndarray, "s 2"]
    signal_counts: Float[np.ndarray, "s e"]
    told: Bool[np.ndarray, "s e"]
    press: Int[np.ndarray, " s"]


@dataclass(frozen=True, eq=False)
class GainFit(AbstractPosterior):
    """ln of the gains over the configured ones, the first `rows` of them of rows, the others of columns."""

    names: tuple[str, ...]
    value: Float[np.ndarray, " e"]
    covariance: Float[np.ndarray, "e e"]
    prior_sigma: Float[np.ndarray, " e"]
    rows: int

    @property
    def measures(self) -> tuple[Measure, ...]:
        """All are factors."""
        return (Measure.factor,) * len(self.names)

    @property
    def relative_sigma(self) -> Float[np.ndarray, " e"]:
        """Standard deviations (e,) of ln gain minus the mean over rows, or columns."""
        row = np.arange(len(self.value)) < self.rows
        less = np.eye(len(row))
        for those in (row, ~row):
            less -= np.outer(those, those) / those.sum()
        return np.sqrt(np.diag(less @ self.covariance @ less))


def fit_gains(
    signals: LineSignals,
    model: PeakModel,
    pose: ArrayPose,
    names: Sequence[str],
    *,
    gain_sigma: float,
    pose_sigma: Float[np.ndarray, "5"],
) -> GainFit:
    """The gains that presses tell, of lines with names (e,).

    Args: model, pose: as configured; gain_sigma: prior standard deviation of ln gain [-]; pose_sigma (5,):
    of the pose's parameters, as `array_pose.PosePrior` has them.
    Raises SoftfuseError when the search does not end.
    """
    samples = _Samples.of(signals, model, pose)
    lines, own = len(names), samples.mean
    found, sigmas = list[_Explained](), gain_sigma * _PARTS
    common = np.zeros(lines + 5)
    for sigma in sigmas:
        prior = np.concatenate([np.full(lines, sigma), pose_sigma])
        explains, own = _searched(samples, prior, common, own)
        common = explains.z * prior
        found.append(explains)
    evidence = np.array([one.ln_evidence for one in found])
    likely = _LIKELY * np.exp(evidence - evidence.max())
    likely /= likely.sum()
    each = np.array([sigma * one.z[:lines] for sigma, one in zip(sigmas, found, strict=True)])
    value = likely @ each
    covariance = (each - value).T * likely @ (each - value)
    for sigma, part, one in zip(sigmas, likely, found, strict=True):
        covariance += part * sigma**2 * np.linalg.inv(one.information)[:lines, :lines]
    return GainFit(tuple(names), value, covariance, np.full(lines, gain_sigma), model.row_y_m.shape[0])


def _searched(
    samples: "_Samples",
    prior: Float[np.ndarray, " c"],
    common: Float[np.ndarray, " c"],
    own: Float[np.ndarray, "s 6"],
) -> tuple["_Explained", Float[np.ndarray, "s 6"]]:
    """What explains the signals best from a start on, with prior standard deviations of gains and pose (c,),
    and what is each sample's own (s, 6) then.
    """
    z = common / prior
    cost = samples.cost(z, common, own)
    for _ in range(_ROUNDS):
        presses = samples.about(z * prior, own)
        found = _explained(presses, prior, z)
        toward = found.z - z, samples.own(presses, found.z * prior) - own
        lower = cost
        for part in _STEPS:
            there = z + part * toward[0], own + part * toward[1]
            lower = samples.cost(there[0], there[0] * prior, there[1])
            if lower < cost:
                z, own = there
                break
        if cost - lower < _ACCURACY:
            return _Explained(z, found.information, min(cost, lower)), own
        cost = lower
    raise SoftfuseError(
        "the gains of the electrodes do not settle: check the places of the presses, or leave the gains as "
        "they are with calibration.electrode_gain = 0"
    )


class _Explained(NamedTuple):
    """The likeliest gains and pose (c,) in prior standard deviations, information (c, c), and least cost."""

    z: Float[np.ndarray, " c"]
    information: Float[np.ndarray, "c c"]
    cost: float

    @property
    def ln_evidence(self) -> float:
        """Logarithm of how likely the signals are, but for constants."""
        return -0.5 * (self.cost + float(np.linalg.slogdet(self.information)[1]))


def _explained(
    presses: Sequence["_Press"], prior: Float[np.ndarray, " c"], z: Float[np.ndarray, " c"]
) -> _Explained:
    """What explains presses best that are linear in gains and pose, from (c,) on."""
    slopes = [press.slope * prior for press in presses]
    matrices = np.array([slope.T @ slope for slope in slopes])
    sides = np.array([slope.T @ press.left for slope, press in zip(slopes, presses, strict=True)])
    count = np.array([len(press.left) for press in presses])
    information, last = np.eye(len(z)), np.inf
    for _ in range(_ROUNDS):
        square = np.array([np.sum((p.left - s @ z) ** 2) for s, p in zip(slopes, presses, strict=True)])
        cost = float(z @ z + np.sum(_lost(square, count)))
        weight = np.where(square > count, (FREEDOM + count) / (FREEDOM + square), 1.0)
        information = np.eye(len(z)) + np.tensordot(weight, matrices, 1)
        if last - cost < _ACCURACY:
            break
        z, last = np.linalg.solve(information, weight @ sides), cost
    return _Explained(z, information, last)


def _lost(square: Float[np.ndarray, " g"], count: Int[np.ndarray, " g"]) -> Float[np.ndarray, " g"]:
    """What presses (g,) cost: the squared length of their misfits up to that of so many numbers as expected,
    beyond it as in Student's t. Smaller misfits are no reason to be surer: those of one press are few.
    """
    beyond = (FREEDOM + np.maximum(square, count)) / (FREEDOM + count)
    return np.minimum(square, count) + (FREEDOM + count) * np.log(beyond)


class _Expected(eqx.Module):
    """The signals expected of s samples at places (s, 2) m, and how places go with the pose (s, 2, 5)."""

    shape: PeakShape
    layer: Float[Array, "e 2"]
    pose: ArrayPose
    place_m: Float[Array, "s 2"]
    away: Float[Array, "s 2 5"]

    @eqx.filter_jit
    def signals(
        self, common: Float[Array | np.ndarray, " c"], own: Float[Array | np.ndarray, "s 6"]
    ) -> Float[Array, "s e"]:
        """Counts (s, e) with ln gains and pose (c,) and what is each sample's own, amplitudes and offsets
        [counts], radius and gap [m] (s, 6).
        """
        signals = jax.vmap(self._signal, _EACH)
        return signals(self.place_m, self.away, jnp.asarray(common), jnp.asarray(own))

    @eqx.filter_jit
    def slopes(
        self, common: Float[Array | np.ndarray, " c"], own: Float[Array | np.ndarray, "s 6"]
    ) -> tuple[Float[Array, "s e c"], Float[Array, "s e 6"]]:
        """Derivatives of these."""
        by = jax.vmap(jax.jacfwd(self._signal, argnums=(2, 3)), _EACH)
        return by(self.place_m, self.away, jnp.asarray(common), jnp.asarray(own))

    def _signal(
        self,
        place: Float[Array, "2"],
        away: Float[Array, "2 5"],
        common: Float[Array, " c"],
        own: Float[Array, "6"],
    ) -> Float[Array, " e"]:
        lines = self.layer.shape[0]
        location = self.pose.on_array(place - away @ common[lines:])
        response = self.shape(jnp.concatenate([location, own[4:]]))
        return jnp.exp(common[:lines]) * (self.layer @ own[:2] * response + self.layer @ own[2:4])


@dataclass(frozen=True, eq=False)
class _Samples:
    """Samples beside what is expected of them: `mean` and `sigma` (s, 6) of what is each one's own, and the
    covariance (s, s) of a line's misfits [counts²].
    """

    signals: LineSignals
    expected: _Expected
    mean: Float[np.ndarray, "s 6"]
    sigma: Float[np.ndarray, "s 6"]
    misfit: Float[np.ndarray, "s s"]

    @classmethod
    def of(cls, signals: LineSignals, model: PeakModel, pose: ArrayPose) -> "_Samples":
        """With the priors of the peak fit, and amplitudes about those that explain the signals as drawn."""
        layer = np.asarray(peak_layers(model))
        away = jnp.asarray(pose_slopes(signals.place_m))
        expected = _Expected(peak_shape(model), jnp.asarray(layer), pose, jnp.asarray(signals.place_m), away)
        radius, many = float(model.radius_m), (len(signals.press), 1)
        drawn = np.tile([1.0, 1.0, 0.0, 0.0, radius, 0.0], many)
        shape = np.where(signals.told, expected.signals(jnp.zeros(len(layer) + 5), drawn), 0.0)
        read = np.where(signals.told, signals.signal_counts, 0.0)
        mean = drawn.copy()
        mean[:, :2] = (shape * read) @ layer / ((shape**2) @ layer + 1e-12)
        largest = np.abs(read).max(axis=1)
        offset, radius_sigma, gap = model.offset_sigma_counts, model.radius_sigma_m, model.gap_sigma_m
        sigma = np.tile(np.array([1.0, 1.0, offset, offset, radius_sigma, gap]), many)
        sigma[:, :2] = _AMPLITUDE * largest[:, None]
        missed = float(model.model_error) * largest
        alike = alike_in_press(signals.press, _ALIKE) * np.outer(missed, missed)
        misfit = alike + float(model.noise_counts) ** 2 * np.eye(len(missed))
        return cls(signals, expected, mean, sigma, misfit)

    def about(self, common: Float[np.ndarray, " c"], own: Float[np.ndarray, "s 6"]) -> list["_Press"]:
        """The presses, linear in gains and pose (c,) and what is each sample's own (s, 6) about these."""
        modelled = np.asarray(self.expected.signals(common, own))
        by_common, by_own = map(np.asarray, self.expected.slopes(common, own))
        left = self.signals.signal_counts - modelled + by_common @ common
        left += np.einsum("sek,sk->se", by_own, own - self.mean)
        by_own = by_own * self.sigma[:, None, :]
        presses = []
        for number in np.unique(self.signals.press):
            on = np.flatnonzero(self.signals.press == number)
            told = self.signals.told[on].ravel()
            own_slope = np.asarray(block_diag(*by_own[on]))[told]
            misfit = np.asarray(np.kron(self.misfit[np.ix_(on, on)], np.eye(left.shape[1])))[told][:, told]
            white = whitening(misfit + own_slope @ own_slope.T, np.ones(len(misfit), bool))
            slope = by_common[on].reshape(-1, len(common))[told]
            presses.append(_Press(on, white @ left[on].ravel()[told], white @ slope, white @ own_slope))
        return presses

    def cost(
        self, z: Float[np.ndarray, " c"], common: Float[np.ndarray, " c"], own: Float[np.ndarray, "s 6"]
    ) -> float:
        """What gains and pose (c,), z (c,) prior standard deviations, and each sample's own (s, 6) cost."""
        left = self.signals.signal_counts - np.asarray(self.expected.signals(common, own))
        away = (own - self.mean) / self.sigma
        square, count = [], []
        for number in np.unique(self.signals.press):
            on = self.signals.press == number
            told, misfit = self.signals.told[on], self.misfit[np.ix_(on, on)]
            white = [whitening(misfit, said) @ line for line, said in zip(left[on].T, told.T, strict=True)]
            square.append(np.sum(np.square(white)) + np.sum(away[on] ** 2))
            count.append(told.sum())
        return float(z @ z + np.sum(_lost(np.array(square), np.array(count))))

    def own(self, presses: Sequence["_Press"], common: Float[np.ndarray, " c"]) -> Float[np.ndarray, "s 6"]:
        """What each sample's own (s, 6) is likeliest to be where gains and pose (c,) are these."""
        found = self.mean.copy()
        for press in presses:
            away = press.own.T @ (press.left - press.slope @ common)
            away = np.clip(away, -_FARTHEST, _FARTHEST).reshape(-1, found.shape[1])
            found[press.samples] += away * self.sigma[press.samples]
        return found


@dataclass(frozen=True, eq=False)
class _Press:
    """Which samples (k,) are of a press, and of their m signals whitened: what is left where gains, pose and
    all that is a sample's own are as expected (m,), and its slopes in gains and pose (m, c) and, per prior
    standard deviation, in what is the samples' own (m, 6 k).
    """

    samples: Int[np.ndarray, " k"]
    left: Float[np.ndarray, " m"]
    slope: Float[np.ndarray, "m c"]
    own: Float[np.ndarray, "m o"]
