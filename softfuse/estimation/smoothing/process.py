"""How contacts are expected to go on, and what makes a reading an outlier."""

from dataclasses import dataclass
from functools import cache

from scipy.special import chdtri


@dataclass(frozen=True)
class Process:
    """Forces and places walk slowly at random while nothing contradicts that.

    `still_N` [N/√s]: each drive of a contact, which is still when nothing contradicts that over `settled_s`
    [s], nor since it was, over up to `creeping_s` [s]; `still_m`, `moving_m` [m/√s]: x and y, and once they
    move; `white` [-]: part of the variance of a seen place that is new in each frame, the rest stays during a
    touch; `creep` [-]: part of the largest reading of a touch by which a body that was let go is not yet at
    rest; `least` [-]: part of a reading that no frame tells better; `wander` [1/√s]: by what part of a
    reading the model's error walks meanwhile; `alike_m` [m]: contacts so far from each other have errors of
    the model and of seen places that are alike to 1/e; `chance` [-]: of a surprise in a frame by which a
    process is given up; `patience_s` [s]: for so long places that jump are taken for outliers.
    """

    still_N: float = 0.05
    settled_s: float = 0.25
    creeping_s: float = 2.0
    still_m: float = 2e-4
    moving_m: float = 0.01
    white: float = 0.2
    creep: float = 0.01
    least: float = 3e-3
    wander: float = 3e-3
    alike_m: float = 5e-3
    chance: float = 1e-3
    patience_s: float = 0.05

    def surprising(self, surprise: float, numbers: int) -> bool:
        """Whether so many numbers are further off than chance lets them be."""
        return surprise > _largest(self.chance, numbers)


@cache
def _largest(chance: float, numbers: int) -> float:
    """The sum of so many squared standard normal numbers that is exceeded by such a chance."""
    return float(chdtri(numbers, chance))


DEFAULT_PROCESS = Process()
"""Of a hand or a probe on a soft body."""
