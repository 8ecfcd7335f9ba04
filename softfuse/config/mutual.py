"""A grid of mutual capacitances, and the columns of a recording in which its cells write."""

from typing import Literal

from softfuse.sensors.mutual import settings as mutual


class MutualSettings(mutual.MutualSettings):
    """A grid of 4 × 4 mutual capacitances where rows cross columns."""

    type: Literal["mutual-4x4"]  # pyright: ignore
    name: str = "electrode"
    contact: str = "contact"
