"""The data flow of the design as import arrows, and the house rules that can be read off the source.

    io < mesh < material < body < functional < mechanics < rom < sensors < robot < estimation
       < calibration, design, experiment < report

A stage imports from the left only; hardware from estimation and its left; report also from hardware; cli from
everything; everything may import the errors.
"""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "softfuse"
FILES = sorted(PACKAGE.rglob("*.py"))

LINE = (
    *("io", "mesh", "material", "body", "functional", "mechanics", "rom", "sensors", "robot"),
    "estimation",
)
ENDS = ("calibration", "design", "experiment")
ALLOWED: dict[str, set[str]] = {
    **{stage: set(LINE[:k]) for k, stage in enumerate(LINE)},
    **{stage: set(LINE) for stage in ENDS},
    "hardware": set(LINE),
    "report": {*LINE, *ENDS, "hardware"},
    "cli": {*LINE, *ENDS, "hardware", "report", "computing"},
    "__main__": {"cli"},
    "errors": set(),
    "computing": set(),
    "": set(),
}
"""What each folder of softfuse may import besides itself and the errors; "" is softfuse/__init__.py."""

HEAVY = {
    *("trimesh", "pytetwild", "meshio", "matplotlib", "serial", "rerun", "manifold3d", "pint", "h5py"),
    *("mcap", "pyarrow", "distributed", "dask", "cryptography", "cascadio"),
}
"""Libraries that are imported inside the functions that need them."""

PAPERS = ("mesh/", "experiment/paper/")
"""Where pads and fingers are generated, and compared with the paper's."""
HUMAN = {"finger_radius", "finger_radius_m"}
FILLS = {"np.pad", "jnp.pad", "pad=0.12"}
PARTS = ("mesh", "material", "body", "functional", "mechanics", "rom", "sensors", "robot")
FEWEST_KINDS = 5

LONGEST_FILE = 400
LONGEST_COMMAND = 99
NUMERICS = {"numpy", "scipy", "jax", "jaxlib", "jaxtyping", "equinox"}
"""What computes, which is not for commands."""
TOP_LEVEL = {
    "softfuse",
    "tests",
    "benchmarks",
    "configs",
    "scripts",
    "README.md",
    "pyproject.toml",
    "LICENSE",
}
TOP_LEVEL_HIDDEN = {".gitignore", ".ci"}


def stage_of(path: Path) -> str:
    """The folder or module of softfuse that a file belongs to."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return "" if parts == ("__init__",) else parts[0]


def imported(tree: ast.AST, path: Path) -> Iterator[tuple[int, str]]:
    """Line and full name of everything that a file imports, at whatever depth."""
    package = ("softfuse", *path.relative_to(PACKAGE).parent.parts)
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            name = ".".join((*base, *((node.module,) if node.module else ())))
            # `from softfuse import mesh` names a stage only after the import.
            yield from ((node.lineno, f"{name}.{alias.name}") for alias in node.names)


def wrong_arrows(source: str, path: Path) -> list[str]:
    """Imports against the data flow."""
    here = stage_of(path)
    wrong = []
    for line, name in imported(ast.parse(source), path):
        parts = name.split(".")
        if parts[0] != "softfuse":
            continue
        there = parts[1] if len(parts) > 1 else ""
        if there not in {here, "errors", *ALLOWED.get(here, set())}:
            wrong.append(f"{path.relative_to(ROOT)}:{line}: {here or 'softfuse'} must not import {name}")
    return wrong


def outside_functions(node: ast.AST) -> Iterator[ast.AST]:
    """The nodes that run when the module is imported."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            continue
        # Only type checkers go in here.
        if isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING":
            continue
        yield child
        yield from outside_functions(child)


def heavy_imports(source: str, path: Path) -> list[str]:
    """Heavy libraries imported with the module."""
    module = ast.Module([n for n in outside_functions(ast.parse(source)) if isinstance(n, ast.stmt)], [])
    own = [n for n in module.body if isinstance(n, ast.Import | ast.ImportFrom)]
    names = imported(ast.Module(list(own), []), path)
    return [
        f"{path.relative_to(ROOT)}:{line}: import {name} inside the function that needs it"
        for line, name in names
        if name.split(".")[0] in HEAVY
    ]


