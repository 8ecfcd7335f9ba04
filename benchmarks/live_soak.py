"""Endurance of the live path: a virtual device's frames through a pseudo-terminal, the decoder, the estimator
and the recorder.

    .venv/bin/python benchmarks/live_soak.py CONFIG [--frames N] [--rate HZ|max]

`softfuse virtual-device` runs as a process of its own; everything else is what `softfuse run --record` runs.
Printed as JSON, and exit code 1 when something does not add up:

* samples that the board's numbers say were lost, late or doubled; frames assembled, sensed, overrun (dropped
  before the estimator), estimated; entries that the recorder lost;
* of the file: whether its frames are those assembled, in order, and whether its bytes give them again, bit
  for bit;
* resident memory [MB] of this process: the least and the most in each twentieth of the way, looked at every
  50 ms, and by how much the least of the later ones differ after the first quarter (the most of one is what
  computing takes and gives back);
* frames per second; latency from the last byte to the estimate [ms].

As fast as it goes ("max") the device makes samples as fast as they are read, many times faster than
estimates can be: overruns are then how the estimator keeps to the newest frame. At a rate in Hz there should
be none.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from resident import resident_mb

from softfuse.computing.prepare import prepare_jax
from softfuse.hardware.live.pipeline import Pipeline
from softfuse.hardware.live.recorder import Recorder
from softfuse.hardware.live.session import Session, SessionReport
from softfuse.hardware.record.entries import SessionInfo, SourceInfo
from softfuse.hardware.record.session_reader import RecordedSession
from softfuse.hardware.source.configured import connection_of, driver_of
from softfuse.hardware.stream import HostClock, Notice
from softfuse.report.live import LiveEstimates
from softfuse.robot.file import load
from softfuse.robot.source import SoftfuseSource

_STEPS = 20
Memory = list[tuple[float, float]]
"""Least and most [MB] in each step of the way."""


def soak(parts: LiveEstimates, url: str, record: Path, frames: int) -> tuple[SessionReport, float, Memory]:
    """Run for so many frames: the report, frames per second, memory."""
    clock = HostClock()
    source = SoftfuseSource(driver="softfuse", url=url, baud=115200)
    driver = driver_of(source)

    def tell(notice: Notice) -> None:
        print(f"{notice.level}: {notice.text}", file=sys.stderr)

    info = SessionInfo(
        channels=parts.channels,
        estimates=parts.kinds,
        sources=(SourceInfo(source.url, source.driver),),
    )
    session = Session(
        Pipeline(parts.channels, [driver]),
        parts,
        clock,
        send=lambda source, data: connection.send(data),
        notify=[tell],
    )
    connection = connection_of(0, source, driver, session.receive, session.tell, clock)
    connection.open()
    session.start(Recorder(record, info, clock, tell))
    memory: list[list[float]] = [[] for _ in range(_STEPS)]
    while not session.failed and not session.report.frames:
        time.sleep(0.01)
    first, began = session.report.frames, time.perf_counter()
    while not session.failed and (done := session.report.frames) < frames:
        memory[done * _STEPS // frames].append(round(resident_mb(), 1))
        time.sleep(0.05)
    rate = (session.report.frames - first) / (time.perf_counter() - began)
    connection.stop()
    session.stop()
    return session.report, rate, [(min(part), max(part)) for part in memory if part]


def recorded(parts: LiveEstimates, path: Path) -> dict[str, Any]:
    """What the file holds, and whether its bytes give its frames again."""
    session = RecordedSession(path)
    pipeline = Pipeline(parts.channels, [driver_of(SoftfuseSource(driver="softfuse", url="x", baud=115200))])
    again = (frame for chunk in session.chunks() for frame in pipeline.feed(chunk)[0])
    in_order, identical, count = True, 0, 0
    for entry, frame in zip(session.frames(), again, strict=True):
        in_order &= entry.index == count
        same = entry.time_s == frame.time_s and np.array_equal(entry.values, frame.values, equal_nan=True)
        identical, count = identical + same, count + 1
    estimates = [(entry.frame, entry.sensed or 0) for entry in session.estimates()]
    return {
        "frames": count,
        "in_order": in_order,
        "given_again_by_the_bytes": identical,
        "estimates": len(estimates),
        "went_into_estimates": sum(sensed for _, sensed in estimates),
        "bytes_per_frame": round(path.stat().st_size / max(count, 1)),
    }


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("config", type=Path)
    parser.add_argument("--frames", type=int, default=1_000_000)
    parser.add_argument("--rate", default="max")
    arguments = parser.parse_args()
    prepare_jax()
    parts = LiveEstimates.built(load(arguments.config))
    with tempfile.TemporaryDirectory() as folder:
        port, record = Path(folder) / "port", Path(folder) / "session.mcap"
        command = ["softfuse", "virtual-device", str(arguments.config), "--rate", arguments.rate]
        started = [sys.executable, "-m", *command, "--link", str(port), "--quiet"]
        with subprocess.Popen(started, stdout=subprocess.DEVNULL) as device:
            while not port.exists() and device.poll() is None:
                time.sleep(0.1)
            report, rate, memory = soak(parts, str(port), record, arguments.frames)
            # Not by an interrupt, which what a shell has started in its background does not hear.
            device.terminate()
        file = recorded(parts, record)
    samples = report.devices[0].samples
    settled = [least for least, _ in memory[_STEPS // 4 :]]
    numbers = {
        "rate": arguments.rate,
        "samples": samples.fresh,
        "samples_lost": samples.lost,
        "samples_late": samples.late,
        "samples_doubled": samples.duplicated,
        "frames": report.frames,
        "sensed": report.sensed,
        "overruns": report.overruns,
        "estimated": report.estimated,
        "recorder_lost": report.recorder_lost,
        "file": file,
        "resident_mb": memory,
        "resident_spread_mb": round(max(settled) - min(settled), 1),
        "frames_per_s": round(rate),
        "latency_ms": {
            "p50": round(1e3 * report.latency_p50_s, 2),
            "p99": round(1e3 * report.latency_p99_s, 2),
            "max": round(1e3 * report.latency_max_s, 2),
        },
    }
    print(json.dumps(numbers, indent=2))
    whole = (
        samples.lost == samples.late == samples.duplicated == report.recorder_lost == 0
        and samples.fresh == report.frames == report.sensed + report.overruns
        and file["frames"] == file["given_again_by_the_bytes"] == report.frames
        and file["in_order"]
        and file["went_into_estimates"] == report.sensed
        and file["estimates"] == report.estimated
    )
    return 0 if whole else 1


if __name__ == "__main__":
    raise SystemExit(main())
