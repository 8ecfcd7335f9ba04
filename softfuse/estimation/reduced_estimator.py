"""Frame after frame on reduced bodies, each good for contacts in its own region, or else on the full one.

What is pressed decides which chart is used. A state goes from body to body by its unknowns on the full mesh,
u = U α there and α = Uᵀ A u back, with the stiffness A that modes are orthonormal in; from chart to chart by
some of them, see `telling_unknowns`. Where contacts are not in one region, or the chart's last modes say that
those left out matter too (`AbstractBody.truncation`), the full body corrects the estimate and goes on, until
a chart comes near enough to its state again.
"""

import logging
import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Bool, Float

from softfuse.errors import SoftfuseError
from softfuse.estimation.estimator import DEFAULT_STEPS, Estimate, Estimator, StepSettings
from softfuse.estimation.limits import Limits
from softfuse.estimation.live_step import Ready
from softfuse.estimation.step import Observation
from softfuse.mechanics.solution import State
from softfuse.rom.basis import RestStiffness, rest_stiffness
from softfuse.rom.projection import of_nodes
from softfuse.rom.rom_file import Atlas, Kept

log = logging.getLogger(__name__)

MOST_TRUNCATION = 0.01
"""Of the reduced body's last modes: above it, the full body corrects."""
_BACK = 0.7
"""A chart that has been left is taken again below this part of what it was left at."""
_UNSEEN_M = 5e-6
"""By how little a node may be off, whatever part of the shape that is: hardly pressed, all of it is noise."""
_NOTHING_PRESSED_S = 2.0
"""If no contact is estimated for so long, there is time to make ready what the first one can do without."""


class _Aside(NamedTuple):
    """What is made ready on a thread of its own, as nobody waits for it before it is needed."""

    full: Future[Estimator]
    stiffness: Future[RestStiffness]


