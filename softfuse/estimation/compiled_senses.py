"""The senses of a device as one program that is compiled ahead, a few vectors in and a few out.

A frame costs what its arrays cost: to hand a hundred small ones to a program and back takes longer than all
that is computed with them. So memory, readings and findings travel packed, one vector for each type of
number. The memory stays where it was computed; findings are read when they are asked for, all at once.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.sensing.senses import AbstractSenses, Sensed

Packed = dict[str, Array]
"""Vectors of all leaves of a tree that share a type of number, by its name."""


class Packing:
    """Where the leaves of one kind of tree are in its vectors."""

    def __init__(self, like: Any):
        """`like`: a tree of that kind, of arrays or of their shapes."""
        leaves, self._structure = jax.tree.flatten(like)
        self._places: list[tuple[str, int, int, tuple[int, ...]]] = []
        ends: dict[str, int] = {}
        for leaf in leaves:
            kind, start = str(leaf.dtype), ends.get(str(leaf.dtype), 0)
            ends[kind] = start + int(np.prod(leaf.shape))
            self._places.append((kind, start, ends[kind], leaf.shape))

    def pack(self, tree: Any) -> Packed:
        """The vectors of a tree; raises ValueError for a tree of another kind."""
        leaves = self._structure.flatten_up_to(tree)
        gathered: dict[str, list[Array]] = {}
        for leaf, (kind, _, _, shape) in zip(leaves, self._places, strict=True):
            if leaf.shape != shape or leaf.dtype != kind:
                raise ValueError(
                    f"a leaf of {leaf.dtype}{list(leaf.shape)} where {kind}{list(shape)} is kept"
                )
            gathered.setdefault(kind, []).append(jnp.ravel(leaf))
        return {kind: jnp.concatenate(parts) for kind, parts in gathered.items()}

    def unpack(self, packed: Packed | dict[str, np.ndarray]) -> Any:
        """The tree that was packed."""
        leaves = [packed[kind][start:end].reshape(shape) for kind, start, end, shape in self._places]
        return self._structure.unflatten(leaves)


@dataclass(frozen=True, eq=False)
class Finding:
    """What the senses say about a frame, still packed."""

    packed: Packed
    packing: Packing

    @cached_property
    def sensed(self) -> Sensed:
        """All of it, in numpy's arrays; waits for it."""
        return self.packing.unpack({kind: np.asarray(vector) for kind, vector in self.packed.items()})


class CompiledSenses:
    """Advances senses frame by frame; compiled once, on a thread of `compiler`.

    The senses' parameters become constants of the program: what depends on nothing else is computed then.
    """

    def __init__(self, senses: AbstractSenses, compiler: Executor):
        """Begin to compile; the first `update` waits for the end."""
        first = senses.init()
        self._channels = senses.channels
        # The program keeps its memory in the types of the first one.
        memory = Packing(first)
        blank = jnp.zeros(1 + sum(self._channels))
        self._float = blank.dtype
        ends = 1 + np.cumsum(self._channels)

        def advance(state: Any, frame: Float[Array, " n"]) -> tuple[Any, Sensed]:
            groups = tuple(frame[end - n : end] for n, end in zip(self._channels, ends, strict=True))
            return senses.update(state, frame[0], groups)

        like = jax.eval_shape(advance, first, blank)[1]
        self.places = jnp.zeros(like.places.shape, like.places.dtype)
        """What `Sensed.places` is like."""
        findings = Packing(like)

        def step(packed: Packed, frame: Float[Array, " n"]) -> tuple[Packed, Packed]:
            state, sensed = advance(memory.unpack(packed), frame)
            return memory.pack(state), findings.pack(sensed)

        self._first, self._findings = memory.pack(first), findings
        self._step: Future[Callable[[Packed, np.ndarray], tuple[Packed, Packed]]] = compiler.submit(
            jax.jit(step).lower(self._first, blank).compile
        )
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
        self._memory, packed = self._step.result()(self._memory, frame)
        return Finding(packed, self._findings)
