"""Settings of a sensor as parameters of its filter, which are leaves: numbers under the same names."""

from dataclasses import fields
from typing import Any, TypeVar

import equinox as eqx
import jax.numpy as jnp

from softfuse.io.settings import Settings

Kind = TypeVar("Kind", bound=eqx.Module)


def parameters(kind: type[Kind], *settings: Settings, **own: Any) -> Kind:
    """The parameters of a filter, each an array unless it is static or has parameters of its own.

    Args: settings: what holds those that `own` does not give, the first that has a key of a parameter's name,
    with or without its unit: `hold_off_s` is `hold_off`.
    """

    def found(parameter: str) -> Any:
        name = parameter if parameter not in own else ""
        while name:
            for each in settings:
                if name in type(each).model_fields:
                    return getattr(each, name)
            name, _, _ = name.rpartition("_")
        return own[parameter]

    values = dict[str, Any]()
    for field in fields(kind):
        value = found(field.name)
        if not (field.metadata.get("static") or isinstance(value, eqx.Module)):
            value = jnp.asarray(value, int if isinstance(value, int) else float)
        values[field.name] = value
    return kind(**values)
