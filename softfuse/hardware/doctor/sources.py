"""What is found out about ports: which there are, which answer, as what, how fast and how faultless."""

import math
import threading
import time
from collections.abc import Callable, Sequence

from softfuse.errors import HardwareError
from softfuse.hardware.doctor.findings import Finding
from softfuse.hardware.source.configured import connection_of, driver_of
from softfuse.hardware.source.connection import SILENCE
from softfuse.hardware.source.listening import Heard, Listener
from softfuse.hardware.source.port import SerialPort
from softfuse.hardware.stream import Chunk, HostClock, Notice
from softfuse.robot.source import AnySource

START_S = 4.0
"""How long a device may take to say something; boards that the opening resets take two seconds."""
_LATE_S = 0.012
"""A jitter above this is told; serial adapters that gather bytes for 16 ms have it."""
_TICK_S = 0.01
_DRIFT_PPM = 5000.0
"""No clock is off by more; a ceramic resonator may be by so much."""


def check_ports(ports: Sequence[SerialPort]) -> list[Finding]:
    """The serial ports, none of them opened."""
    if not ports:
        return [
            Finding("ports", "note", "there is no serial port", "plug a device in if there should be one")
        ]
    group = "add yourself to the group that owns it (sudo usermod -aG dialout $USER under most Linuxes)"
    findings = []
    for port in ports:
        said = port.description or "a serial port"
        if port.allowed:
            told = f"{said}; not opened, --port {port.name} listens to it"
            findings.append(Finding(port.name, "ok", told))
        else:
            findings.append(Finding(port.name, "note", f"{said}; this user may not open it", group))
    return findings


class _Ear:
    """Listens to one source by its connection's thread."""

    def __init__(self, number: int, source: AnySource, clock: HostClock) -> None:
        self.source = source
        driver = driver_of(source)
        self._listener = Listener(driver)
        self._lock = threading.Lock()
        self.told: list[Notice] = []
        self._connection = connection_of(number, source, driver, self._hear, self.told.append, clock)
        self.failure: str | None = None

    def open(self) -> None:
        try:
            self._connection.open()
        except HardwareError as error:
            self.failure = str(error)

    def done(self, began_s: float, now_s: float, seconds: float) -> bool:
        """Whether it has been listened to for long enough, at now_s [s since the epoch]."""
        first, last = self._listener.first_s, self._listener.last_s
        if self.failure is not None:
            return True
        if first is None or last is None:
            return now_s - began_s > START_S
        # By what was heard: a busy computer may have let the listening thread wait.
        return last - first >= seconds or now_s - last > START_S

    def close(self) -> Listener:
        self._connection.stop()
        return self._listener

    def _hear(self, chunk: Chunk) -> None:
        with self._lock:
            answer = self._listener.feed(chunk)
        if answer:
            self._connection.send(answer)


def check_sources(sources: Sequence[AnySource], wanted: Sequence[str], seconds: float) -> list[Finding]:
    """Listen to all sources at once for so long [s]: what each says, and whether all wanted channels come."""
    clock = HostClock()
    ears = [_Ear(k, source, clock) for k, source in enumerate(sources)]
    began = clock.now_s()
    try:
        for ear in ears:
            ear.open()
        stall = _wait(lambda: all(ear.done(began, clock.now_s(), seconds) for ear in ears), clock)
    finally:
        listeners = [ear.close() for ear in ears]
    findings: list[Finding] = []
    given: set[str] = set()
    for ear, listener in zip(ears, listeners, strict=True):
        if ear.failure is not None:
            findings.append(_failed(ear.source, ear.failure))
            continue
        findings += _heard(ear.source, listener, stall)
        findings += [
            Finding(ear.source.url, "note", notice.text.removeprefix(f"{ear.source.url}: "))
            for notice in ear.told
            # That nothing has come at all is told by then.
            if notice.level != "info" and (listener.bytes or not notice.text.endswith(SILENCE))
        ]
        given |= {name for heard in listener.heard for name in heard.channels}
    return findings + _wanted(wanted, given)


def _wait(done: Callable[[], bool], clock: HostClock) -> float:
    """Wait until it is done: by how much [s] this computer was late at worst to go on after a sleep."""
    worst, before = 0.0, clock.now_s()
    while not done():
        time.sleep(_TICK_S)
        now = clock.now_s()
        worst, before = max(worst, now - before - _TICK_S), now
    return worst


def _failed(source: AnySource, failure: str) -> Finding:
    said, _, remedy = failure.removeprefix(f"{source.url}: ").partition(": ")
    return Finding(source.url, "problem", said, remedy)


