"""How a robot answers to small presses at many places: what sensors read, and how far it gives way.

A press with a small force F at a place p changes readings by F w(p), w = ∂s/∂F, and moves the body by F v(p).
With H(θ, y) = 0 the balance and the laws of the loads (`newton`), of states y = (z, x), the answer ẏ per
newton obeys

    H_y(θ) ẏ + H_F = 0.

All places share one factor of the tangent stiffness. Derivatives in the robot θ, so also in its rest nodes,
are those of ẏ₀ − M⁻¹ (H_y(θ) ẏ₀ + H_F), M = H_y of the robot as it is: the value is that of ẏ₀, and no
solve is differentiated.
"""

from collections.abc import Callable
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.functional.chart import moved
from softfuse.mechanics.interface import slopes
from softfuse.mechanics.linear_solver import Solve
from softfuse.mechanics.linearised import (
    Coupled,
    Linearised,
    coupled,
    linearise,
    settled_on,
    touched,
    unbalanced,
)
from softfuse.mechanics.load import Loads
from softfuse.mechanics.model import Model
from softfuse.mechanics.newton import tangent_at
from softfuse.mechanics.solution import State

_COLUMNS = 64
"""Right-hand sides that are solved for at once."""


class RestResponse(eqx.Module):
    """Answers to s contacts, each alone on the body at rest.

    by_force (s, k) [reading's SI unit/N]: w; softness (s,) [m/N]: how far the contact sinks in; motion (s, n,
    3) [m/N]: v of all n nodes.
    """

    by_force: Float[Array, "s k"]
    softness: Float[Array, " s"]
    motion: Float[Array, "s n 3"]


@eqx.filter_jit
def rest_response(model: Model, places: Array) -> RestResponse:
    """The answers to contacts at places (s, 3, 3), see `Model`; one newton each, in equal parts on the
    patches of an electrode. Differentiable once in the robot.
    """
    still, inverse = _still(model, places)

    def one(place):
        press = Press.at(model, still, inverse, place, still.rest_state(()))
        return press.felt(press.answer())

    return jax.lax.map(one, places)


@eqx.filter_jit
def place_response(model: Model, places: Float[Array, "s 3 3"]) -> tuple[RestResponse, Float[Array, "s k 2"]]:
    """`rest_response` to contacts at places (s, 3, 3), and how `by_force` changes with the place along its
    tangents, ∂w/∂p (s, k, 2) [reading's SI unit/(N m)]; both differentiable once in the robot.

    With p the place, H_y ∂ẏ/∂p + (∂H_y/∂p) ẏ = 0.
    """
    still, inverse = _still(model, places)

    def one(place):
        press = Press.at(model, still, inverse, place, still.rest_state(()))
        answer = press.answer()
        turned = [press.felt(press.moved(answer, axis)).by_force for axis in jnp.eye(2)]
        return press.felt(answer), jnp.stack(turned, axis=-1)

    return jax.lax.map(one, places)


def _still(model: Model, places: Array) -> tuple[Model, Solve]:
    """The robot without derivatives, and K⁻¹ at rest."""
    still, first = jax.lax.stop_gradient((model, places[:1]))
    return still, tangent_at(still.linear, still.body, still.loads(first), still.rest_state(first))


