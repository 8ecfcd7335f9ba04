"""The host's time of what a device stamped with its own, by offset and drift.

    y = a + b x + delay,  delay >= 0

with x the device's time and y the host's time of arrival minus x, both since the first sample.

Delays only add (buffers, USB frames, a busy host), so the line is the one below all arrivals of the last
`WINDOW_S` that is nearest to them: minimise sum(y - a - b x) with a + b x <= y, whose solution is the edge
of the lower convex hull over the mean of x; a linear program after Moon, Skelly
and Towsley (Proc. IEEE INFOCOM 1999). Each `BUCKET_S` gives it the sample of least delay. The least delay
itself cannot be told from the offset.

The times handed out never go back, and come to the line gently, within some `FOLLOW_S`, so that the spacing
of samples stays that of the device. A device whose clock stood still (asleep) or jumped is followed: only
what came since then counts.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

WINDOW_S = 60.0
BUCKET_S = 0.25
DRIFT_SPAN_S = 2.0
"""Span of the arrivals from which a drift is estimated; until then it stays what it was, at first 0."""
LARGEST_DRIFT = 0.01
"""A ceramic resonator is off by up to 0.005."""
FOLLOW_S = 0.2
FASTEST_FOLLOW = 0.5
"""Seconds of correction per second at most."""
JUMP_S = 0.2
"""An arrival so much before the line says that the device's clock has jumped ahead; when for `PATIENCE_S` of
the host's time all were later than the line by more than that, it has stood still."""
PATIENCE_S = 5.0
JITTER_SAMPLES = 512

Point = tuple[float, float]
"""x and y as above [s]."""


@dataclass(frozen=True)
class ClockReport:
    """What is known of a device's clock."""

    offset_s: float
    """Host's minus device's time, now [s]; includes the least delay."""
    drift_ppm: float
    """Positive where the device's clock is slow [µs/s]."""
    jitter_s: float
    """95 % of the last arrivals were late by less [s]; 0 before the first."""
    jumps: int
    """How often the device's clock stood still or jumped ahead."""
    restarts: int
    """How often it began anew."""


class DeviceClock:
    """The clock of one device."""

    def __init__(self) -> None:
        self._last_out = -np.inf
        self._jumps = 0
        self._restarts = -1
        self.restart()

    def restart(self) -> None:
        """Forget the device's clock, which has restarted; times still never go back."""
        self._restarts += 1
        self._first_us: int | None = None
        self._first_s = 0.0
        self._intercept = 0.0
        self._slope = 0.0
        self._x = 0.0
        self._points: deque[Point] = deque()
        # The last points, as long as all of them are late.
        self._late: list[Point] = []
        self._least: Point | None = None
        self._bucket_end = BUCKET_S
        self._delays: deque[float] = deque(maxlen=JITTER_SAMPLES)

    def stamp(self, time_us: int, host_s: float) -> float:
        """The host's time [s] at which a sample was taken, which arrived at host_s [s].

        time_us is the device's time [µs]; samples come in the order of their times, and one that is before
        the last restarts the clock. The result is not before any result so far, and after it where time_us
        is.
        """
        if self._first_us is not None and (time_us - self._first_us) * 1e-6 < self._x:
            self.restart()
        if self._first_us is None:
            self._first_us, self._first_s = time_us, host_s
            self._observe(0.0, 0.0)
            self._last_out = max(host_s, float(np.nextafter(self._last_out, np.inf)))
            return self._last_out
        x = (time_us - self._first_us) * 1e-6
        step, self._x = x - self._x, x
        jumped = self._observe(x, host_s - self._first_s - x)
        self._last_out = self._follow(step, jumped)
        return self._last_out

    @property
    def report(self) -> ClockReport:
        """Offset, drift and jitter so far."""
        return ClockReport(
            offset_s=self._first_s - (self._first_us or 0) * 1e-6 + self._intercept + self._slope * self._x,
            drift_ppm=self._slope * 1e6,
            jitter_s=float(np.percentile(self._delays, 95)) if self._delays else 0.0,
            jumps=self._jumps,
            restarts=self._restarts,
        )

    def _follow(self, step: float, jumped: bool) -> float:
        """The next time to hand out, `step` of the device's time after the last."""
        line = self._first_s + self._x + self._intercept + self._slope * self._x
        if step == 0.0:
            return self._last_out
        earliest = float(np.nextafter(self._last_out, np.inf))
        if jumped:
            return max(line, earliest)
        straight = self._last_out + step * (1.0 + self._slope)
        error = line - straight
        if error > JUMP_S:
            return line
        most = FASTEST_FOLLOW * step
        return max(straight + min(max(error * min(step / FOLLOW_S, 1.0), -most), most), earliest)

    def _observe(self, x: float, y: float) -> bool:
        """Take an arrival into account; whether the device's clock has jumped ahead."""
        delay = y - self._intercept - self._slope * x
        jumped = delay < -JUMP_S
        if jumped:
            self._jumps += 1
            self._points.clear()
            self._late.clear()
            self._least = None
            self._delays.clear()
        if delay < 0.0:
            self._intercept += delay
        self._delays.append(max(delay, 0.0))
        if x >= self._bucket_end:
            self._close_bucket(x)
        least = self._least
        if least is None or y - self._slope * x < least[1] - self._slope * least[0]:
            self._least = x, y
        return jumped

    def _close_bucket(self, x: float) -> None:
        self._bucket_end = x + BUCKET_S
        if self._least is None:
            return
        least_x, least_y = self._least
        self._points.append(self._least)
        if least_y - self._intercept - self._slope * least_x > JUMP_S:
            self._late.append(self._least)
        else:
            self._late.clear()
        self._least = None
        while self._points and self._points[0][0] < x - WINDOW_S:
            self._points.popleft()
        # By the host's time, since after a stall of the host a backlog comes late, but all at once.
        if self._late and least_x + least_y - sum(self._late[0]) > PATIENCE_S:
            self._jumps += 1
            self._points = deque(self._late)
            self._late = []
        if self._points:
            self._intercept, self._slope = _line_below(list(self._points), self._slope)


def _line_below(points: list[Point], slope: float) -> tuple[float, float]:
    """Intercept and slope of the nearest line below points of increasing x; of this slope if they are few."""
    if points[-1][0] - points[0][0] >= DRIFT_SPAN_S:
        (x0, y0), (x1, y1) = edge_below(points)
        slope = min(max((y1 - y0) / (x1 - x0), -LARGEST_DRIFT), LARGEST_DRIFT)
    return min(y - slope * x for x, y in points), slope


def edge_below(points: Sequence[Point]) -> tuple[Point, Point]:
    """The two, of two points or more of increasing x, through which the nearest line below them all goes."""
    hull: list[Point] = []
    for point in points:
        while len(hull) > 1 and _turns_right(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    mean = sum(x for x, _ in points) / len(points)
    return next(edge for edge in zip(hull, hull[1:], strict=False) if edge[1][0] >= mean)


def _turns_right(a: Point, b: Point, c: Point) -> bool:
    """Whether b is on or above the straight from a to c."""
    return (b[0] - a[0]) * (c[1] - a[1]) <= (b[1] - a[1]) * (c[0] - a[0])
