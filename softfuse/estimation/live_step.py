"""The programs of a live step, compiled ahead, and what goes from frame to frame between them.

A frame costs what its arrays cost, see `compiled_suite`: what a frame brings and what its step reports
travel packed, and what does not change from frame to frame is handed over once. What stays in between, the
state, the factor and the forces that the body answers with in it, stays where it was computed. These forces
are found at a step's end, together with the volumes there, for both need the body's strains.
"""

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from softfuse.errors import SolveError
from softfuse.estimation.kept_programs import Packed, Packing, lowered
from softfuse.estimation.limits import Limits
from softfuse.estimation.step import Observation, PlacePrior, StepReport, estimate_step
from softfuse.mechanics.linearised import loaded_tangents
from softfuse.mechanics.model import Model
from softfuse.mechanics.solution import State

_LEAST_MOTION = 1e-3
"""The part of the whole motion below which what a step leaves to do is noise."""
_NO_MOTION = 1e-12
"""Keeps a body that rests from dividing by 0."""


class Carried(NamedTuple):
    """From frame to frame: the state, the `last` step (n,) to it, the factor of a tangent `made_at` a state
    (n,), and r(z) (n,) at the state.
    """

    state: State
    last: Float[Array, " n"]
    factor: PyTree[Array]
    made_at: Float[Array, " n"]
    resistance: Float[Array, " n"]


class Stepped(NamedTuple):
    """What a step says to its caller, in numpy's arrays: drives (D,) after it, and its report."""

    drive: Float[Array | np.ndarray, " D"]
    report: StepReport


class _After(NamedTuple):
    """What a step's program returns."""

    state: State
    last: Float[Array, " n"]
    resistance: Float[Array, " n"]
    told: Packed


class Ready(NamedTuple):
    """A robot as the compiled programs want it: its arrays, the step of it, and how it rests."""

    arrays: Model
    step: Callable[[Carried, Packed], _After]
    rest: Carried


def _rest(static: Model, arrays: Model, places: Array) -> State:
    return eqx.combine(arrays, static).rest_state(places)


def _begun(static: Model, arrays: Model, state: State, last: Float[Array, " n"], places: Array) -> Carried:
    model = eqx.combine(arrays, static)
    body = model.body.expecting(state.z, last)
    factor = model.linear.factor(loaded_tangents(body, model.loads(places), state))
    return Carried(state, last, factor, state.z, model.body.residual(state.z))


def _known(static: Model, arrays: Model, state: State, last: Float[Array, " n"], places: Array) -> Carried:
    del places
    model = eqx.combine(arrays, static)
    rest = jnp.zeros_like(state.z)
    return Carried(state, last, model.linear.at_rest(), rest, model.body.residual(state.z))


def _stepped(
    fixed: tuple[Model, int, Packing, Packing], arrays: Model, carried: Carried, frame: Packed
) -> _After:
    static, refinements, frames, reports = fixed
    model = eqx.combine(arrays, static)
    limits, seen = frames.unpack(frame)
    factor = model.linear.near(carried.factor, carried.made_at, carried.state.z)
    after, report = estimate_step(
        model,
        limits,
        factor,
        carried.state,
        seen,
        refinements=refinements,
        last=carried.last,
        resistance=carried.resistance,
    )
    resistance = model.body.residual(after.z)
    if refinements == 0:
        left = _left_to_do(model, factor, carried.state, after, resistance, seen.places)
        report = report._replace(contraction=left)
    told = reports.pack(Stepped(after.drive, report))
    return _After(after, after.z - carried.state.z, resistance, told)


def _left_to_do(
    model: Model, factor: PyTree[Array], before: State, after: State, resistance: Array, places: Array
) -> Float[Array, ""]:
    # How far a step would go to balance what the one before it left out of balance, as a part of that one.
    left = resistance - model.loads(places).push(model.body, after.z, after.force)
    again = model.linear.solve(factor, left[:, None])[:, 0]
    gone = jnp.linalg.norm(after.z - before.z)
    return jnp.linalg.norm(again) / (gone + _LEAST_MOTION * jnp.linalg.norm(after.z) + _NO_MOTION)


