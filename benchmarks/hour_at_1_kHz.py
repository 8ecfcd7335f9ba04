"""Time and memory of reading an hour at 1 kHz, 3.6 million rows of 20 channels, in processes of their own.

    .venv/bin/python benchmarks/hour_at_1_kHz.py [--rows N]

`read`: a recording in memory; `convert`: into Parquet, as `softfuse convert` does.
"""

import argparse
import multiprocessing
import resource
import time
from multiprocessing.queues import SimpleQueue
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

CHANNELS = 20


def write(path: Path, rows: int) -> None:
    """A recording of volts and counts with four and no decimals, and a text that nobody asked for."""
    rng = np.random.default_rng(0)
    volts, counts = CHANNELS // 4, CHANNELS - CHANNELS // 4
    names = [f"flow{k}_V" for k in range(volts)] + [f"row{k}" for k in range(counts)]
    with path.open("w") as stream:
        stream.write(",".join(["time_s", *names, "state"]) + "\n")
        for start in range(0, rows, 100_000):
            n = min(100_000, rows - start)
            some = [np.arange(start, start + n)[:, None] / 1000, 0.5 + rng.normal(0, 0.01, (n, volts))]
            table = np.concatenate([*some, rng.integers(20_000, 22_000, (n, counts))], axis=1)
            form = ",".join(["%.3f", *["%.4f"] * volts, *["%d"] * counts]) + ",ok\n"
            stream.write("".join(form % tuple(row) for row in table.tolist()))


def measured(act: str, path: Path, answer: SimpleQueue) -> None:
    """Rows, seconds, and the largest resident memory before and after [MB]."""
    from softfuse.hardware.record.convert import convert_frames
    from softfuse.hardware.recording import read_recording

    before, started = peak_MB(), time.perf_counter()
    if act == "read":
        rows = len(read_recording(path, []).time_s)
    else:
        rows = convert_frames(path, path.with_suffix(".parquet"))
    answer.put((rows, time.perf_counter() - started, before, peak_MB()))


def peak_MB() -> float:
    """The largest resident memory of this process so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    """Write, read and convert."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    arguments.add_argument("--rows", type=int, default=3_600_000)
    given = arguments.parse_args()
    context = multiprocessing.get_context("spawn")
    with TemporaryDirectory() as folder:
        path = Path(folder) / "hour.csv"
        write(path, given.rows)
        print(f"{given.rows} rows of {CHANNELS} channels, {path.stat().st_size / 1e6:.0f} MB")
        for act in ("read", "convert"):
            answer = context.SimpleQueue()
            worker = context.Process(target=measured, args=(act, path, answer))
            worker.start()
            rows, seconds, before, after = answer.get()
            worker.join()
            print(f"{act}: {rows} rows in {seconds:.1f} s, at most {after:.0f} MB ({before:.0f} before)")


if __name__ == "__main__":
    main()
