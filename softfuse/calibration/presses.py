"""Presses of known place and force, and what a robot with other parameters would have read in them.

One program answers for one press, its readings and their slopes in all parameters: one equilibrium, and one
adjoint for each reading. It is compiled once and shared out over threads. An equilibrium is searched from
that of the sample before in the same press, or from where it was with other parameters.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.calibration.adjustment import AbstractAdjustment, Adjustments, Measure
from softfuse.errors import SolveError
from softfuse.estimation.batch import shared_out
from softfuse.functional.chart import nearest
from softfuse.mechanics.load import AbstractContact
from softfuse.mechanics.model import Model, simulate
from softfuse.mechanics.solution import RESULTS, Solution, State


@dataclass(frozen=True, eq=False)
class Applied:
    """What is done to a robot in s samples, by c contacts in each.

    `place` (s, c, 3, 3): see `functional.chart`; `force_N` (s, c): 0 where a contact does not press;
    `prescribed` (s, a): drives of the actuators; `press` (s,): samples with the same number belong to one
    press, one after the other; a negative number is none's.
    """

    place: np.ndarray
    force_N: Float[np.ndarray, "s c"]
    prescribed: Float[np.ndarray, "s a"]
    press: Int[np.ndarray, " s"]

    def only(self, which: Int[np.ndarray, " t"]) -> Self:
        """Some of the samples, by number."""
        return type(self)(*(getattr(self, each.name)[which] for each in fields(self)))


@dataclass(frozen=True, eq=False)
class Presses:
    """s samples of presses: what was `applied`, and `reading` (s, k) in SI with standard deviations `sigma`
    (s, k) of the sensors' noise, inf for one that says nothing; the `kind` (k,) of each reading, see
    `model_error.missed`.
    """

    applied: Applied
    reading: Float[np.ndarray, "s k"]
    sigma: Float[np.ndarray, "s k"]
    kind: Int[np.ndarray, " k"]

    @property
    def told(self) -> Any:
        """Which readings (s, k) say something."""
        return np.isfinite(self.reading) & np.isfinite(self.sigma)


@dataclass(frozen=True, eq=False)
class Answer:
    """Readings (s, k) in SI of a robot, their slopes (s, k, p) in its parameters, its equilibria (s,), and
    the numbers (s,) of the samples that these belong to, among those that were asked for.
    """

    reading: Float[np.ndarray, "s k"]
    slope: Float[np.ndarray, "s k p"]
    states: tuple[State, ...]
    sample: Int[np.ndarray, " s"]


@dataclass(frozen=True, eq=False)
class Adjustable:
    """A robot as configured, with parameters 0, which may be adjusted; compiles when first asked."""

    model: Model
    adjustments: Adjustments

    def answer(
        self,
        value: Float[np.ndarray, " p"],
        applied: Applied,
        *,
        near: tuple[State, ...] | None = None,
        needed: bool = True,
        seen: Callable[[], None] = lambda: None,
    ) -> Answer:
        """What the robot with parameters (p,) reads in samples (s,); `near` (s,): equilibria of nearly the
        same robot, to start from; `needed`: whether each sample is, others are left out where they have no
        equilibrium; `seen` is called after each sample.

        Raises SolveError naming the press that has no equilibrium, where it is needed or none has one.
        """
        found: dict[int, tuple[np.ndarray, np.ndarray, State]] = {}

        def press(samples: Int[np.ndarray, " t"]) -> None:
            before = None
            for i in samples:
                start = before if near is None else near[i]
                given = applied.place[i], applied.force_N[i], applied.prescribed[i], applied.press[i]
                try:
                    found[i] = self._one(value, given, start)
                    before = found[i][2]
                except SolveError:
                    if needed:
                        raise
                seen()

        # What else waits for these is lost where one fails.
        list(shared_out(press, _by_press(applied)))
        if not found:
            raise SolveError("none of the presses that were looked at has an equilibrium")
        samples = sorted(found)
        reading, slope, states = zip(*(found[i] for i in samples), strict=True)
        return Answer(np.array(reading), np.array(slope), states, np.array(samples))

    def _one(
        self,
        value: np.ndarray,
        given: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | np.integer],
        start: State | None,
    ) -> tuple[np.ndarray, np.ndarray, State]:
        rest = self.model.rest_state(jnp.asarray(given[0]))
        for begin in (rest,) if start is None else (start, rest):
            slope, (reading, found) = _read(self.model, self.adjustments, value, given, begin)
            if bool(found.result == RESULTS.converged):
                return np.asarray(reading), np.asarray(slope), found.state
        place, force, *_ = given
        raise SolveError(
            f"the press with {_listed(force)} N at {_said(place)} has no equilibrium with the parameters "
            f"that the fit tries: {RESULTS[found.result]}"
        )


def _by_press(applied: Applied) -> list[Int[np.ndarray, " _"]]:
    """The samples of each press while nothing but its forces changes, in their order."""
    ends = np.zeros(len(applied.press), bool)
    ends[1:] = applied.press[1:] != applied.press[:-1]
    ends[1:] |= np.any(applied.place[1:] != applied.place[:-1], axis=tuple(range(1, applied.place.ndim)))
    ends |= applied.press < 0
    return np.split(np.arange(len(ends)), np.flatnonzero(ends[1:]) + 1)


def _listed(numbers: np.ndarray) -> str:
    return ", ".join(f"{number:.2f}" for number in numbers)


def _said(place: np.ndarray) -> str:
    """Places as people read them."""
    return ", ".join(f"({_listed(1e3 * at[0])}) mm" for at in place)


@eqx.filter_jit
def _read(model: Model, adjustments: Adjustments, value: Any, given: Any, start: State) -> Any:
    place, force, prescribed, press = given

    def read(value: Array) -> tuple[Array, tuple[Array, Solution]]:
        made = adjustments.adjusted(model, value)
        arms = adjustments.arms(jnp.zeros(len(force)), press, value)
        kinds = made.kinds(len(place))
        forces = [_shared(kind, *each) for kind, *each in zip(kinds, force, arms, strict=True)]
        drive = jnp.concatenate([*forces, adjustments.prescribed(prescribed, value)])
        found = simulate(made, place, drive, start)
        reading = adjustments.measured(made.reading(found.state, place), value)
        return reading, (reading, found)

    place = jnp.asarray(place)
    return jax.jacrev(read, has_aux=True)(jnp.asarray(value))


def _shared(kind: AbstractContact, force: Array, arm: Array) -> Float[Array, " d"]:
    """The drives (d,) [N] of a contact that presses with a force [N], an arm [m] from its place's middle."""
    arms = kind.arms
    square = jnp.sum(arms**2)
    return force * (kind.shares + arm * arms / jnp.where(square > 0, square, 1.0))


