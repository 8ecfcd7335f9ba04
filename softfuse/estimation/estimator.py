"""Frame after frame: sensor readings in, contact location, force and shape out.

The two jitted pieces, sensors and `estimate_step`, are compiled ahead and never again, at the next start not
even traced (`kept_programs`). Between frames this file decides whether the factor of the tangent is renewed:
when the step found that a refinement shrinks the error of its linear solves by less than
`refresh_contraction`. A solver that renews its factor by itself, a little in every frame, is not asked:
its steps refine nothing. While nothing touches, the body rests and the factor at rest serves. Only compiling
is threaded here; `hardware` does the rest.
"""

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from softfuse.equilibrium.linearised import loaded_tangents
from softfuse.equilibrium.solution import State
from softfuse.errors import SolveError
from softfuse.estimation.device import Device
from softfuse.estimation.kept_programs import lowered
from softfuse.estimation.limits import Limits
from softfuse.estimation.step import Observation, StepReport, estimate_step


@dataclass(frozen=True)
class StepSettings:
    """How the steps are run: `steps_per_frame` linearisations, each with `refinements` of its linear solves.

    `catch_up_steps`: at most so many more in a frame, while `Limits.motion` shortens them;
    `refresh_contraction` [-]: a first refinement that is not smaller than this part of the solution makes the
    factor be renewed before the next step, `redo_contraction` [-] at once, and this step again;
    `least_volume_ratio` [-]: a state that squeezes an element below this is given up and the body starts from
    rest.
    """

    steps_per_frame: int = 1
    catch_up_steps: int = 0
    refinements: int = 2
    refresh_contraction: float = 0.25
    redo_contraction: float = 0.5
    least_volume_ratio: float = 0.05


DEFAULT_STEPS = StepSettings()


@dataclass(frozen=True)
class Estimate:
    """What one frame says: drives (D,), contacts' forces [N] first, the shape as unknowns z (n,), measured
    minus modelled readings (k,) and the step's report.

    `renewed`: the factor was renewed for this frame; `lost`: the state was given up, drives are those at
    rest; `latency_s`: wall time from call to return.
    """

    drive: Float[np.ndarray, " D"]
    z: Float[Array, " n"]
    misfit: Float[np.ndarray, " k"]
    report: StepReport
    renewed: bool
    lost: bool
    latency_s: float


def _rest(static: Device, arrays: Device, places: Array) -> State:
    return eqx.combine(arrays, static).rest_state(places)


def _factor(static: Device, arrays: Device, state: State, places: Array) -> PyTree[Array]:
    device = eqx.combine(arrays, static)
    return device.linear.factor(loaded_tangents(device.body, device.loads(places), state))


def _step(
    fixed: tuple[Device, int],
    arrays: Device,
    limits: Limits,
    factor: PyTree[Array],
    state: State,
    seen: Observation,
) -> tuple[State, StepReport, PyTree[Array]]:
    """The step, and the factor for the next one where the solver renews it."""
    static, refinements = fixed
    device = eqx.combine(arrays, static)
    if not device.linear.renews:
        return *estimate_step(device, limits, factor, state, seen, refinements=refinements), None
    after, report = estimate_step(device, limits, factor, state, seen, refinements=0)
    return after, report, device.linear.renewed(factor, device.body, device.loads(seen.places), after)


class Estimator:
    """Follows the state of one device through observations; compiled when made."""

    def __init__(self, device: Device, limits: Limits, places: Array, settings: StepSettings = DEFAULT_STEPS):
        """Compile the step for as many contacts as there are `places` (c, ...), wherever they are.

        Raises SolveError when the body's tangent at rest is singular, or when the limits are for another
        number of drives than contacts and attached loads have.
        """
        self.device, self.limits, self.settings = device, limits, settings
        # Each step refines what it solves for, so a rough factor serves.
        device = replace(device, body=device.body.rough(), linear=device.linear.rough())
        self._arrays, static = eqx.partition(device, eqx.is_array)
        self._rest = lowered(_rest, static, self._arrays, places).compile()(self._arrays, places)
        if limits.upper.shape != self._rest.drive.shape:
            raise SolveError(
                f"{limits.upper.shape[0]} limits for {self._rest.drive.shape[0]} drives: give one for each "
                "contact, then for each attached load"
            )
        started = time.perf_counter()
        factor = lowered(_factor, static, self._arrays, self._rest, places)

        def first_factor():
            compiled = factor.compile()
            return compiled, compiled(self._arrays, self._rest, places)

        readings = jnp.zeros(device.readings)
        given = limits, factor.result, self._rest, Observation(readings, readings, places)
        # XLA compiles one program on another thread while the other is traced and compiled on this one.
        with ThreadPoolExecutor(1) as aside:
            first = aside.submit(first_factor)
            self._step = lowered(_step, (static, settings.refinements), self._arrays, *given).compile()
            self._factor, self._rest_factor = first.result()
        if not all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(self._rest_factor)):
            raise SolveError(
                "the body's stiffness at rest is singular: fix more nodes, or mend materials and mesh"
            )
        self.compile_s = time.perf_counter() - started
        self.reset()

    def reset(self) -> None:
        """Forget the past: the body rests, nothing presses."""
        self._state, self._tangent = self._rest, self._rest_factor
        self._renew = False

    @property
    def state(self) -> State:
        """The state after the last frame."""
        return self._state

    def update(self, seen: Observation, limits: Limits | None = None) -> Estimate:
        """Advance by one frame's observation within the limits of this frame; never raises for what they
        contain.
        """
        started = time.perf_counter()
        limits = self.limits if limits is None else limits
        renewed, state, report = False, self._state, None
        for count in range(self.settings.steps_per_frame + self.settings.catch_up_steps):
            if count >= self.settings.steps_per_frame and report is not None and not float(report.taken) < 1:
                break
            fresh = self._renew
            if fresh:
                self._tangent = self._factor(self._arrays, state, seen.places)
            after, report, rolled = self._step(self._arrays, limits, self._tangent, state, seen)
            if not float(report.contraction) <= self.settings.redo_contraction and not fresh:
                fresh = True
                self._tangent = self._factor(self._arrays, state, seen.places)
                after, report, rolled = self._step(self._arrays, limits, self._tangent, state, seen)
            self._tangent = self._tangent if rolled is None else rolled
            # A factor that was just made would not get better by making it again.
            self._renew = float(report.contraction) > self.settings.refresh_contraction and not fresh
            state, renewed = after, renewed or fresh
        assert report is not None
        least = float(report.least_volume_ratio)
        lost = not (least > self.settings.least_volume_ratio and np.isfinite(float(report.contraction)))
        if lost:
            self.reset()
        else:
            self._state = state
        return Estimate(
            np.asarray(self._state.drive),
            self._state.z,
            np.asarray(report.misfit),
            report,
            renewed,
            lost,
            time.perf_counter() - started,
        )
