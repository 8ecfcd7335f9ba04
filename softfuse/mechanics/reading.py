"""What sensors measure of an equilibrium: functionals of the shape, what answers an actuator, or its drive.

A reading is what has changed since the body was at rest and nothing pressed, in SI units. It is a
differentiable function of the state, so that `jax.jacfwd` of it through the equilibrium is the compliance
W_va of Navarro et al. 2020, eq. 8.
"""

from abc import abstractmethod
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.body.base import AbstractBody
from softfuse.functional.base import AbstractFunctional
from softfuse.mechanics.load import Loads
from softfuse.mechanics.reaction import Reaction
from softfuse.mechanics.solution import State


class Equilibrium(NamedTuple):
    """A body in a state under the loads of `contacts`, then of `actuators`."""

    body: AbstractBody
    contacts: Loads
    actuators: Loads
    state: State

    @property
    def drives(self) -> Float[Array, " a"]:
        """What the actuators are driven with (a,)."""
        return self.state.of_last(self.actuators).drive

    @property
    def answers(self) -> Float[Array, " a"]:
        """What answers the actuators' drives (a,), see `AbstractLoad.conjugate`."""
        if not self.actuators.parts:
            return jnp.zeros(0)
        own = self.state.of_last(self.actuators)
        return self.actuators.conjugate(own.force, own.internal, self.actuators.values(self.body, own.z))


class AbstractReading(eqx.Module):
    """One or several numbers that a sensor measures."""

    @property
    @abstractmethod
    def count(self) -> int:
        """How many numbers."""

    @property
    def answered(self) -> tuple[int, ...]:
        """The actuators' drive (count,) that each number answers; -1 for those that answer none."""
        return (-1,) * self.count

    @property
    def driven(self) -> tuple[int, ...]:
        """The actuators' drive (count,) that each number is; -1 for those that are none."""
        return (-1,) * self.count

    @property
    def single(self) -> "tuple[AbstractReading, ...]":
        """It, or those that are joined in it, one by one."""
        return (self,)

    @abstractmethod
    def of(self, at: Equilibrium) -> Float[Array, " count"]:
        """The numbers (count,) in SI units, 0 at rest."""


class ShapeReading(AbstractReading):
    """A functional of the configuration: how it differs from rest."""

    functional: AbstractFunctional

    @property
    def count(self):
        """That of the functional."""
        return self.functional.count

    def of(self, at):
        """g(z) − g(0)."""
        return jnp.ravel(self.functional.change(at.body, at.state.z))


class AnswerReading(AbstractReading):
    """What answers the actuators' drives of these numbers: the shortening of a cable that is pulled with a
    tension, the gauge pressure of sealed gas.
    """

    numbers: tuple[int, ...] = eqx.field(static=True)

    @property
    def count(self):
        """One for each drive."""
        return len(self.numbers)

    @property
    def answered(self):
        """Those drives."""
        return self.numbers

    def of(self, at):
        """The answers."""
        return at.answers[np.array(self.numbers, int)]


class DriveReading(AbstractReading):
    """The actuators' drives of these numbers: the tension of a cable, the pressure in a chamber."""

    numbers: tuple[int, ...] = eqx.field(static=True)

    @property
    def count(self):
        """One for each drive."""
        return len(self.numbers)

    @property
    def driven(self):
        """Those drives."""
        return self.numbers

    def of(self, at):
        """The drives."""
        return at.drives[np.array(self.numbers, int)]


class ReactionReading(AbstractReading):
    """Force [N] and moment [N m] with which the body is held, minus those at rest, which carry its weight;
    `carried`: actuators by number whose other end is on the body's side.
    """

    reaction: Reaction
    carried: tuple[int, ...] = eqx.field(static=True)

    @property
    def count(self):
        """Three forces and three moments."""
        return 6

    def of(self, at):
        """R(z) − R(0)."""
        pressing = at.contacts.parts
        loads = Loads((*pressing, *at.actuators.parts))
        internal = tuple(len(pressing) + number for number in self.carried)
        held = Reaction(self.reaction.origin, self.reaction.rotation, internal)
        nothing = State.rest(at.body, Loads(()))
        return held.value(at.body, loads, at.state) - self.reaction.value(at.body, Loads(()), nothing)


class JointReading(AbstractReading):
    """Several readings, one after the other."""

    parts: tuple[AbstractReading, ...]

    @property
    def count(self):
        """That of all."""
        return sum(part.count for part in self.parts)

    @property
    def answered(self):
        """Those of all."""
        return tuple(number for part in self.parts for number in part.answered)

    @property
    def driven(self):
        """Those of all."""
        return tuple(number for part in self.parts for number in part.driven)

    @property
    def single(self):
        """Those of all."""
        return tuple(each for part in self.parts for each in part.single)

    def of(self, at):
        """All numbers."""
        return jnp.concatenate([jnp.zeros(0), *(part.of(at) for part in self.parts)])