class Press(eqx.Module):
    """A press on a robot, under the weight of what presses, which tells what touches; M: `system`."""

    model: Model
    place: Array
    state: State
    system: Coupled
    supports: Float[Array, " Q"]
    inverse: Solve

    @classmethod
    def at(cls, model: Model, still: Model, inverse: Solve, place: Array, held: State) -> "Press":
        """On a robot in the state `held`; `still`: the same without derivatives, `inverse`: K⁻¹ there."""
        loads = still.loads(place[None])
        rest = _begun(loads, held)
        return cls.on(model, place, rest, linearise(still.body, loads, inverse, rest), inverse)

    @classmethod
    def on(cls, model: Model, place: Array, rest: State, linear: Linearised, inverse: Solve) -> "Press":
        """On a body linearised at the state `rest`, in which nothing presses yet."""
        loads = linear.held.loads
        settled, y = settled_on(linear, rest)
        slope = slopes(linear.held, (settled.force, settled.internal), y, rest.drive)
        state = State(rest.z + linear.step(settled.force), settled.force, settled.internal, rest.drive)
        return cls(model, place, state, coupled(loads, linear, slope), loads.supports, inverse)

    def value(self) -> State:
        """ẏ per newton, without derivatives in the robot."""
        kind = self.model.contacts[0]
        press = jnp.zeros_like(self.state.drive).at[: kind.drives].set(kind.shares)
        along = self._solved(jnp.zeros_like(self.state.z), -self.system.slope.drive @ press)
        return State(along.z, along.force, along.internal, press)

    def answer(self) -> State:
        """ẏ per newton."""
        return self._mended(self.value(), lambda y: self._balance(self.place, y))

    def moved(self, answer: State, axis: Float[Array, "2"]) -> State:
        """∂ẏ/∂p along an axis (2,) in the tangents."""

        def by_place(y):
            return jax.jvp(
                lambda offset: self._balance(moved(self.place, offset), y), (jnp.zeros(2),), (axis,)
            )[1]

        left, law = by_place(jax.lax.stop_gradient(answer))
        begun = self._solved(-self.inverse(left[:, None])[:, 0], -law)

        def unmet(y):
            return jax.tree.map(jnp.add, self._balance(self.place, y), by_place(answer))

        return self._mended(begun, unmet)

    def felt(self, along: State) -> RestResponse:
        """What is felt of a motion."""
        at = self.place[None]

        def feel(state):
            model = self.model
            return model.reading(state, at), model.depth(at, state), model.body.displacement(state.z)

        return RestResponse(*jax.jvp(feel, (self.state,), (along,))[1])

    def _balance(self, place: Array, along: State) -> tuple[Float[Array, " n"], Float[Array, " r"]]:
        """H_y ẏ: of the balance and of the laws."""

        def unmet(state):
            loads = self.model.loads(place[None])
            values = loads.values(self.model.body, state.z)
            law = loads.equations(state.force, state.internal, values, state.drive)
            return unbalanced(self.model.body, loads, state), law

        return jax.jvp(unmet, (self.state,), (along,))[1]

    def _mended(self, begun: State, unmet: Callable[[State], tuple[Array, Array]]) -> State:
        """y₀ − M⁻¹ unmet(y₀), which has the derivatives of what solves unmet(y) = 0."""
        begun = jax.lax.stop_gradient(begun)
        left, law = unmet(begun)
        return jax.tree.map(jnp.add, begun, self._solved(-self.inverse(left[:, None])[:, 0], -law))

    def _solved(self, alone: Float[Array, " n"], law: Float[Array, " r"]) -> State:
        """M⁻¹, see `Coupled.respond`; forces without what the springs carry."""
        dz, dx = (each[:, 0] for each in self.system.respond(alone[:, None], law[:, None]))
        q = self.state.force.shape[0]
        force = dx[:q] - self.supports * (self.system.pushed.T @ dz)
        return State(dz, force, dx[q:], jnp.zeros_like(self.state.drive))


def _begun(loads: Loads, held: State) -> State:
    """A contact, the first of the loads, on a robot in the state `held`, before it presses."""
    begun = zip(loads.parts[0].start(), (held.force, held.internal, held.drive), strict=True)
    return State(held.z, *(jnp.concatenate(each) for each in begun))


def push_response(
    model: Model, places: Float[Array, "s 3 3"], state: State, slot: int = 0
) -> Float[Array, "s k"]:
    """Readings per newton (s, k) [SI/N] of what the contact `slot` is, at places (s, 3, 3), each alone on the
    robot as its actuators hold it in a state; without derivatives in the robot.

    Places are solved for in blocks, and only for their own ports: the actuators' are the same for all.
    """
    alone = replace(model, contacts=(model.kinds(slot + 1)[slot],), slots=())
    return _pushed(alone, places, state.of_last(Loads(model.actuators)))


@eqx.filter_jit
def _pushed(alone: Model, places: Float[Array, "s 3 3"], held: State) -> Float[Array, "s k"]:
    """Of a model with one kind of contact, and none in the state `held`."""
    body, attached, (kind,) = alone.body, Loads(alone.actuators), alone.contacts
    inverse = tangent_at(alone.linear, body, attached, held)
    untouched = linearise(body, attached, inverse, held)

    def rows(place):
        return Loads((kind.load(body, place),)).rows(body, held.z)

    def one(given):
        place, row, response = given
        loads = alone.loads(place[None])
        rest = _begun(loads, held)
        linear = touched(body, loads, rest, untouched, row, response)
        press = Press.on(alone, place, rest, linear, inverse)
        return press.felt(press.value()).by_force

    carrying = Loads((kind.load(body, places[0]),)).carrying
    count = max(1, _COLUMNS // len(carrying))

    def block(places):
        each = jax.lax.map(rows, places)
        pushed = jnp.moveaxis(each[:, :, carrying], 0, 1)
        response = inverse(pushed.reshape(body.n, -1)).reshape(pushed.shape)
        return jax.lax.map(one, (places, each, jnp.moveaxis(response, 1, 0)))

    s = len(places)
    number = np.minimum(np.arange(-(-s // count) * count), s - 1).reshape(-1, count)
    found = jax.lax.map(block, places[number])
    return found.reshape(-1, found.shape[-1])[:s]
