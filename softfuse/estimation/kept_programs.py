"""Programs that are kept, so that the next start neither traces nor lowers them.

Beside JAX's cache of what XLA made of a program lies the program itself as `jax.export` writes it, StableHLO,
in a file named by the hash of all that it was traced from: softfuse's source, the libraries' versions, JAX's
settings, the outline of what it is given, and the values that become constants of it. A file whose content is
not what its own hash says, or is not that of its name, is written anew. Where there is no cache folder, or a
program cannot be exported (it calls libraries that a new process would not have loaded), all is done without.
"""

import hashlib
import json
import logging
import os
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from functools import cache, cached_property
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from types import FunctionType
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import export
from jaxtyping import Array

Packed = dict[str, Array]
"""Vectors of all leaves of a tree that share a type of number, by its name."""

PACKAGE = "softfuse"
log = logging.getLogger(__name__)

_LIBRARIES = ("jax", "jaxlib", "numpy", "equinox", "jaxopt", "lineax", "optimistix")
"""Whose code takes part in tracing."""

_QUICKLY: dict[str, bool | str] = {"xla_cpu_use_fusion_emitters": False}
"""XLA's older way of fusing loops; a full body's step and the senses are no slower for it."""

_HASH = hashlib.sha256().digest_size


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


def outline(tree: Any) -> Any:
    """What a tree is made of, as JSON: its classes and what they hold, arrays by a hash of their values.

    Of dataclasses, named tuples, tuples, lists, dictionaries, enumerations, numbers, strings, functions,
    arrays and shapes of arrays. Where shapes stand for arrays, trees of the same outline make the same
    program, as long as classes and functions of the same name are the same: so only those of softfuse have
    one. A tree without arrays is found again from its outline.

    Raises TypeError for anything else, and for classes and functions that are not softfuse's.
    """
    if isinstance(tree, Enum):
        return {"one of": _name(type(tree)), "is": tree.name}
    if tree is None or isinstance(tree, bool | int | float | str) and not isinstance(tree, np.generic):
        return tree
    if isinstance(tree, jax.ShapeDtypeStruct):
        return {"shape": _kind(tree)}
    if isinstance(tree, jax.Array | np.ndarray | np.generic):
        values = hashlib.sha256(np.ascontiguousarray(tree).tobytes()).hexdigest()
        return {"jax" if isinstance(tree, jax.Array) else "numpy": [*_kind(tree), values]}
    if isinstance(tree, FunctionType | type):
        return {"name": _name(tree)}
    if isinstance(tree, dict):
        return {"dict": [[outline(key), outline(value)] for key, value in tree.items()]}
    if type(tree) in (tuple, list):
        return {type(tree).__name__: [outline(each) for each in tree]}
    if is_dataclass(tree):
        names = [field.name for field in fields(tree)]
    elif isinstance(tree, tuple):
        names = type(tree).__dict__.get("_fields", ())
    else:
        raise TypeError(f"{type(tree).__module__}.{type(tree).__qualname__} has no outline")
    return {"class": _name(type(tree)), "holds": [[name, outline(getattr(tree, name))] for name in names]}


def tree_of(outlined: Any) -> Any:
    """The tree, without arrays and functions, of an outline. Raises ValueError for any other outline."""
    if not isinstance(outlined, dict):
        return outlined
    match outlined:
        case {"shape": [kind, shape, weak]}:
            return jax.ShapeDtypeStruct(tuple(shape), np.dtype(kind), weak_type=weak)
        case {"one of": name, "is": member}:
            return _class(name)[member]
        case {"dict": list(items)}:
            return {tree_of(key): tree_of(value) for key, value in items}
        case {"tuple": list(parts)}:
            return tuple(map(tree_of, parts))
        case {"list": list(parts)}:
            return list(map(tree_of, parts))
        case {"class": name, "holds": list(held)}:
            return _holding(_class(name), {key: tree_of(value) for key, value in held})
    raise ValueError(f"no outline of a tree: {str(outlined)[:80]}")


def _kind(array: Any) -> list:
    return [np.dtype(array.dtype).str, list(array.shape), bool(getattr(array, "weak_type", False))]


def _name(thing: Callable) -> str:
    """Where softfuse has a class or function."""
    name = f"{thing.__module__}:{thing.__qualname__}"
    if thing.__module__.split(".")[0] != PACKAGE or "<" in name:
        raise TypeError(f"{name} is not a class or function of {PACKAGE} itself")
    return name


def _class(name: str) -> Any:
    module, _, path = name.partition(":")
    if module.split(".")[0] != PACKAGE:
        raise ValueError(f"{name} is not a class of {PACKAGE}")
    found: Any = import_module(module)
    for part in path.split("."):
        found = getattr(found, part)
    if not isinstance(found, type):
        raise ValueError(f"{name} is not a class")
    return found


def _holding(kind: type, held: dict[str, Any]) -> Any:
    if issubclass(kind, tuple):
        return kind(**held)
    # As it was, not as a constructor would make it.
    made = object.__new__(kind)
    for name, value in held.items():
        object.__setattr__(made, name, value)
    return made


@dataclass(frozen=True, eq=False)
class Lowered:
    """A program that is ready to be compiled; `result`: what it returns, with shapes where arrays will be."""

    program: jax.stages.Lowered
    given: Any
    result: Any

    def compile(self, *, quickly: bool = True) -> "Program":
        """The program as machine code; made `quickly`, in half to three quarters of the time, one of many
        small operations is a fifth slower.
        """
        try:
            compiled = self.program.compile(_QUICKLY if quickly else None)
        except jax.errors.JaxRuntimeError:  # another XLA may have other options
            compiled = self.program.compile()
        return Program(compiled, self.given, self.result)


