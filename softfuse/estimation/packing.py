"""Trees of many small arrays as a few vectors, one for each type of number."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

Packed = dict[str, Array]
"""Vectors of all leaves of a tree that share a type of number, by its name."""


@dataclass(frozen=True, eq=False)
class Packing:
    """Where the leaves of one kind of tree, those of shapes `like`, are in its vectors."""

    like: Any

    @classmethod
    def of(cls, tree: Any) -> "Packing":
        """The packing of trees like this one of arrays or their shapes."""
        return cls(jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape, leaf.dtype), tree))

    @cached_property
    def _structure(self) -> Any:
        return jax.tree.structure(self.like)

    @cached_property
    def _places(self) -> list[tuple[str, int, int, tuple[int, ...], np.dtype]]:
        """Of each leaf: the vector, its begin and end there, its shape and type."""
        places, ends = [], {}
        for leaf in jax.tree.leaves(self.like):
            kind, start = str(leaf.dtype), ends.get(str(leaf.dtype), 0)
            ends[kind] = start + int(np.prod(leaf.shape))
            places.append((kind, start, ends[kind], leaf.shape, np.dtype(leaf.dtype)))
        return places

    @property
    def vectors(self) -> dict[str, jax.ShapeDtypeStruct]:
        """The shapes of the vectors."""
        ends = {kind: end for kind, _, end, *_ in self._places}
        return {kind: jax.ShapeDtypeStruct((end,), kind) for kind, end in ends.items()}

    def pack(self, tree: Any, of: Any = jnp) -> Packed:
        """The vectors of a tree, by functions `of` jax.numpy or numpy; raises ValueError for a tree of
        another kind.
        """
        leaves = self._structure.flatten_up_to(tree)
        gathered: dict[str, list[Array]] = {}
        for leaf, (kind, _, _, shape, dtype) in zip(leaves, self._places, strict=True):
            if leaf.shape != shape or leaf.dtype != dtype:
                raise ValueError(
                    f"a leaf of {leaf.dtype}{list(leaf.shape)} where {kind}{list(shape)} is kept"
                )
            # Of an array of JAX, numpy's view costs less than a reshape.
            gathered.setdefault(kind, []).append(of.asarray(leaf).reshape(-1))
        return {kind: of.concatenate(parts) for kind, parts in gathered.items()}

    def unpack(self, packed: Packed | dict[str, np.ndarray]) -> Any:
        """The tree that was packed."""
        leaves = [packed[kind][start:end].reshape(shape) for kind, start, end, shape, _ in self._places]
        return self._structure.unflatten(leaves)
