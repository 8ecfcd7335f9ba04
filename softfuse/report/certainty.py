"""How sure a calibrated robot is: further presses all over it, crossed electrodes on it, and what settings
say of both.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from softfuse.calibration.array_pose import Located, PoseFit, fit_pose
from softfuse.calibration.electrode_edits import Untouched, baseline_edits, gain_edits, untouched
from softfuse.calibration.electrode_gains import GainFit, LineSignals, fit_gains
from softfuse.calibration.fit import Fit, spread_over
from softfuse.calibration.of_robot import Fitted, build_pose_prior, pose_edits
from softfuse.calibration.presses import Answer, Applied
from softfuse.calibration.robust import Discrepancy
from softfuse.estimation.model_error import write_spread
from softfuse.functional.workspace import spread_out
from softfuse.mechanics.solution import State
from softfuse.report.presses import Felt
from softfuse.robot.file import Edits
from softfuse.robot.settings import RobotSettings
from softfuse.sensors.crossed.sensor import CrossedElectrodes, CrossedReading
from softfuse.sensors.crossed.settings import CrossedSettings

_LIGHT = 0.1
"""Of the largest force, with which is pressed where nothing is known of any."""
_SIDE, _MOST_PLACES = 11, 48
"""Places in each direction of a flat surface, and on a curved one, that further presses are looked at on."""


@dataclass(frozen=True, eq=False)
class Electrodes:
    """Where crossed electrodes lie, their gains, and what they read untouched; None for what is not known."""

    pose: PoseFit | None = None
    gains: GainFit | None = None
    untouched: Untouched | None = None


def further(
    fitted: Fitted, applied: Applied, states: tuple[State, ...]
) -> tuple[Applied, tuple[State, ...] | None]:
    """Further presses (s,) all over the robot, each with the largest force of those that were made, with
    actuators as they were in the samples where they do least and most; and those samples' equilibria, to
    start from where actuators move the robot. None belongs to another.
    """
    settings = fitted.robot.settings
    contact = settings.contacts[0]
    force_N = float(applied.force_N.max()) or _LIGHT * contact.max_force
    workspace = fitted.robot.workspaces[0]
    if workspace is None:
        places = np.array(list(settings.places.values()))
    else:
        places, _ = workspace.grid(_SIDE)
        if contact.direction is None:
            places = places[spread_out(places[:, 0], most=_MOST_PLACES)]
    driven = least_and_most(applied.prescribed)
    like, contacts = np.repeat(driven, len(places)), applied.place.shape[1]
    place = np.repeat(np.tile(places, (len(driven), 1, 1))[:, None], contacts, axis=1)
    force = np.zeros(place.shape[:2])
    force[:, 0] = force_N
    near = tuple(states[sample] for sample in like) if len(driven) > 1 else None
    return Applied(place, force, applied.prescribed[like], -1 - np.arange(len(place))), near


def least_and_most(prescribed: Float[np.ndarray, "s a"]) -> Int[np.ndarray, " n"]:
    """Numbers of the samples in which actuators do least and most, each in parts of its range; one where none
    moves. No sample has all of them at their largest.
    """
    spread = np.ptp(prescribed, axis=0)
    if not spread.any():
        return np.array([0])
    parts = (prescribed - prescribed.min(axis=0)) / np.where(spread > 0, spread, 1.0)
    return np.array([parts.sum(axis=1).argmin(), parts.sum(axis=1).argmax()])


def sharpened(felt: Felt, settings: RobotSettings, suite_sensors: tuple) -> GainFit | None:
    """The gains of crossed electrodes that presses tell; None where they do not, or lines may not differ."""
    sigma = settings.calibration.electrode_gain
    lines = _lines(settings)
    signals = None if lines is None or sigma == 0 else _signals(felt, lines.name)
    if lines is None or signals is None:
        return None
    sensor = _sensor(suite_sensors, lines.name)
    names = [f"{channel} gain" for channel in lines.channels]
    pose = build_pose_prior(settings).sigma
    return fit_gains(signals, sensor.peak, sensor.pose, names, gain_sigma=sigma, pose_sigma=pose)


def certainty(
    fitted: Fitted,
    felt: Felt,
    found: Fit,
    answer: Answer,
    beyond: Applied,
    gains: GainFit | None,
    out: Path,
) -> tuple[Edits, Electrodes]:
    """Settings that say how sure the fitted robot is, which answers so to further presses, and what was found
    of its electrodes; how uncertain readings are over a workspace goes in a file beside `out`.
    """
    settings = fitted.robot.settings
    electrodes = _electrodes(fitted, felt, beyond, gains)
    edits: Edits = {
        **(pose_edits(settings, electrodes.pose) if electrodes.pose else {}),
        **(gain_edits(settings) if gains is not None else {}),
        **(baseline_edits(settings, electrodes.untouched) if electrodes.untouched else {}),
    }
    unmoved = len(least_and_most(felt.presses.applied.prescribed)) == 1
    everywhere = fitted.robot.workspaces[0] is not None
    if everywhere and unmoved and len(fitted.readings) == fitted.robot.model.n_readings:
        path = out.with_suffix(".npz")
        spread = spread_over(beyond, answer, found.covariance)
        posterior = {name: getattr(found, name) for name in ("value", "covariance", "prior_sigma")}
        write_spread(path, spread, names=np.array(found.names), **posterior)
        return {**edits, **error_edits(fitted, found.discrepancy, path.name)}, electrodes
    return {**edits, **_overall(fitted, answer, found)}, electrodes


def error_edits(fitted: Fitted, discrepancy: Discrepancy, spread: str) -> Edits:
    """Settings by which a robot's model is as wrong as presses have told: by a part of each reading and of
    the largest, and by the file of what is not known of its parameters. What sensors say of that by
    themselves was a guess.
    """
    sensors = fitted.robot.settings.sensors
    guesses = [number for number, sensor in enumerate(sensors) if sensor.errs_with_model]
    return {
        **{("sensor", number, "model_error"): 0.0 for number in guesses},
        ("estimator", "model_error"): _of_each(fitted, fitted.by_sensor(discrepancy.part)),
        ("estimator", "model_error_floor"): _of_each(fitted, fitted.by_sensor(discrepancy.floor)),
        ("estimator", "reading_spread"): spread,
    }


def _overall(fitted: Fitted, answer: Answer, found: Fit) -> Edits:
    """The part of the largest reading of each sensor by which modelled ones may be wrong, of all further
    presses together: by what the model misses, and by what is not known of its parameters.
    """
    unknown = np.einsum("skp,pq,skq->sk", answer.slope, found.covariance, answer.slope)
    wrong = found.discrepancy.missed(answer.reading, fitted.kind) ** 2 + unknown
    edits: dict = {}
    rest = {}
    for kind in np.unique(fitted.kind):
        own = fitted.kind == kind
        largest = np.max(np.abs(answer.reading[:, own]), axis=1)
        part = float(np.sqrt(np.mean(wrong[:, own], axis=1).sum() / np.sum(largest**2)))
        name = fitted.sensors[kind]
        number = [sensor.name for sensor in fitted.robot.settings.sensors].index(name)
        if fitted.robot.settings.sensors[number].errs_with_model:
            edits["sensor", number, "model_error"] = float(f"{part:.4g}")
        else:
            rest[name] = part
    floors = fitted.by_sensor(found.discrepancy.floor)
    edits["estimator", "model_error"] = _of_each(fitted, rest)
    if rest:
        edits["estimator", "model_error_floor"] = _of_each(fitted, {name: floors[name] for name in rest})
    return edits


def _of_each(fitted: Fitted, values: Mapping[str, float]) -> float | dict[str, float]:
    """As settings have it: of each sensor by its name, of the only one without; 0 where there is none."""
    rounded = {name: float(f"{value:.4g}") for name, value in values.items()}
    return rounded if len(fitted.sensors) > 1 and rounded else next(iter(rounded.values()), 0.0)


def _lines(settings: RobotSettings) -> CrossedSettings | None:
    found = settings.sensors_of(CrossedSettings)
    return found[0] if found else None


def _sensor(sensors: tuple, name: str) -> CrossedElectrodes:
    return next(each for each in sensors if each.name == name)


def _electrodes(fitted: Fitted, felt: Felt, beyond: Applied, gains: GainFit | None) -> Electrodes:
    lines = _lines(fitted.robot.settings)
    if lines is None:
        return Electrodes()
    sensor = _sensor(fitted.robot.suite.contact_sensors, lines.name)
    located, pose = _located(felt, lines.name, sensor), None
    if located is not None:
        pose = fit_pose(located, build_pose_prior(fitted.robot.settings), beyond.place[:, 0, 0, :2])
    counts, away = list[np.ndarray](), list[np.ndarray]()
    for recording, observed in felt.recordings:
        counts.append(recording.matrix(list(lines.channels))[: len(observed)])
        flags = []
        for each in observed:
            seen: CrossedReading = each.details[lines.name]
            felt_it = np.asarray(each.pressing).any() & ~np.asarray(seen.touching)
            flags.append(np.asarray(seen.valid) & ~(np.asarray(seen.near) | felt_it))
        away.append(np.array(flags))
    return Electrodes(pose, gains, untouched(np.concatenate(counts), np.concatenate(away)))


def _felt_at(felt: Felt, name: str) -> Bool[np.ndarray, " s"]:
    """The samples (s,) that crossed electrodes place, and say how sure they are."""
    known = [
        np.isfinite(np.append(np.asarray(each.location_m)[0, :2], np.asarray(each.location_sigma_m)[0])).all()
        and bool(each.details[name].located)
        for each in felt.observed
    ]
    return np.array(known)


def _located(felt: Felt, name: str, sensor: CrossedElectrodes) -> Located | None:
    """Where crossed electrodes place the samples that they feel; None when they feel none."""
    on, applied = _felt_at(felt, name), felt.presses.applied
    if not on.any():
        return None
    location = np.array([np.asarray(each.location_m)[0, :2] for each in felt.observed])[on]
    seen = [each.details[name] for each, felt_it in zip(felt.observed, on, strict=True) if felt_it]
    dent = np.array([each.dent_m for each in seen])
    promised = [
        sensor.pose.spread(jnp.asarray(each.covariance_m2 / each.widening), jnp.ones(()), jnp.zeros(()))
        for each in seen
    ]
    sigma = np.sqrt(np.diagonal(np.array(promised), axis1=1, axis2=2))
    return Located(applied.place[on, 0, 0, :2], location, sigma, dent, applied.press[on])


def _signals(felt: Felt, name: str) -> LineSignals | None:
    """By which signals they do; None when they feel none."""
    on, applied = _felt_at(felt, name), felt.presses.applied
    if not on.any():
        return None
    signal, told = (
        np.array([np.asarray(getattr(each.details[name], field)) for each in felt.observed])[on]
        for field in ("signal_counts", "valid")
    )
    return LineSignals(applied.place[on, 0, 0, :2], signal, told, applied.press[on])


def places_mm(settings: RobotSettings, beyond: Applied) -> Float[np.ndarray, "s 2"] | None:
    """Where further presses are on a map seen from above; None where there is none."""
    return None if settings.contacts[0].within is None else 1e3 * beyond.place[:, 0, 0, :2]
