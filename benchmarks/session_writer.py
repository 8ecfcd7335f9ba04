"""Cost and memory of recording a session: bytes, a frame and an estimate at a time.

    .venv/bin/python benchmarks/session_writer.py [--frames N] [--channels N]

Frames of noise, which compresses worse than any sensor, are written as fast as they can be. Printed as JSON:
microseconds per frame (all three entries, compression and hand-overs included) and the longest; the resident
memory [MB] at every tenth of the way; bytes per frame on disk; microseconds per frame to read it all back.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path

import numpy as np
from resident import resident_mb

from softfuse.hardware.record.entries import EstimateEntry, FrameEntry, Kind, SessionInfo, SourceInfo
from softfuse.hardware.record.session_reader import RecordedSession
from softfuse.hardware.record.session_writer import SessionWriter
from softfuse.hardware.stream import Chunk

COLUMNS: dict[str, Kind] = {
    **{f"estimate{k}_mm": "number" for k in range(8)},
    "contacts": "number",
    "where": "string",
}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--frames", type=int, default=200_000)
    parser.add_argument("--channels", type=int, default=20)
    arguments = parser.parse_args()
    count, channels = arguments.frames, arguments.channels
    info = SessionInfo(
        channels=tuple(f"channel{k}_V" for k in range(channels)),
        estimates=COLUMNS,
        sources=(SourceInfo("loop://", "wire"),),
    )
    rng = np.random.default_rng(0)
    values = rng.normal(size=(1000, channels))
    packets = [rng.bytes(25 + 4 * channels) for _ in range(1000)]
    found = [
        {name: float(x) for name, x in zip(COLUMNS, rng.normal(size=9), strict=False)} for _ in range(1000)
    ]
    spent, longest, memory = 0.0, 0.0, []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.mcap"
        with SessionWriter(path, info) as writer:
            for i in range(count):
                at, k = 1.8e9 + 0.01 * i, i % 1000
                begin = time.perf_counter()
                writer.add(Chunk(0, at, packets[k]))
                writer.add(FrameEntry(i, at, values[k]))
                writer.add(EstimateEntry(i, at, at, {**found[k], "where": "left 2"}, ("ok",), 1.5, 2.5))
                took = time.perf_counter() - begin
                spent, longest = spent + took, max(longest, took)
                if i % (count // 10) == 0:
                    memory.append(round(resident_mb(), 1))
        memory.append(round(resident_mb(), 1))
        size = path.stat().st_size
        begin = time.perf_counter()
        read = sum(1 for _ in RecordedSession(path).entries())
        reading = time.perf_counter() - begin
    numbers = {
        "frames": count,
        "channels": channels,
        "write_us_per_frame": round(1e6 * spent / count, 1),
        "write_longest_ms": round(1e3 * longest, 2),
        "resident_mb": memory,
        "bytes_per_frame": round(size / count),
        "entries_read": read,
        "read_us_per_frame": round(1e6 * reading / count, 1),
    }
    print(json.dumps(numbers, indent=2))


if __name__ == "__main__":
    main()