class Program:
    """A compiled function of trees of arrays like those that it was made for."""

    def __init__(self, compiled: jax.stages.Compiled, given: Any, result: Any):
        """Compiled for flattened arrays of trees of the structure `given`; `result` as of `Lowered`."""
        self._compiled, self._given = compiled, given.children()
        self._kinds, self._structure = jax.tree.flatten(result)

    def __call__(self, *given: Any) -> Any:
        """The result for these trees. Raises TypeError for trees of other structures."""
        return self._run((), given, self._given)

    def bound(self, first: Any) -> Callable[..., Any]:
        """The function of all arguments but the first, which is looked through once and not in each call.

        Raises TypeError for trees of other structures.
        """
        arrays, found = jax.tree.flatten(first)
        own, *others = self._given
        if found != own:
            raise TypeError(f"a program for {own} was given {found}")
        return lambda *given: self._run(arrays, given, others)

    def _run(self, arrays: Sequence[Array], given: tuple[Any, ...], wanted: list[Any]) -> Any:
        gathered = list(arrays)
        for tree, own in zip(given, wanted, strict=True):
            leaves, found = jax.tree.flatten(tree)
            if found != own:
                raise TypeError(f"a program for {own} was given {found}")
            gathered += leaves
        results = iter(self._compiled(*gathered))
        return self._structure.unflatten(
            [next(results) if isinstance(kind, jax.ShapeDtypeStruct) else kind for kind in self._kinds]
        )


def lowered(program: Callable[..., Any], fixed: Any, *given: Any) -> Lowered:
    """`program(fixed, *given)` for trees of arrays, or of their shapes, like `given`; what is not an array in
    its result stays what it is.

    The arrays of `fixed` become constants. The program is read from the folder of JAX's cache of compiled
    programs if it is there, else traced, and kept there for the next time.
    """
    given = jax.tree.map(_shape, given)
    shapes, tree = jax.tree.flatten(given)
    returned = []

    def flat(*arrays: Any) -> list[Any]:
        result = program(fixed, *tree.unflatten(arrays))
        returned[:] = [jax.tree.map(lambda x: _shape(x) if eqx.is_array(x) else x, result)]
        return [leaf for leaf in jax.tree.leaves(result) if eqx.is_array(leaf)]

    flat.__name__ = program.__name__.strip("_")
    traced, path = jax.jit(flat), _path(program, fixed, given)
    if path is not None:
        kept = _read(path)
        if kept is None:
            kept = _written(path, traced, shapes, returned)
        if kept is not None:
            exported, result = kept
            return Lowered(jax.jit(exported.call).lower(*shapes), tree, result)
    direct = traced.lower(*shapes)
    return Lowered(direct, tree, returned[0])


def _shape(array: Any) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct(array.shape, array.dtype, weak_type=getattr(array, "weak_type", False))


@cache
def _source() -> str:
    """The hash of softfuse's source and of what else takes part in tracing."""
    root = Path(__file__).parents[1]
    known = hashlib.sha256(" ".join(version(name) for name in _LIBRARIES).encode())
    for path in sorted(root.rglob("*.py")):
        known.update(f"\0{path.relative_to(root)}\0".encode() + path.read_bytes())
    return known.hexdigest()


def _setting(name: str) -> str:
    """What a setting of JAX is on this thread, here and now."""
    return repr(getattr(jax.config, name, jax.config.values[name]))


def _path(program: Callable, fixed: Any, given: Any) -> Path | None:
    """Where the program is kept, or would be; None where none can be."""
    settings = jax.config.values
    folder = settings["jax_compilation_cache_dir"]
    if not folder or "://" in folder or not settings["jax_enable_compilation_cache"]:
        return None
    try:
        parts = [
            _source(),
            jax.default_backend(),
            {name: _setting(name) for name in sorted(settings) if "cache" not in name},
            outline((program, fixed, given)),
        ]
    except TypeError as error:
        log.info("%s is traced at every start: %s", program.__name__, error)
        return None
    name = hashlib.sha256(json.dumps(parts).encode()).hexdigest()
    return Path(folder) / "softfuse" / f"{program.__name__.strip('_')}-{name}"


def _signature(path: Path, content: bytes) -> bytes:
    return hashlib.sha256(path.name.encode() + content).digest()


def _read(path: Path) -> tuple[export.Exported, Any] | None:
    """The program kept there and what it returns; None where there is none, or another."""
    try:
        data = path.read_bytes()
    except OSError:
        return None
    if data[:_HASH] != _signature(path, data[_HASH:]):
        log.info("%s is damaged and will be replaced", path)
        return None
    told, _, program = data[_HASH:].partition(b"\n")
    return export.deserialize(bytearray(program)), tree_of(json.loads(told))


def _written(
    path: Path, traced: Any, shapes: list[Any], returned: list
) -> tuple[export.Exported, Any] | None:
    """The program as it would be read, kept there if possible; None if it cannot be kept."""
    try:
        program = export.export(traced)(*shapes).serialize()
        content = json.dumps(outline(returned[0])).encode() + b"\n" + bytes(program)
    except (ValueError, NotImplementedError, TypeError) as error:
        log.info("%s is traced at every start: %s", path.name.partition("-")[0], error)
        return None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # Whoever reads meanwhile finds the whole file or none.
        with tempfile.TemporaryDirectory(dir=path.parent) as aside:
            (Path(aside) / path.name).write_bytes(_signature(path, content) + content)
            os.replace(Path(aside) / path.name, path)
    except OSError as error:
        log.info("%s cannot be kept: %s", path, error)
    return export.deserialize(program), returned[0]
