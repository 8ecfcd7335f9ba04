"""What the parts of a robot are called in columns of files, in topics and series: names of letters and
digits.

Columns end with the unit: `<name>_mm`, `<name>_N`. Truth columns begin with `true_`.
"""

import re
from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Float

from softfuse.robot.contacts import ContactSettings
from softfuse.robot.settings import RobotSettings

_SIGNS = {"+": " plus ", "-": " minus "}
"""Signs that stand alone: between letters they are hyphens."""


def safe_name(name: str) -> str:
    """The letters and digits of a name, with underscores between them: "minus_plus" of "(-,+)"."""
    spelt = re.sub(r"(?<!\w)[+-]|[+-](?!\w)", lambda sign: _SIGNS[sign[0]], name)
    return re.sub(r"\W+|_+", "_", spelt).strip("_") or "unnamed"


def safe_names(names: Iterable[str]) -> dict[str, str]:
    """The safe names of some, by these, no two alike."""
    found: dict[str, str] = {}
    for name in names:
        safe, k = safe_name(name), 2
        while safe in found.values():
            safe, k = f"{safe_name(name)}_{k}", k + 1
        found[name] = safe
    return found


def numbered(name: str, count: int) -> tuple[str, ...]:
    """What each of so many of one name is called: `<name>`, or `<name><number>` where they are several."""
    return (name,) if count == 1 else tuple(f"{name}{k}" for k in range(count))


def slot_names(contacts: Sequence[ContactSettings]) -> tuple[str, ...]:
    """What each contact that may touch at once is called, see `numbered`."""
    safe = safe_names(contact.name for contact in contacts)
    return tuple(each for contact in contacts for each in numbered(safe[contact.name], contact.at_once))


def named_places(settings: RobotSettings, contact: str) -> dict[str, Float[np.ndarray, "3 3"]]:
    """The places (3, 3) with names, such as electrodes, where a contact is seen; none where it may be
    anywhere.
    """
    places = [seen for sensor in settings.sensors for seen in sensor.places]
    return {seen.name: seen.place for seen in places if seen.contact == contact}
