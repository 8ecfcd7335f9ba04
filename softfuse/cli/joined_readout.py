"""What people read of joined frames, of each contact: force and place, and how sure they are, in N and mm."""

import numpy as np

from softfuse.cli.readout import Column
from softfuse.fusion.fusion import Fused

_OF_CONTACT = (
    *(("force_N", 4), ("force_sigma_N", 4)),
    *(("x_mm", 3), ("y_mm", 3), ("x_sigma_mm", 3), ("y_sigma_mm", 3)),
)


def joined_columns(contacts: int, prefix: str = "") -> list[Column]:
    """The columns of joined frames with so many contacts at once."""
    labels = [f"contact{c}_" for c in range(contacts)] if contacts > 1 else [""]
    return [Column(prefix + label + what, digits) for label in labels for what, digits in _OF_CONTACT]


def joined_values(fused: Fused) -> list[float]:
    """The values of these columns, NaN where unknown."""
    force = np.stack([fused.contact_force_N, fused.contact_sigma_N], axis=1)
    places = 1e3 * np.concatenate([fused.location_m, fused.location_sigma_m], axis=1)
    return np.concatenate([force, places], axis=1).ravel().tolist()


def joined_words(fused: Fused, contact: int) -> str:
    """A contact's force and place with their standard deviations, for people to look at."""
    told = f"{fused.contact_force_N[contact]:.2f} ± {fused.contact_sigma_N[contact]:.2f} N"
    (x, y), (x_sigma, y_sigma) = 1e3 * fused.location_m[contact], 1e3 * fused.location_sigma_m[contact]
    if not np.isfinite([x, y]).all():
        return told
    return f"{told} at ({x:.1f} ± {x_sigma:.1f}, {y:.1f} ± {y_sigma:.1f}) mm"
