"""Names of parts in columns."""

from pathlib import Path

import pytest

from softfuse.robot.file import load
from softfuse.robot.names import named_places, safe_name, safe_names, slot_names

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.mark.parametrize(
    ("name", "safe"),
    [
        ("(-,-)", "minus_minus"),
        ("(+,-)", "plus_minus"),
        ("tip left", "tip_left"),
        ("left-1", "left_1"),
        ("flow (-,+)", "flow_minus_plus"),
        ("p0", "p0"),
        ("°", "unnamed"),
    ],
)
def test_names_are_letters_and_digits(name: str, safe: str) -> None:
    assert safe_name(name) == safe


def test_no_two_names_are_alike() -> None:
    found = safe_names(["a b", "a-b", "a_b", "c"])
    assert found == {"a b": "a_b", "a-b": "a_b_2", "a_b": "a_b_3", "c": "c"}


def test_contacts_are_numbered_where_several_may_touch() -> None:
    one, several = (load(CONFIGS / name) for name in ("pad.toml", "finger.toml"))
    (contact,) = one.contacts
    assert slot_names(one.contacts) == (safe_name(contact.name),)
    (contact,) = several.contacts
    assert contact.at_once == 2
    assert slot_names(several.contacts) == tuple(f"{safe_name(contact.name)}{k}" for k in range(2))
    assert len(named_places(several, contact.name)) == 12 and not named_places(one, one.contacts[0].name)
