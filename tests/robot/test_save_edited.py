"""Edited copies of configurations."""

from collections.abc import Callable
from pathlib import Path

import pytest

from softfuse.errors import ConfigError
from softfuse.robot.file import Edits, load, save_edited

Write = Callable[..., Path]


def test_a_copy_differs_only_where_it_was_edited(write: Write, tmp_path: Path) -> None:
    source, target = write(), tmp_path / "fitted.toml"
    config = save_edited(source, target, {("body", "material", 0, "young"): "0.55 MPa"})
    assert config.body.materials[0].stiffness_keys == ("young",)
    assert load(target) == config
    changed = [
        (a, b)
        for a, b in zip(source.read_text().split("\n"), target.read_text().split("\n"), strict=True)
        if a != b
    ]
    ((before, after),) = changed
    assert before.replace("0.6 MPa", "0.55 MPa") == after


def test_keys_and_tables_are_added_and_taken_away(write: Write, tmp_path: Path) -> None:
    source, target = write(), tmp_path / "fitted.toml"
    edits: Edits = {
        ("body", "material", 0, "young"): None,
        ("body", "material", 0, "law"): "yeoh",
        **{
            ("body", "material", 0, name): f"{value} kPa"
            for name, value in zip(("c1", "c2", "c3"), (90, 9, 0), strict=True)
        },
        ("chamber", 1, "shift"): ["0.1 mm", "0 mm", "-0.2 mm"],
        ("reduction", "cell"): "8 mm",
    }
    config = save_edited(source, target, edits)
    assert config.body.materials[0] == load(target).body.materials[0]
    assert config.body.materials[0].law == "yeoh" and config.body.materials[0].poisson == 0.49
    assert config.chambers[1].shift == (0.1e-3, 0.0, -0.2e-3) and config.reduction.cell == 8e-3
    assert "# " in target.read_text()


def test_files_are_still_found_from_another_folder(tmp_path: Path, pad_text: str) -> None:
    start, end = pad_text.index("[body.source]"), pad_text.index("# One material")
    source = (
        '[body.source]\ntype = "surface"\nfile = "a/body.stl"\nunit = "mm"\nedge_length = "5 mm"\n'
        'inserts = ["plate.stl"]\n'
    )
    for name in ("configs/a/body.stl", "configs/plate.stl", "fits/new/placeholder"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    path = tmp_path / "configs" / "robot.toml"
    path.write_text(pad_text[:start] + source + pad_text[end:], encoding="utf-8")
    target = tmp_path / "fits" / "new" / "robot.toml"
    save_edited(path, target, {("body", "material", 0, "young"): "0.55 MPa"})
    found = load(target).body.source
    assert found.type == "surface"
    assert found.file.resolve() == tmp_path / "configs" / "a" / "body.stl"
    assert [insert.resolve() for insert in found.inserts] == [tmp_path / "configs" / "plate.stl"]


@pytest.mark.parametrize(
    ("place", "value", "told"),
    [
        (("body", "material", 1, "young"), "1 MPa", "body.material[1].young: there is no such key to change"),
        (("body", "material", 0, "yuong"), "1 MPa", "body.material[0].yuong: unknown key"),
        (("body", "element", "x"), "1 MPa", "body.element.x: there is no such key to change"),
        (("body", "material", 0, "young"), "1 N", "is a force, expected a pressure"),
    ],
)
def test_an_impossible_edit_writes_nothing(
    write: Write, tmp_path: Path, place: tuple[str | int, ...], value: str, told: str
) -> None:
    target = tmp_path / "fitted.toml"
    with pytest.raises(ConfigError) as caught:
        save_edited(write(), target, {place: value})
    assert told in str(caught.value)
    assert not target.exists()


def test_a_place_that_cannot_be_written_is_told(write: Write, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be written: No such file or directory"):
        save_edited(write(), tmp_path / "no" / "fitted.toml", {})
