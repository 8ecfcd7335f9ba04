"""A board's own clock: it starts anywhere and runs too fast or too slowly.

    device time = start + (1 + d) t

for true time t since power-on and drift d; a sample is taken whenever the device's time has gone on by a
period.
"""

from dataclasses import dataclass

from softfuse.errors import HardwareError

LARGEST_DRIFT_PPM = 50_000.0


@dataclass(frozen=True)
class BoardClock:
    """Samples per second of its own time, at most one a microsecond; its time [µs] at power-on; its drift
    [ppm], positive where it is fast.
    """

    rate_Hz: float
    start_us: int = 0
    drift_ppm: float = 0.0

    def __post_init__(self) -> None:
        if not 1.0 <= self.rate_Hz <= 1e5:
            raise HardwareError(f"{self.rate_Hz:g} samples per second: give a rate from 1 to 100000 Hz")
        if not abs(self.drift_ppm) <= LARGEST_DRIFT_PPM:
            raise HardwareError(
                f"a clock that is off by {self.drift_ppm:g} ppm: give at most {LARGEST_DRIFT_PPM:g}"
            )

    def device_us(self, sample: int) -> int:
        """Its time [µs] at a sample, counted from power-on."""
        return self.start_us + round(sample * 1e6 / self.rate_Hz)

    def true_s(self, sample: int) -> float:
        """True time [s] since power-on at a sample."""
        return sample / (self.rate_Hz * (1.0 + 1e-6 * self.drift_ppm))

    def due(self, true_s: float) -> int:
        """Samples that are due at a true time [s] since power-on, the one at power-on included."""
        if true_s < 0.0:
            return 0
        count = int(true_s * self.rate_Hz * (1.0 + 1e-6 * self.drift_ppm)) + 1
        # Rounding must not let a sample be due before its time, or forget one that is.
        while self.true_s(count - 1) > true_s:
            count -= 1
        while self.true_s(count) <= true_s:
            count += 1
        return count