class ContactPlaces(AbstractAdjustment):
    """θ (p,) [m]: how far along its electrode each contact of each press acts from the middle.

    `number` (n + 1, c): which θ belongs to contact c of press n, p for none; none does in the last row.
    """

    measure: ClassVar[Measure] = Measure.length
    sigma: Float[Array, " p"]
    number: Int[Array, "n1 c"]
    names: tuple[str, ...] = eqx.field(static=True)

    @classmethod
    def of(
        cls,
        applied: Applied,
        called: dict[int, str],
        electrodes: Mapping[str, Float[np.ndarray, "3 3"]],
        sigma: float,
    ) -> Self:
        """Of presses 0, 1 ..., so called by people, on named electrodes; prior standard deviation [m]."""
        presses, contacts = int(applied.press.max(initial=-1)) + 1, applied.force_N.shape[1]
        number, names = np.full((presses + 1, contacts), -1), list[str]()
        known, at = list(electrodes), np.array(list(electrodes.values()))
        for press in range(presses):
            on = applied.press == press
            for contact in np.flatnonzero(np.any(applied.force_N[on] > 0, axis=0)):
                number[press, contact] = len(names)
                pushed = on & (applied.force_N[:, contact] > 0)
                where = known[int(nearest(at, applied.place[pushed][0, contact]))]
                names.append(f"place on {where} in press {called[press]}")
        number = np.where(number < 0, len(names), number)
        return cls(sigma=jnp.full(len(names), sigma), number=jnp.asarray(number), names=tuple(names))

    def arms(self, arm, press, value):
        """Where contacts act; in the middle in a press that is none of those."""
        padded = jnp.append(value, 0.0)
        return arm + padded[self.number[jnp.where(press < 0, len(self.number) - 1, press)]]
