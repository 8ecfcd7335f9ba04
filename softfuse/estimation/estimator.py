"""Frame after frame: sensor readings in, contact location, force and shape out.

The two jitted pieces, sensors and `LiveStep`, are compiled ahead and never again, at the next start not even
traced (`kept_programs`). Between frames this file decides whether the factor of the tangent is renewed:
when the step found that a refinement shrinks the error of its linear solves by less than
`refresh_contraction`. Where inverses are known beforehand, steps refine nothing, and what they leave to the
next step decides. While nothing touches, the body rests and the factor at rest serves. Only compiling is
threaded here; `hardware` does the rest.
"""

import time
from dataclasses import dataclass

import numpy as np
from jaxtyping import Array, Float

from softfuse.estimation.limits import Limits
from softfuse.estimation.live_step import LiveStep, Ready
from softfuse.estimation.step import Observation, StepReport
from softfuse.mechanics.model import Model
from softfuse.mechanics.solution import State


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
    """What one frame says: drives (D,), contacts' forces [N] first, measured minus modelled readings (k,) and
    the step's report.

    `renewed`: the factor was renewed for this frame; `lost`: the state was given up, drives are those at
    rest; `corrected`: the full body's, where a reduced one was not good enough; `latency_s`: wall time from
    call to return.
    """

    drive: Float[np.ndarray, " D"]
    misfit: Float[np.ndarray, " k"]
    report: StepReport
    renewed: bool
    lost: bool
    latency_s: float
    corrected: bool = False


class Estimator:
    """Follows the state of one robot through observations; compiled when made, but where inverses are known
    what makes another one is compiled beside the frames that follow the first.
    """

    def __init__(
        self,
        model: Model,
        limits: Limits,
        places: Array,
        settings: StepSettings = DEFAULT_STEPS,
        *,
        places_known: bool = True,
    ):
        """Compile the step for as many contacts as there are `places` (c, ...), wherever they are, and for
        observations whose `places_known` are exact or have a prior.

        Raises SolveError as `LiveStep` does.
        """
        self.model, self.limits, self.settings = model, limits, settings
        self.live = LiveStep(model, limits, places, settings.refinements, places_known=places_known)
        self.compile_s = self.live.compile_s
        self._ready = self.live.first
        self.reset()

    def go_on(self, state: State | None, places: Array, ready: Ready | None = None) -> None:
        """Go on from a state, None for rest, under contacts at `places` (c, ...), of the robot or of
        another one that was made `ready`.
        """
        self._ready = ready or self._ready
        self.reset()
        if state is not None:
            self._carried = self.live.go_on(self._ready, state, places)

    def reset(self) -> None:
        """Forget the past: the body rests, nothing presses."""
        self._carried, self._renew = self._ready.rest, False
        self.keep()

    def keep(self) -> None:
        """Remember the state after the last frame, as one to go back to."""
        self._kept = self._ready, self._carried

    def go_back(self) -> None:
        """Go on from the state that was kept last, or from rest."""
        (self._ready, self._carried), self._renew = self._kept, False

    @property
    def state(self) -> State:
        """The state after the last frame."""
        return self._carried.state

    def displacement(self) -> Float[np.ndarray, "k 3"]:
        """Displacements (k, 3) m of all nodes after the last frame."""
        return np.asarray(self.model.body.displacement(self.state.z))

    def update(self, seen: Observation, limits: Limits | None = None) -> Estimate:
        """Advance by a frame's observation within this frame's limits; never raises for what they contain."""
        started = time.perf_counter()
        limits = self.limits if limits is None else limits
        renewed, carried, told = False, self._carried, None
        for count in range(self.settings.steps_per_frame + self.settings.catch_up_steps):
            if count >= self.settings.steps_per_frame and told is not None and not told.report.taken < 1:
                break
            if told is not None:
                seen = seen.found_at(told.report.offset)
            fresh = self._renew
            if fresh:
                carried = self.live.begin(self._ready, carried, seen.places)
            after, told = self.live.step(self._ready, carried, limits, seen)
            if not told.report.contraction <= self.settings.redo_contraction and not fresh:
                fresh = True
                carried = self.live.begin(self._ready, carried, seen.places)
                after, told = self.live.step(self._ready, carried, limits, seen)
            # A factor that was just made would not get better by making it again.
            self._renew = bool(told.report.contraction > self.settings.refresh_contraction) and not fresh
            carried, renewed = after, renewed or fresh
        # The first estimate had all cores to itself.
        self.live.prepare_begin()
        assert told is not None
        report = told.report
        found = [told.drive, report.contraction, *([] if report.offset is None else [report.offset])]
        lost = not (
            report.least_volume_ratio > self.settings.least_volume_ratio
            and all(np.isfinite(np.asarray(each)).all() for each in found)
        )
        if lost:
            self.reset()
        else:
            self._carried = carried
        return Estimate(
            np.asarray(self.state.drive if lost else told.drive),
            np.asarray(report.misfit),
            report,
            renewed,
            lost,
            time.perf_counter() - started,
        )