def _heard(source: AnySource, listener: Listener, stall: float) -> list[Finding]:
    url = source.url
    if not listener.bytes:
        nothing = f"nothing has come for {START_S:g} s"
        remedy = "is the device on, its cable in, and nobody else listening?"
        return [Finding(url, "problem", nothing, remedy)]
    faults = ", ".join(f"{number} {what}" for what, number in listener.faults.items())
    if not listener.heard:
        told = f"{listener.bytes} bytes and no sample of the driver {source.driver!r}"
        remedy = "check the driver, the baud rate and the columns: something else speaks there"
        return [Finding(url, "problem", told + (f" ({faults})" if faults else ""), remedy)]
    findings = [_device(source, heard) for heard in listener.heard]
    findings += [problem for heard in listener.heard for problem in _problems(source, heard, stall)]
    if faults:
        told = f"the line is not clean: {faults}"
        remedy = "use a shorter cable or another port, and check the baud rate and the ground"
        findings.append(Finding(url, "problem", told, remedy, {"faults": listener.faults}))
    return findings + [Finding(url, "ok", remark) for remark in listener.remarks]


def _device(source: AnySource, heard: Heard) -> Finding:
    parts = [
        f"device {heard.device} ({source.driver})",
        f"{heard.samples} samples",
        f"{_number(heard.rate_Hz, '.1f')} Hz",
        f"jitter {_number(1e3 * heard.jitter_s, '.1f')} ms",
    ]
    drift, error = heard.drift_ppm or (math.nan, math.nan)
    if math.isfinite(drift):
        parts.append(f"clock {drift:+.0f} ± {error:.0f} ppm")
    if heard.counts is not None:
        parts.append(f"{heard.counts.lost} lost")
    parts.append(f"{len(heard.channels)} channels: {', '.join(heard.channels)}")
    counts = heard.counts
    measured: dict[str, object] = {
        "device": heard.device,
        "driver": source.driver,
        "channels": list(heard.channels),
        "samples": heard.samples,
        "rate_Hz": _plain(heard.rate_Hz),
        "jitter_ms": _plain(1e3 * heard.jitter_s),
        "drift_ppm": _plain(drift),
        "drift_error_ppm": _plain(error),
        "lost": None if counts is None else counts.lost,
        "duplicated": None if counts is None else counts.duplicated,
        "late": None if counts is None else counts.late,
        "restarted": None if counts is None else counts.restarted,
    }
    return Finding(source.url, "ok", ", ".join(parts), measured=measured)


def _problems(source: AnySource, heard: Heard, stall: float) -> list[Finding]:
    counts, about = heard.counts, f"device {heard.device}: "
    troubles: list[tuple[str, str]] = []
    if heard.never_read:
        never = f"the channels {', '.join(heard.never_read)} were never read"
        troubles.append((never, "check the wires of these sensors"))
    if counts is not None and counts.lost:
        lost = f"{counts.lost} of {counts.lost + heard.samples} samples are lost"
        troubles.append((lost, "use a higher baud rate, a shorter cable, or fewer programs beside it"))
    if counts is not None and counts.restarted:
        restarted = f"it has restarted {counts.restarted} times"
        troubles.append((restarted, "check its supply and whether its watchdog bites"))
    if heard.samples < 3:
        few = f"only {heard.samples} samples have come"
        troubles.append((few, "does it send by itself, and how often?"))
    if heard.drift_ppm is not None and abs(heard.drift_ppm[0]) > _DRIFT_PPM + heard.drift_ppm[1]:
        off = f"its clock is off by {heard.drift_ppm[0]:+.0f} ppm"
        troubles.append((off, "does it tell its time in the unit that its protocol says?"))
    found = [Finding(source.url, "problem", about + said, remedy) for said, remedy in troubles]
    if heard.jitter_s > _LATE_S:
        remedy = "an FTDI adapter gathers for 16 ms: set its latency timer to 1 ms"
        if heard.jitter_s <= _LATE_S + stall:
            remedy = (
                f"this computer let softfuse wait for {1e3 * stall:.0f} ms: end other programs, look again"
            )
        late = f"{about}samples come up to {1e3 * heard.jitter_s:.0f} ms late"
        found.append(Finding(source.url, "note", late, remedy))
    return found


def _wanted(wanted: Sequence[str], given: set[str]) -> list[Finding]:
    if not wanted:
        return []
    missing = [name for name in wanted if name not in given]
    if missing:
        told = f"{', '.join(missing)} of the configuration come from nowhere"
        remedy = "correct the names in [sensors] or in the device, or add the [[source]] that has them"
        return [Finding("channels", "problem", told, remedy, {"missing": missing})]
    return [Finding("channels", "ok", f"all {len(wanted)} of the configuration come")]


def _number(value: float, form: str) -> str:
    return "?" if math.isnan(value) else format(value, form)


def _plain(value: float) -> float | None:
    return value if math.isfinite(value) else None
