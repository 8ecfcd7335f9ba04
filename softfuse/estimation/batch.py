"""Many problems at once: a pure function of a model over a batch, on one accelerator or split over several.

Reduced bodies are small dense problems, which an accelerator solves by the thousand; the full body's batched
multifrontal factors run there too. Each device goes through its own part of the batch by itself, so that none
waits for another one's iterations.
"""

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import Array, PyTree

from softfuse.errors import SolveError

T = TypeVar("T")

_AXIS = "batch"
Shared = TypeVar("Shared")

One = TypeVar("One")

Found = TypeVar("Found")


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def shared_out(one: Callable[..., T], *many: Iterable) -> Iterator[T]:
    """What `one` finds for each of many, in their order, as many threads at a time as there are cores: a
    compiled program leaves Python to the others.

    Whoever stops waiting waits only for what has been begun.
    """
    threads = ThreadPoolExecutor(cores())
    try:
        yield from threads.map(one, *many)
    finally:
        threads.shutdown(cancel_futures=True)


def side_by_side(one: Callable[..., tuple[np.ndarray, ...]], *many: np.ndarray) -> tuple[np.ndarray, ...]:
    """What `one` finds for each of many, shared out over the cores, one after the other stacked."""
    return tuple(np.array(each) for each in zip(*shared_out(one, *many), strict=True))


def batched(
    function: Callable[[Shared, One], Found],
    shared: Shared,
    many: One,
    *,
    at_once: int = 64,
    devices: Sequence[Any] | None = None,
) -> Found:
    """function(shared, one) of every one of `many`, whose arrays (b, ...) have the batch as their first axis;
    what is found has it too.

    `function`: pure, with arrays as results, such as `lambda model, at: simulate(model, *at).state`; give
    the same function each time, programs are compiled for every other one. `shared`: what is the same for
    all, such as the model. `at_once`: so many are solved side by side on each device, as its memory allows;
    `devices`: those of JAX that the batch is split over, None for all of its default kind. Differentiable
    where the function is. Raises SolveError when `many` is empty or its arrays are of unequal length.
    """
    lengths = {len(leaf) for leaf in jax.tree.leaves(many)}
    if len(lengths) != 1 or not (count := lengths.pop()):
        raise SolveError("a batch needs arrays of equal length, one entry or more for each problem")
    mesh = Mesh(np.array(jax.devices() if devices is None else devices), (_AXIS,))
    at_once = min(at_once, -(-count // mesh.size))
    # Equal parts in whole steps; the last problem is solved again where there is none left.
    rows = jnp.minimum(jnp.arange(count + -count % (at_once * mesh.size)), count - 1)
    found = _run(function, at_once, mesh, shared, jax.tree.map(lambda leaf: jnp.asarray(leaf)[rows], many))
    return jax.tree.map(lambda leaf: leaf[:count], found)


@eqx.filter_jit
def _run(function: Callable, at_once: int, mesh: Mesh, shared: Any, many: PyTree[Array]) -> PyTree[Array]:
    arrays, static = eqx.partition(shared, eqx.is_array)

    def part(arrays: PyTree[Array], own: PyTree[Array]) -> PyTree[Array]:
        here = eqx.combine(arrays, static)
        return jax.lax.map(lambda one: function(here, one), own, batch_size=at_once)

    each, whole = PartitionSpec(_AXIS), PartitionSpec()
    split = jax.shard_map(part, mesh=mesh, in_specs=(whole, each), out_specs=each, check_vma=False)
    return split(arrays, many)