class LiveStep:
    """The programs of robots of one structure and size; compiled when made."""

    def __init__(
        self, model: Model, limits: Limits, places: Array, refinements: int, *, places_known: bool = True
    ):
        """Compile for as many contacts as there are `places` (c, ...), wherever they are, and for
        observations whose `places_known` are exact or have a prior; `first` is the robot, made ready.

        Raises SolveError when the body's tangent at rest is singular, or when the limits are for another
        number of drives than contacts and attached loads have.
        """
        arrays, static = _split(model)
        self._static, self.places = static, places
        started = time.perf_counter()
        # XLA compiles the smaller programs on another thread while the step is traced on this one.
        with ThreadPoolExecutor(1) as aside:
            rest = lowered(_rest, static, arrays, places)
            rests = aside.submit(rest.compile)
            drive = rest.result.drive
            if limits.upper.shape != drive.shape:
                raise SolveError(
                    f"{limits.upper.shape[0]} limits for {drive.shape[0]} drives: give one for each "
                    "contact, then for each attached load"
                )
            readings = jnp.zeros(model.n_readings)
            white = jnp.zeros((model.n_readings, model.n_readings))
            self._prior = None if places_known else _all_known(places)
            seen = Observation(readings, white, places, self._prior)
            self._frames = Packing.of((limits, seen))
            self._reports = Packing.of(_report_like(model, drive, seen))
            makes = _known if static.linear.knows else _begun
            on = lowered(makes, static, arrays, rest.result, rest.result.z, places)
            goes_on = aside.submit(on.compile)
            fixed = static, 0 if static.linear.knows else refinements, self._frames, self._reports
            step = lowered(_stepped, fixed, arrays, on.result, self._frames.vectors)
            self._step = step.compile(quickly=not static.linear.knows)
            self._rest, self._on = rests.result(), goes_on.result()
        self._begun = None if static.linear.knows else goes_on
        self.first = self._ready(arrays, self._rest(arrays, places))
        self.compile_s = time.perf_counter() - started

    def ready(self, model: Model) -> Ready:
        """Another robot of the same structure and size, prepared for the same programs.

        Raises SolveError when it has another structure, or its tangent at rest is singular.
        """
        arrays, static = _split(model)
        if static != self._static:
            raise SolveError("a robot of another structure needs an estimator of its own")
        return self._ready(arrays, self._rest(arrays, self.places))

    def prepare_begin(self) -> None:
        """Compile, on a thread of its own, what `begin` needs, if that is not done: where factors are known,
        the first steps need no new one.
        """
        if self._begun is None:
            rest = self.first.rest
            given = self.first.arrays, rest.state, rest.last, self.places
            thread = ThreadPoolExecutor(1)
            self._begun = thread.submit(lambda: lowered(_begun, self._static, *given).compile())
            thread.shutdown(wait=False)

    def begin(self, ready: Ready, carried: Carried, places: Array) -> Carried:
        """The same with a new factor, under contacts at `places` (c, ...)."""
        self.prepare_begin()
        assert self._begun is not None
        return self._begun.result()(ready.arrays, carried.state, carried.last, places)

    def go_on(self, ready: Ready, state: State, places: Array) -> Carried:
        """What is carried from a state near an equilibrium on; no factor is made where such are known."""
        return self._on(ready.arrays, state, np.zeros(state.z.shape), places)

    def step(
        self, ready: Ready, carried: Carried, limits: Limits, seen: Observation
    ) -> tuple[Carried, Stepped]:
        """One step; waits for it. Places without a prior are known."""
        seen = seen if seen.prior is not None else seen._replace(prior=self._prior)
        after = ready.step(carried, self._frames.pack((limits, seen), np))
        told = self._reports.unpack({kind: np.asarray(vector) for kind, vector in after.told.items()})
        return carried._replace(state=after.state, last=after.last, resistance=after.resistance), told

    def _ready(self, arrays: Model, rest: State) -> Ready:
        carried = self._on(arrays, rest, np.zeros(rest.z.shape), self.places)
        if not all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(carried.factor)):
            raise SolveError(
                "the body's stiffness at rest is singular: fix more nodes, or mend materials and mesh"
            )
        return Ready(arrays, self._step.bound(arrays), carried)


def _split(model: Model) -> tuple[Model, Model]:
    # Each step refines what it solves for, so a rough factor serves.
    rough = replace(model, body=model.body.rough(), linear=model.linear.rough())
    return eqx.partition(rough, eqx.is_array)


def _all_known(places: Array) -> PlacePrior:
    """Of places that are known."""
    each = np.zeros((len(places), 2))
    return PlacePrior(each, np.zeros((each.size, each.size)), each, each)


def _report_like(model: Model, drive: jax.ShapeDtypeStruct, seen: Observation) -> Stepped:
    """What `Stepped` is like, by shapes."""
    k, drives = model.n_readings, drive.shape[0]
    offset = None if seen.prior is None else seen.prior.offset
    unknowns = drives + (0 if offset is None else offset.size)
    number = jnp.zeros(())
    misfit, w, g = jnp.zeros(k), jnp.zeros((k, drives)), jnp.zeros((k, unknowns - drives))
    information = jnp.zeros((unknowns, unknowns))
    return Stepped(jnp.zeros(drives), StepReport(misfit, w, g, information, offset, *[number] * 6))
