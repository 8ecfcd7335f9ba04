"""The senses of a device as one program that is compiled ahead, a few vectors in and a few out.

A frame costs what its arrays cost: to hand a hundred small ones to a program and back takes longer than all
that is computed with them. So memory, readings and findings travel packed, one vector for each type of
number. The memory stays where it was computed; findings are read when they are asked for, all at once.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.estimation.kept_programs import lowered
from softfuse.estimation.packing import Packed, Packing
from softfuse.sensors.senses import AbstractSenses, Sensed


@dataclass(frozen=True, eq=False)
class Finding:
    """What the senses say about a frame, still packed."""

    packed: Packed
    packing: Packing

    @cached_property
    def sensed(self) -> Sensed:
        """All of it, in numpy's arrays; waits for it."""
        return self.packing.unpack({kind: np.asarray(vector) for kind, vector in self.packed.items()})


def _begun(senses: AbstractSenses) -> Packed:
    first = senses.init()
    return Packing.of(first).pack(first)


def _advanced(
    senses: AbstractSenses, packed: Packed, frame: Float[Array, " n"]
) -> tuple[Packed, Packed, Packing]:
    # The program keeps its memory in the types of the first one.
    memory = Packing.of(jax.eval_shape(senses.init))
    ends = 1 + np.cumsum(senses.channels)
    groups = tuple(frame[end - n : end] for n, end in zip(senses.channels, ends, strict=True))
    state, sensed = senses.update(memory.unpack(packed), frame[0], groups)
    findings = Packing.of(sensed)
    return memory.pack(state), findings.pack(sensed), findings


class CompiledSenses:
    """Advances senses frame by frame; compiled once, on a thread of `compiler`.

    The senses' parameters become constants of the program: what depends on nothing else is computed then.
    """

    def __init__(self, senses: AbstractSenses, compiler: Executor):
        """Begin to compile; the first `update` waits for the end."""
        self._channels = senses.channels
        self._first: Packed = lowered(_begun, senses).compile()()
        blank = jnp.zeros(1 + sum(self._channels))
        self._float = blank.dtype
        step = lowered(_advanced, senses, self._first, blank)
        like = step.result[2].like
        self.places = jnp.zeros(like.places.shape, like.places.dtype)
        """What `Sensed.places` is like."""
        self._step: Future[Callable[[Packed, np.ndarray], tuple[Packed, Packed, Packing]]]
        self._step = compiler.submit(step.compile)
        self.reset()

    def reset(self) -> None:
        """Forget the past: nothing has been read, nothing touches."""
        self._memory = self._first

    def update(self, time_s: float, readings: Sequence[Float[np.ndarray, " n"]]) -> Finding:
        """Advance by a frame at `time_s` [s] of readings (n,) in each group, NaN where missing.

        Raises ValueError for another number of readings.
        """
        if tuple(map(len, readings)) != self._channels:
            raise ValueError(
                f"groups of {', '.join(str(len(group)) for group in readings)} readings: the senses want "
                + ", ".join(map(str, self._channels))
            )
        frame = np.concatenate([np.array([time_s]), *readings]).astype(self._float, copy=False)
        self._memory, packed, packing = self._step.result()(self._memory, frame)
        return Finding(packed, packing)