def forbidden_calls(source: str, path: Path) -> list[str]:
    """Prints, and JAX flags that are set anywhere but in one place."""
    wrong = []
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call):
            continue
        name = ast.unparse(node.func)
        if name == "print" or (name.endswith("config.update") and stage_of(path) != "computing"):
            wrong.append(
                f"{path.relative_to(ROOT)}:{node.lineno}: {name}(...) does not belong in the library"
            )
    return wrong


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_a_file_keeps_the_rules(path: Path) -> None:
    source = path.read_text(encoding="utf-8")
    assert stage_of(path) in ALLOWED, f"{path} belongs to no stage of the design"
    assert not wrong_arrows(source, path)
    assert not heavy_imports(source, path)
    assert not forbidden_calls(source, path)


@pytest.mark.parametrize(
    "path",
    [
        path
        for folder in ("softfuse", "tests", "benchmarks")
        for path in sorted((ROOT / folder).rglob("*.py"))
    ],
    ids=lambda path: str(path.relative_to(ROOT)),
)
def test_a_file_is_short(path: Path) -> None:
    assert path.read_text(encoding="utf-8").count("\n") <= LONGEST_FILE


def numeric_imports(source: str, path: Path) -> list[str]:
    """What computes, imported at whatever depth."""
    return [
        f"{path.relative_to(ROOT)}:{line}: {name} is for the library, which the command calls"
        for line, name in imported(ast.parse(source), path)
        if name.split(".")[0] in NUMERICS
    ]


@pytest.mark.parametrize(
    "path", [path for path in FILES if stage_of(path) == "cli"], ids=lambda path: path.name
)
def test_a_command_is_short_and_computes_nothing(path: Path) -> None:
    source = path.read_text(encoding="utf-8")
    assert source.count("\n") <= LONGEST_COMMAND
    assert not numeric_imports(source, path)


@pytest.mark.parametrize(
    ("source", "wrong"),
    [
        ("import numpy as np", True),
        ("def f():\n    import jax.numpy as jnp", True),
        ("if TYPE_CHECKING:\n    from jaxtyping import Float", True),
        ("from softfuse.robot.file import load\nimport json", False),
    ],
)
def test_numeric_imports_are_seen(source: str, wrong: bool) -> None:
    assert bool(numeric_imports(source, PACKAGE / "cli" / "file.py")) == wrong


@pytest.mark.parametrize(
    ("stage", "source", "wrong"),
    [
        ("mesh", "from softfuse.body import Body", True),
        ("mesh", "from softfuse.errors import MeshError", False),
        ("mesh", "from softfuse.mesh.tetmesh import TetMesh", False),
        ("body", "import softfuse.mesh.tetmesh", False),
        ("body", "def f():\n    import softfuse.estimation", True),
        ("body", "from softfuse import estimation", True),
        ("body", "from .. import sensors", True),
        ("body", "from ..mesh import tetmesh", False),
        ("body", "from . import element", False),
        ("body", "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from ..cli import main", True),
        ("estimation", "from softfuse.robot.file import load", False),
        ("calibration", "from softfuse.design import layout", True),
        ("sensors", "from softfuse.hardware import recording", True),
        ("hardware", "from softfuse.estimation import step", False),
        ("hardware", "from softfuse.robot.file import load", False),
        ("robot", "from softfuse.estimation import tracker", True),
        ("cli", "from softfuse.hardware import recording", False),
        ("body", "import softfuse", True),
    ],
)
def test_arrows_are_told_apart(stage: str, source: str, wrong: bool) -> None:
    assert bool(wrong_arrows(source, PACKAGE / stage / "file.py")) == wrong


@pytest.mark.parametrize(
    ("source", "wrong"),
    [
        ("import meshio", True),
        ("from matplotlib import pyplot", True),
        ("try:\n    import serial.tools\nexcept ImportError:\n    serial = None", True),
        ("class A:\n    import trimesh", True),
        ("if TYPE_CHECKING:\n    from matplotlib.figure import Figure", False),
        ("def f():\n    import trimesh", False),
        ("import numpy", False),
    ],
)
def test_heavy_imports_are_seen(source: str, wrong: bool) -> None:
    assert bool(heavy_imports(source, PACKAGE / "mesh" / "file.py")) == wrong


