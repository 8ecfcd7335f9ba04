"""What is wrong with a configuration, one line per mistake, each with the path of its key."""

import difflib
import types
from collections.abc import Iterable, Mapping
from typing import Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from softfuse.io.quantity import shown

Location = tuple[int | str, ...]


def problem_lines(error: ValidationError, raw: Mapping[str, Any], model: type[BaseModel]) -> list[str]:
    """A line `key.path[0]: what is wrong` for each mistake in raw, the file's contents, found with model."""
    return [_line(item, raw, model) for item in error.errors(include_url=False)]


def key_path(location: Iterable[int | str]) -> str:
    """`body.material[0].young` for ("body", "material", 0, "young")."""
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in location)
    return text.removeprefix(".")


def _line(item: Mapping[str, Any], raw: Mapping[str, Any], model: type[BaseModel]) -> str:
    kind, context = item["type"], item.get("ctx", {})
    tags, _ = _walked(item["loc"], model)
    place, value = _untagged(item["loc"], raw, tags, keep_last=kind in ("missing", "extra_forbidden"))
    if kind == "softfuse":
        inner = context["key"]
        path = key_path(place) + ("." if place and inner and inner[0] != "[" else "") + inner
        return f"{path}: {context['message']}"
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        path = key_path((*place, context["discriminator"].strip("'")))
        choices = context.get("expected_tags") or ", ".join(_tags(item["loc"], model))
        given = f'"{context["tag"]}" is none of' if "tag" in context else "missing, give one of"
        return f"{path}: {given} {choices}".replace("'", '"')
    return f"{key_path(place)}: {_message(kind, context, item, value, model)}"


def _message(
    kind: str, context: Mapping[str, Any], item: Mapping[str, Any], value: Any, model: type[BaseModel]
) -> str:
    match kind:
        case "missing":
            return "missing"
        case "extra_forbidden":
            return _unknown(str(item["loc"][-1]), _keys(_walked(item["loc"][:-1], model)[1]))
        case "literal_error":
            return f"{shown(value)} is none of {context['expected']}".replace("'", '"').replace(" or ", ", ")
        case "model_type" | "model_attributes_type" | "dict_type":
            return f"{shown(value)} must be a table of keys"
        case "tuple_type" | "list_type":
            return f"{shown(value)} must be a list"
        case "too_long" | "too_short":
            few = context.get("max_length", context.get("min_length"))
            most = "at most" if kind == "too_long" else "at least"
            return f"{context['actual_length']} values, expected {most} {few}"
        case _:
            return f"{shown(value)} {item['msg'].replace('Input should', 'must')}"


def _unknown(key: str, known: list[str]) -> str:
    close = difflib.get_close_matches(key, known, n=1)
    if close:
        return f'unknown key, did you mean "{close[0]}"?'
    return f"unknown key, the known ones are {', '.join(known)}"


def _untagged(location: Location, raw: Any, tags: list[bool], *, keep_last: bool) -> tuple[Location, Any]:
    """The location without the tags of unions that pydantic puts into it, and the value in the file."""
    place: list[int | str] = []
    value = raw
    for k, part in enumerate(location):
        if tags[k]:
            continue
        if isinstance(part, str) and isinstance(value, Mapping):
            if part in value:
                value = value[part]
            elif not (keep_last and k == len(location) - 1):
                continue
        elif isinstance(part, int) and isinstance(value, list):
            value = value[part] if part < len(value) else value
        elif isinstance(part, int) and not isinstance(value, Mapping):
            continue  # a single value that stands for a list of one
        place.append(part)
    return tuple(place), value


def _walked(location: Location, model: type[BaseModel]) -> tuple[list[bool], list[type[BaseModel]]]:
    """Which parts of a location are tags of unions, and the models that may stand at it.

    A tag may be called as a key of what it stands for is: it comes once, and first.
    """
    models, told, tags = [model], False, []
    for part in location:
        tagged = [] if told or isinstance(part, int) else [m for m in models if part in _literals(m)]
        tags.append(bool(tagged))
        if tagged:
            models, told = tagged, True
        elif not isinstance(part, int):
            fields = [f for m in models for name, f in m.model_fields.items() if part == (f.alias or name)]
            models, told = [m for f in fields for m in _models_in(f.annotation)], False
    return tags, models


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and not isinstance(annotation, types.GenericAlias):
        return [annotation] if issubclass(annotation, BaseModel) else []
    return [m for part in get_args(annotation) for m in _models_in(part)]


def _literals(model: type[BaseModel]) -> list[str]:
    """The values of the model's keys that can have only one value."""
    options = [get_args(f.annotation) for f in model.model_fields.values() if _is_tag(f.annotation)]
    return [values[0] for values in options if len(values) == 1]


def _is_tag(annotation: Any) -> bool:
    return get_origin(annotation) not in (None, Union, tuple) and all(
        isinstance(a, str) for a in get_args(annotation)
    )


def _tags(location: Location, model: type[BaseModel]) -> list[str]:
    return [f"'{tag}'" for m in _walked(location, model)[1] for tag in _literals(m)]


def _keys(models: Iterable[type[BaseModel]]) -> list[str]:
    return [f.alias or name for m in models for name, f in m.model_fields.items()]
