"""What a tree is made of, as JSON: its classes and what they hold, arrays by a hash of their values.

Where shapes stand for arrays, trees of the same outline make the same program, as long as classes and
functions of the same name are the same: so only those of softfuse have one. A tree without arrays is found
again from its outline.
"""

import hashlib
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from enum import Enum
from importlib import import_module
from types import FunctionType
from typing import Any

import jax
import numpy as np

PACKAGE = "softfuse"


def outline(tree: Any) -> Any:
    """The outline of a tree of dataclasses, named tuples, tuples, lists, dictionaries, enumerations, numbers,
    strings, functions, arrays and shapes of arrays.

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