class ReducedEstimator:
    """Follows the state of a robot with an atlas through observations; compiled when made."""

    def __init__(
        self,
        atlas: Atlas,
        limits: Limits,
        places: Array,
        settings: StepSettings = DEFAULT_STEPS,
        *,
        places_known: bool = True,
    ):
        """Compile the step for as many contacts as there are `places` (c, 3, 3), wherever they are, and for
        observations whose `places_known` are exact or have a prior; the full body's, and then all charts, are
        made ready after the first estimate or while none is asked for.

        Raises SolveError as `Estimator` does, and SoftfuseError when the first chart cannot be read.
        """
        self.model, self.limits, self._atlas = atlas.full, limits, atlas
        self._small = Estimator(atlas.chart(0).model, limits, places, settings, places_known=places_known)
        self.compile_s = self._small.compile_s
        self._places, self._settings, self._places_known = places, settings, places_known
        self._ready: dict[int, Ready | None] = {}
        self._aside: _Aside | None = None
        self._adding = atlas.full.adding(len(places))
        self._resting_since: float | None = None
        self._forget()

    def _prepare(self) -> _Aside:
        """Begin, if need be, to make ready the full body's estimator and stiffness and then all charts."""
        if self._aside is None:
            full, thread = self._atlas.full, ThreadPoolExecutor(1)
            ready = thread.submit(
                Estimator, full, self.limits, self._places, self._settings, places_known=self._places_known
            )
            self._aside = _Aside(ready, thread.submit(rest_stiffness, full.body.full))
            for number in range(len(self._atlas.regions)):
                thread.submit(self._of, number)
            thread.shutdown(wait=False)
        return self._aside

    def reset(self) -> None:
        """Forget the past: the body rests, nothing presses."""
        self._forget()
        self._rest_on()

    def _forget(self) -> None:
        self._number: int | None = None
        self._on_full = False
        self._kept = (self._number, self._on_full)

    def keep(self) -> None:
        """Remember the state after the last frame, as one to go back to."""
        self._kept = (self._number, self._on_full)
        self._in_use.keep()

    def go_back(self) -> None:
        """Go on from the state that was kept last, or from rest."""
        self._number, self._on_full = self._kept
        self._in_use.go_back()

    @property
    def _in_use(self) -> Estimator:
        """What made the last frame's estimate."""
        return self._prepare().full.result() if self._on_full else self._small

    def _rest_on(self) -> None:
        """Nothing presses now; where that goes on, there is time for what the first estimate does without."""
        now = time.perf_counter()
        self._resting_since = self._resting_since or now
        if now - self._resting_since > _NOTHING_PRESSED_S:
            self._prepare()

    @property
    def state(self) -> State:
        """The full body's state after the last frame."""
        if self._on_full:
            return self._prepare().full.result().state
        if self._number is None:
            rest = self._small.live.first.rest.state
            return replace(rest, z=jax.device_put(np.zeros(self.model.body.n)))
        return self._whole(self._number, self._small.state)

    def displacement(self) -> Float[np.ndarray, "k 3"]:
        """Displacements (k, 3) m of all nodes after the last frame."""
        if self._on_full or self._number is None:
            body, z = self.model.body.full, np.asarray(self.state.z)
            return of_nodes(body, np.arange(body.n_nodes), z[: body.n_displacements, None])[:, :, 0]
        return self._atlas.chart(self._number).displacement(np.asarray(self._small.state.z))

    def update(self, seen: Observation, limits: Limits | None = None) -> Estimate:
        """Advance by a frame's observation within this frame's limits; never raises for what they contain."""
        started = time.perf_counter()
        limits = self.limits if limits is None else limits
        places = np.asarray(seen.places)
        pressed = self._pressed(limits)
        number = self._find(places[pressed])
        found, before = None, None
        if number is not None:
            if pressed.any():
                # Who does not press is anywhere, but has to be where the chart is.
                places = np.where(pressed.reshape(-1, *[1] * (places.ndim - 1)), places, places[pressed][0])
            near = seen._replace(places=places)
            if self._taken(number, near.places):
                before = self._small.state
                found = self._small.update(near, limits)
        if found is None or found.lost or self._doubted(found):
            found = self._corrected(before or self._small.state, seen, limits)
        if pressed.any():
            # The first estimate had all cores to itself.
            self._prepare()
        else:
            self._rest_on()
        return replace(found, latency_s=time.perf_counter() - started)

    def _pressed(self, limits: Limits) -> Bool[np.ndarray, " c"]:
        """Which contacts (c,) may have a force."""
        upper = np.asarray(limits.upper)[: self._adding.shape[1]]
        return self._adding @ (upper > 0) > 0

    def _find(self, places: np.ndarray) -> int | None:
        """The chart for contacts at these places, None where there is none for all of them."""
        regions = self._atlas.regions
        found = {regions.find(place, self._number) for place in places}
        if not found:
            found = {self._number or 0}
        number = found.pop() if len(found) == 1 else None
        return number if number is None or self._of(number) else None

    def _taken(self, number: int, places: Array) -> bool:
        """Whether a chart is in use now: it is not taken up where the full body's state is far from it."""
        if number == self._number and not self._on_full:
            return True
        kept, state = self._atlas.chart(number), None
        if self._on_full:
            whole = self.state
            z = kept.basis.amplitudes(np.asarray(whole.z), self._prepare().stiffness.result())
            if not self._near(number, z, np.asarray(whole.z)):
                return False
            state = replace(whole, z=jax.device_put(z))
        elif self._number is not None:
            state = self._small.state
            z = kept.amplitudes_of(self._atlas.chart(self._number), np.asarray(state.z))
            state = replace(state, z=jax.device_put(z))
        self._small.go_on(state, places, self._of(number))
        self._number, self._on_full = number, False
        return True

    def _doubted(self, found: Estimate) -> bool:
        """Whether the modes that the chart in use has left out may matter."""
        if found.report.truncation <= MOST_TRUNCATION:
            return False
        assert self._number is not None
        z = np.asarray(self._small.state.z)
        return not self._told_by_last(self._atlas.chart(self._number), z) <= _UNSEEN_M

    def _told_by_last(self, kept: Kept, z: Float[np.ndarray, " r"]) -> float:
        """The largest displacement [m] that a chart's last modes make at amplitudes z (r,)."""
        return float(np.max(np.abs(kept.displacement(z, kept.model.body.last_modes))))

    def _near(self, number: int, z: Float[np.ndarray, " r"], whole: Float[np.ndarray, " n"]) -> bool:
        """Whether a chart at amplitudes z (r,) comes near enough to the full body's unknowns (n,)."""
        kept, most = self._atlas.chart(number), _BACK * MOST_TRUNCATION
        truncation = float(kept.model.body.truncation(z))
        if not (truncation <= most or self._told_by_last(kept, z) <= _BACK * _UNSEEN_M):
            return False
        stiffness = self._prepare().stiffness.result()
        u = stiffness.n_displacements
        missed, moved = (whole - kept.basis.states(z))[:u], whole[:u]
        energies = [each @ (stiffness.displacement @ each) for each in (missed, moved)]
        return bool(energies[0] <= most**2 * energies[1] or np.max(np.abs(missed)) <= _BACK * _UNSEEN_M)

    def _of(self, number: int) -> Ready | None:
        """A chart, ready for live steps; None for one whose file is gone or damaged by now."""
        if number not in self._ready:
            try:
                self._ready[number] = self._small.live.ready(self._atlas.chart(number).model)
            except SoftfuseError as error:
                log.warning("the full body is used there: %s", error)
                self._ready[number] = None
        return self._ready[number]

    def _whole(self, number: int, state: State) -> State:
        """The full body's state for that of a chart."""
        # Unlike jnp.asarray, device_put compiles nothing.
        return replace(state, z=jax.device_put(self._atlas.chart(number).basis.states(np.asarray(state.z))))

    def _corrected(self, before: State, seen: Observation, limits: Limits) -> Estimate:
        """The full body's estimate, from the state that the reduced one, if any, had before."""
        full = self._prepare().full.result()
        if not self._on_full:
            full.go_on(None if self._number is None else self._whole(self._number, before), seen.places)
            self._on_full = True
        return replace(full.update(seen, limits), corrected=True)
