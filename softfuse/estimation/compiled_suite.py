"""A robot's sensors as one program that is compiled ahead, a few vectors in and a few out.

A frame costs what its arrays cost: to hand a hundred small ones to a program and back takes longer than all
that is computed with them. So memory, readings and observations travel packed, one vector for each type of
number. The memory stays where it was computed; observations are read when they are asked for, all at once.
"""

from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.estimation.kept_programs import Packed, Packing, lowered
from softfuse.sensors.suite import Observation, SensorSuite


@dataclass(frozen=True, eq=False)
class Finding:
    """What the sensors say about a frame, still packed."""

    packed: Packed
    packing: Packing

    @cached_property
    def observation(self) -> Observation:
        """All of it, in numpy's arrays; waits for it."""
        return self.packing.unpack({kind: np.asarray(vector) for kind, vector in self.packed.items()})


def _begun(suite: SensorSuite) -> Packed:
    first = suite.init()
    return Packing.of(first).pack(first)


def _advanced(
    suite: SensorSuite, packed: Packed, frame: Float[Array, " n"]
) -> tuple[Packed, Packed, Packing]:
    # The program keeps its memory in the types of the first one.
    memory = Packing.of(jax.eval_shape(suite.init))
    state, observation = suite.update(memory.unpack(packed), frame[0], frame[1:])
    findings = Packing.of(observation)
    return memory.pack(state), findings.pack(observation), findings


class CompiledSuite:
    """Advances sensors frame by frame; compiled once, on a thread of `compiler`.

    The sensors' parameters become constants of the program: what depends on nothing else is computed then.
    """

    def __init__(self, suite: SensorSuite, compiler: Executor):
        """Begin to compile; the first `update` waits for the end."""
        self._count = len(suite.channels)
        self._first: Packed = lowered(_begun, suite).compile()()
        blank = jnp.zeros(1 + self._count)
        self._float = blank.dtype
        step = lowered(_advanced, suite, self._first, blank)
        self._step: Future[Callable[[Packed, np.ndarray], tuple[Packed, Packed, Packing]]]
        self._step = compiler.submit(step.compile)
        self.reset()

    def reset(self) -> None:
        """Forget the past: nothing has been read, nothing touches."""
        self._memory = self._first

    def update(self, time_s: float, raw: Float[np.ndarray, " n"]) -> Finding:
        """Advance by a frame at `time_s` [s] of raw readings (n,), NaN where missing.

        Raises ValueError for another number of readings.
        """
        if len(raw) != self._count:
            raise ValueError(f"{len(raw)} readings in a frame: the sensors have {self._count} channels")
        frame = np.concatenate([np.array([time_s]), raw]).astype(self._float, copy=False)
        self._memory, packed, packing = self._step.result()(self._memory, frame)
        return Finding(packed, packing)