@pytest.mark.parametrize(
    ("stage", "source", "wrong"),
    [
        ("mesh", "def f():\n    print(1)", True),
        ("cli", "print(1)", True),
        ("mesh", "console.print(1)", False),
        ("body", "import jax\njax.config.update('jax_enable_x64', True)", True),
        ("body", "from jax import config\nconfig.update('jax_enable_x64', True)", True),
        ("computing", "import jax\njax.config.update('jax_enable_x64', True)", False),
    ],
)
def test_forbidden_calls_are_seen(stage: str, source: str, wrong: bool) -> None:
    assert bool(forbidden_calls(source, PACKAGE / stage / "file.py")) == wrong


def robots_by_name(source: str, path: Path) -> list[str]:
    """Identifiers and whole texts that name a pad or a finger, where the paper's robots are neither made nor
    compared; a human finger, which touches, and what fills arrays and figures up are none.
    """
    wrong = []
    for node in ast.walk(ast.parse(source)):
        texts = [
            value
            for each in ("id", "attr", "arg", "name", "asname", "value")
            if isinstance(value := getattr(node, each, None), str)
        ]
        if isinstance(node, ast.ImportFrom):
            texts.append(node.module or "")
        parent = ast.unparse(node)
        for text in texts:
            words = set(re.findall(r"[a-z]+", re.sub(r"(?<!^)(?=[A-Z])", "_", text).lower()))
            named = len(words) < 4 and words & {"pad", "pads", "finger", "fingers"}
            if named and text not in HUMAN and parent not in FILLS and not text.endswith((".toml", ".toml.")):
                wrong.append(f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 0)}: {text}")
    return wrong


@pytest.mark.parametrize(
    "path",
    [each for each in FILES if not each.relative_to(PACKAGE).as_posix().startswith(PAPERS)],
    ids=lambda path: str(path.relative_to(PACKAGE)),
)
def test_no_robot_is_called_by_name(path: Path) -> None:
    assert not robots_by_name(path.read_text(encoding="utf-8"), path)


@pytest.mark.parametrize(
    ("source", "wrong"),
    [
        ("class PadSource:\n    pass", True),
        ("def finger_bed():\n    pass", True),
        ("from softfuse.mesh.pad import pad_mesh", True),
        ('kind = "finger"', True),
        ("f(pad=1)", True),
        ("jnp.pad(x, 1)", False),
        ("shape.finger_radius", False),
        ("padded = expand(pads_not)", True),
    ],
)
def test_robots_by_name_are_seen(source: str, wrong: bool) -> None:
    assert bool(robots_by_name(source, PACKAGE / "robot" / "file.py")) == wrong


def kinds_asked(source: str, kinds: set[str]) -> int:
    """How often a file asks of which of some kinds something is."""
    asked = 0
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "isinstance":
            asked += any(isinstance(each, ast.Name) and each.id in kinds for each in ast.walk(node.args[1]))
        elif isinstance(node, ast.MatchClass):
            asked += ast.unparse(node.cls) in kinds
    return asked


def test_parts_and_settings_are_hardly_asked_of_which_kind_they_are() -> None:
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in FILES}
    parts = [tree for path, tree in trees.items() if stage_of(path) in PARTS]
    kinds = {node.name for tree in parts for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}
    assert sum(kinds_asked(ast.unparse(tree), kinds) for tree in trees.values()) < FEWEST_KINDS
    assert kinds_asked("isinstance(load, PulledCable | int)", {"PulledCable"}) == 1
    assert kinds_asked("isinstance(value, int)", {"PulledCable"}) == 0
    assert kinds_asked("match load:\n    case PulledCable():\n        pass", {"PulledCable"}) == 1


def test_the_top_level_is_that_of_the_design() -> None:
    listing = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True)
    if listing.returncode == 0:
        names = {line.split("/")[0] for line in listing.stdout.splitlines()}
        assert names <= TOP_LEVEL | TOP_LEVEL_HIDDEN


def test_imports_are_silent_and_light() -> None:
    modules = sorted({f"softfuse.{stage_of(path)}" for path in FILES if stage_of(path)} | {"softfuse"})
    code = f"""
import importlib, sys
for name in {modules}:
    importlib.import_module(name)
heavy = sorted({HEAVY} & set(sys.modules))
assert not heavy, heavy
import jax
assert not jax.config.jax_enable_x64
"""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], cwd=ROOT, capture_output=True, text=True
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
