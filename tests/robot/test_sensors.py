"""A grid of mutual capacitances from its settings."""

from pathlib import Path

import numpy as np
import pytest
from softfuse.config import load
from softfuse.config.build_mutual import build_mutual_senses

from softfuse.errors import ConfigError

CONFIG = Path(__file__).parents[2] / "configs" / "pad_mutual.toml"
LINES = (-24e-3, -8e-3, 8e-3, 24e-3)


def written(path: Path, old: str, new: str) -> Path:
    """The example with a piece of its text replaced."""
    text = CONFIG.read_text(encoding="utf-8")
    assert text.count(old) == 1
    path.write_text(text.replace(old, new), encoding="utf-8")
    return path


def test_the_example_follows_two_contacts() -> None:
    senses = build_mutual_senses(load(CONFIG))
    assert senses.contacts == 2 and senses.channels == (4, 16)
    np.testing.assert_allclose(senses.grid.model.column_x_m, LINES)


def test_gains_are_given_row_by_row(tmp_path: Path) -> None:
    gain = [1.0 + 0.01 * k for k in range(16)]
    config = load(written(tmp_path / "pad.toml", "# gain = [...]", f"gain = {gain}"))
    found = build_mutual_senses(config).grid.model.gain
    assert float(found[1, 0]) == gain[1] and float(found[0, 1]) == gain[4]


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("# gain = [...]", "gain = [1.0, 1.1]", "gain: 2 numbers for 16 cells"),
        ("touches = 4 ", "touches = 9 ", "touches: at most 5 are followed"),
        (
            "max_contacts = 2",
            "max_contacts = 5",
            "contact.max_contacts: 5 contacts at once, but the electrodes",
        ),
        ("coupling_off = 0.12", "coupling_off = 0.3", "coupling_off: must not exceed coupling_on = 0.25"),
    ],
)
def test_what_cannot_be_is_told(tmp_path: Path, old: str, new: str, told: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load(written(tmp_path / "pad.toml", old, new))
    assert told in str(caught.value)
