"""Whether something touches that no sensor sees, as readings tell that nothing else explains.

A touch begins when a press somewhere on the surface explains the readings better than none by more than
`on_chi2`, in `on_frames` frames in a row, and leaves less than `left` of what nothing had explained: what no
press explains is the model's error, not a touch. It ends when its force has been within `off_sigma` standard
deviations of 0 for `off_frames` frames.
"""

from dataclasses import dataclass

from softfuse.estimation.reading_pattern import PatternFit


@dataclass(frozen=True)
class TouchSettings:
    """When a touch begins and ends."""

    on_chi2: float = 36.0
    on_frames: int = 3
    left: float = 0.5
    off_sigma: float = 2.0
    off_frames: int = 5


class TouchByReadings:
    """Follows one contact that readings alone tell of."""

    def __init__(self, settings: TouchSettings = TouchSettings()):
        """Nothing touches."""
        self._settings = settings
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self.touching, self._frames = False, 0

    def begins(self, fit: PatternFit) -> bool:
        """Whether it touches after a frame in which nothing did, with what presses all over would explain."""
        left = fit.missing[fit.best]
        told = (
            fit.unexplained - left > self._settings.on_chi2 and left < self._settings.left * fit.unexplained
        )
        return self._counted(told, self._settings.on_frames)

    def ends(self, force_N: float, sigma_N: float) -> bool:
        """Whether it has gone after a frame in which it pressed with such a force, so surely known."""
        gone = not force_N > self._settings.off_sigma * sigma_N
        return not self._counted(gone, self._settings.off_frames)

    def _counted(self, changes: bool, frames: int) -> bool:
        self._frames = self._frames + 1 if changes else 0
        if self._frames >= frames:
            self.touching, self._frames = not self.touching, 0
        return self.touching
