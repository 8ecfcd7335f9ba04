"""Every key of every configuration file is read by the package: one that does nothing must not exist."""

import ast
import importlib
import pkgutil
from collections.abc import Iterator
from pathlib import Path

import pytest

import softfuse
from softfuse.body.stiffness_field import TERMS
from softfuse.io.settings import Settings

PACKAGE = Path(softfuse.__file__).parent
CHECKS = {"model_validator", "field_validator", "model_serializer"}
SPENT = {"type", "driver", "measure", "output"}
"""Keys that are used up when a table is read: they choose its class, or stand for other keys."""


def all_settings() -> list[type[Settings]]:
    """Every table that a configuration, plan or layout may have, found by importing the whole package."""
    for module in pkgutil.walk_packages(softfuse.__path__, "softfuse."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)

    def below(kind: type[Settings]) -> Iterator[type[Settings]]:
        for each in kind.__subclasses__():
            yield each
            yield from below(each)

    return sorted(
        {each for each in below(Settings) if each.__module__.startswith("softfuse.")},
        key=lambda each: (each.__module__, each.__qualname__),
    )


def _checks(node: ast.AST) -> bool:
    if not isinstance(node, ast.FunctionDef):
        return False
    names = {part.id for each in node.decorator_list for part in ast.walk(each) if isinstance(part, ast.Name)}
    return bool(names & CHECKS)


def read_names(tree: ast.AST) -> set[str]:
    """Attributes that a file reads, and names that it gives as text, but not those only checked."""
    names: set[str] = set()
    left = [tree]
    while left:
        node = left.pop()
        if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load):
            names.add(node.attr)
        elif isinstance(node, ast.ClassDef):
            # Lists of keys, as `edges` of a body's source.
            names |= {
                part.value
                for line in node.body
                if isinstance(line, ast.AnnAssign) and "ClassVar" in ast.unparse(line.annotation)
                for part in ast.walk(line)
                if isinstance(part, ast.Constant) and isinstance(part.value, str)
            }
        elif isinstance(node, ast.MatchClass):
            names |= set(node.kwd_attrs)
        left += [each for each in ast.iter_child_nodes(node) if not _checks(each)]
    return names


def filled(trees: list[ast.Module]) -> dict[str, str]:
    """Keys that `sensors.parameters` reads for a parameter, which has the key's name and perhaps its unit."""
    nodes = [node for tree in trees for node in ast.walk(tree)]
    kinds = {
        node.args[0].id
        for node in nodes
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id == "parameters"
        and isinstance(node.args[0], ast.Name)
    }
    keys = {}
    for node in nodes:
        if isinstance(node, ast.ClassDef) and node.name in kinds:
            for line in node.body:
                if isinstance(line, ast.AnnAssign) and isinstance(line.target, ast.Name):
                    key = line.target.id
                    while key:
                        keys[key] = line.target.id
                        key = key.rpartition("_")[0]
    return keys


@pytest.fixture(scope="module")
def read() -> set[str]:
    trees = [ast.parse(path.read_text()) for path in PACKAGE.rglob("*.py")]
    names = set().union(*map(read_names, trees))
    return names | {key for key, parameter in filled(trees).items() if parameter in names}


def test_every_key_is_read(read: set[str]) -> None:
    kinds = all_settings()
    assert len(kinds) > 80
    unread = {
        f"{kind.__module__}.{kind.__qualname__}.{key}"
        for kind in kinds
        for key in set(kind.model_fields) - SPENT - read - set(TERMS)
    }
    assert not unread, f"nobody reads {sorted(unread)}"


def test_a_key_that_is_only_checked_is_not_read() -> None:
    source = """
class One(Settings):
    rate: float
    size: float

    @model_validator(mode="after")
    def _check(self):
        assert self.rate > 0
        return self

    def made(self):
        return self.size
"""
    assert read_names(ast.parse(source)) & {"rate", "size"} == {"size"}
