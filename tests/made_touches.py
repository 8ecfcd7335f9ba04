"""Made frames of forces that are held, moved and let go while the zeros of four sensors drift."""

from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from made_sensors import d6f_p0001a1

from softfuse.estimation.smoothing.force_filter import ForceFilter
from softfuse.estimation.smoothing.process import DEFAULT_PROCESS, Process
from softfuse.estimation.smoothing.smoother import Smoothed, Smoother
from softfuse.estimation.tracked import Evidence, Tracked
from softfuse.functional.chart import facing
from softfuse.sensors.status import Status
from softfuse.sensors.zero_drift import ReadingDrift

SENSOR = d6f_p0001a1(4)
DRIFT = SENSOR.drift
EFFECT = np.asarray(DRIFT.effect)
W = 1e-9 * np.array([[-25.0], [4.0], [-2.0], [6.0]])
"""m³/N."""
PART = 0.03
DT = 0.1
START = np.diag([2e-4, 4e-4, 1e-5]) ** 2
"""Covariance of what a zero is off by as a touch begins."""


@dataclass(frozen=True)
class Made:
    """True forces (n,), drifts (n, 4) of the readings, and what the tracker says."""

    force: np.ndarray
    drift: np.ndarray
    found: list[Tracked]


def frame(
    time_s: float, reading: np.ndarray, model: np.ndarray, drift: ReadingDrift, force: float
) -> Tracked:
    """A frame of one contact that presses where `force` is positive, as good as one frame tells it."""
    touching = force > 0
    compliance = W if touching else np.zeros_like(W)
    inverse = np.linalg.inv(model + np.diag(EFFECT**2 * np.asarray(drift.covariance)[:, 2, 2]))
    heard = np.isfinite(reading)
    inverse[~heard] = inverse[:, ~heard] = 0.0
    information = float((compliance.T @ inverse @ compliance)[0, 0])
    seen = np.nan_to_num(reading)
    drive = float((compliance.T @ inverse @ seen)[0] / information) if touching else 0.0
    misfit = reading - compliance[:, 0] * drive
    place = np.array([[1e-3, 2e-3, 0.0]]) if touching else np.full((1, 3), np.nan)
    at, sure = place[0, :2], np.full(2, 1e-4 if touching else np.nan)
    evidence = Evidence(
        *(misfit, np.ones(4), np.array([drive]), compliance, np.nan_to_num(at), np.zeros((4, 2))),
        *(at, sure, np.array([touching]), model, drift),
    )
    covariance = np.array([[1 / information if touching else 0.0]])
    return Tracked(
        time_s=time_s,
        touching=np.array([touching]),
        location_m=place,
        location_sigma_m=np.full((1, 2), 1e-4 if touching else np.nan),
        contact_force_N=np.array([drive]),
        force_covariance_N2=covariance,
        places=facing(np.nan_to_num(place), (0.0, 0.0, -1.0)),
        covariance=covariance,
        attached=np.zeros(0),
        reading=reading,
        sigma=np.ones(4),
        valid=heard,
        misfit=misfit,
        evidence=evidence,
        details=None,
        statuses=(Status.ok,),
        latency_s=0.0,
    )


def made(force: np.ndarray, rng: np.random.Generator, jumps: np.ndarray | float = 0.0) -> Made:
    """Frames of a force (n,) that begins with a touch, with the sensors' drift and the model's error drawn as
    promised, and integrals that jump by so much (n, 4) [m³]; at the end, where it is 0, the body is at rest.
    """
    state = rng.multivariate_normal(np.zeros(3), START, 4)
    covariance = np.broadcast_to(START, (4, 3, 3))
    wrong = 1 + PART * rng.normal(size=4)
    transition, noise = (each[0] for each in DRIFT.step(DT, DT))
    found, drifts, jumped = [], [], np.broadcast_to(np.cumsum(jumps, axis=0), (len(force), 4))
    for k, each in enumerate(force):
        if k:
            state = state @ transition.T + rng.multivariate_normal(np.zeros(3), noise, 4)
            covariance = transition @ covariance @ transition.T + noise
        drifts.append(EFFECT * state[:, 2] + jumped[k])
        clean = W[:, 0] * each
        model = np.diag((PART * clean) ** 2 + 1e-24)
        calm = np.full(4, each == 0)
        reading = clean * wrong + drifts[-1]
        drift = ReadingDrift(*map(jnp.asarray, (covariance, calm, DT)))
        found.append(frame(DT * k, reading, model, drift, float(each)))
    # The sensors integrate anew.
    still = ReadingDrift(jnp.zeros((4, 3, 3)), jnp.ones(4, bool), jnp.asarray(DT))
    found.append(frame(DT * len(force), np.zeros(4), 1e-24 * np.eye(4), still, 0.0))
    return Made(np.append(force, 0.0), np.append(drifts, np.zeros((1, 4)), axis=0), found)


G = 1e-9 * np.array([[3.0, 0.0], [-2.0, 1.0], [0.0, 2.0], [1.0, -2.0]]) / 1e-3
"""Of readings in x and y, m³/m, per newton."""
SEEN_M = 2e-4
"""By how much contacts are seen elsewhere than they are."""


def placed(each: Made, rng: np.random.Generator) -> Made:
    """The same frames of a contact that the readings help to place, and that is seen a bit elsewhere, by a
    part that lasts and one that does not.
    """
    white = DEFAULT_PROCESS.white
    lasting = SEEN_M * np.sqrt(1 - white) * rng.normal(size=2)
    found = []
    for force, now in zip(each.force, each.found, strict=True):
        evidence = now.evidence
        assert evidence is not None
        off = lasting + SEEN_M * np.sqrt(white) * rng.normal(size=2)
        seen = evidence.seen_m + off
        # Taken to be where it is seen, so that what the readings say of the force goes to and fro with it.
        misfit, by_place = evidence.misfit - G @ off * force, G * force
        told = {"misfit": misfit, "place_m": evidence.place_m + off, "by_place": by_place}
        seen_there = {"seen_m": seen, "seen_sigma_m": np.full(2, SEEN_M)}
        found.append(replace(now, evidence=replace(evidence, **told, **seen_there)))
    return replace(each, found=found)


def smoother(*, keep: bool = True, process: Process = DEFAULT_PROCESS) -> Smoother:
    return Smoother(ForceFilter(process, DRIFT, np.ones((1, 1)), np.array([25.0])), keep=keep)


def of(frames: list[Smoothed] | list[Tracked]) -> np.ndarray:
    return np.array([each.force_N for each in frames])
