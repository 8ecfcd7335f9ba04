"""What the terminal shows while a session runs: the estimate, the rates, and whatever was lost where."""

import threading

from rich.console import Group
from rich.table import Table
from rich.text import Text

from softfuse.cli.terminal import printable
from softfuse.hardware.live.session import Published, Session, SessionReport, besides_samples, latency
from softfuse.hardware.stream import HostClock, Notice
from softfuse.report.columns import smoothed_words

_NOTICES = 6
_COLOURS = {"info": "cyan", "warning": "yellow", "error": "red"}


class LiveDisplay:
    """Keeps the newest estimate and the last notices, and draws them when asked."""

    def __init__(self, clock: HostClock, slots: tuple[str, ...]):
        """Nothing has come yet; `slots`: what contacts are called."""
        self._slots, self._clock, self._began_s = slots, clock, clock.now_s()
        self._lock = threading.Lock()
        self._newest: Published | None = None
        self._notices: list[Notice] = []
        self._counted = (self._began_s, 0, 0)
        self._rates = (0.0, 0.0)

    def publish(self, now: Published) -> None:
        """Take an estimate; from any thread."""
        with self._lock:
            self._newest = now

    def notify(self, notice: Notice) -> None:
        """Take a notice; from any thread."""
        with self._lock:
            self._notices = [*self._notices, notice][-_NOTICES:]

    def drawn(self, session: Session) -> Group:
        """The picture for the terminal."""
        report = session.report
        with self._lock:
            newest, notices = self._newest, list(self._notices)
        return Group(self._estimate(newest), self._health(report), *(self._line(n) for n in notices))

    def _estimate(self, newest: Published | None) -> Table:
        table = Table.grid(padding=(0, 2))
        if newest is None:
            table.add_row("waiting for the first frame")
            return table
        tracked, smoothed, _ = newest.estimate
        table.add_row("status", "; ".join(str(status) for status in tracked.statuses))
        table.add_row("force", f"{tracked.force_N:.2f} N in {tracked.contacts} contacts")
        for c, slot in enumerate(self._slots):
            if tracked.touching[c]:
                x, y, z = 1e3 * tracked.location_m[c]
                table.add_row(slot, f"{tracked.contact_force_N[c]:.2f} N at ({x:.1f}, {y:.1f}, {z:.1f}) mm")
                if smoothed is not None:
                    table.add_row("    filtered", smoothed_words(smoothed, c))
        return table

    def _health(self, report: SessionReport) -> Table:
        now = self._clock.now_s()
        since, frames, estimates = self._counted
        if now - since >= 1.0:
            self._rates = (
                (report.frames - frames) / (now - since),
                (report.estimated - estimates) / (now - since),
            )
            self._counted = now, report.frames, report.estimated
        table = Table.grid(padding=(0, 2))
        table.add_row("frames", f"{report.frames}, {self._rates[0]:.0f} a second")
        table.add_row("estimates", f"{report.estimated}, {self._rates[1]:.0f} a second")
        table.add_row("latency", latency(report))
        table.add_row("overruns", f"{report.overruns}, {report.waiting} waiting")
        for device in report.devices:
            lost, clock = device.samples, device.clock
            table.add_row(
                f"device {device.device} of source {device.source}",
                f"{lost.fresh} samples, {lost.lost} lost, {lost.duplicated} twice, {lost.late} late, "
                f"{lost.restarted} restarts, clock {clock.drift_ppm:+.0f} ppm, "
                f"jitter {1e3 * clock.jitter_s:.1f} ms",
            )
        for source, found in enumerate(besides_samples(report)):
            if found:
                table.add_row(f"source {source}", found, style="yellow")
        if report.recorder_lost:
            table.add_row("not recorded", f"{report.recorder_lost} entries", style="red")
        if report.missing:
            table.add_row("missing", printable(", ".join(report.missing)), style="yellow")
        return table

    @staticmethod
    def _line(notice: Notice) -> Text:
        where = "" if notice.source is None else f"source {notice.source}: "
        return Text(printable(where + notice.text), style=_COLOURS[notice.level])
