"""Reading a recording takes little more memory than its numbers."""

import subprocess
import sys
from pathlib import Path

import numpy as np

ROWS, CHANNELS = 400_000, 20

CODE = """
import resource, sys
from pathlib import Path
import jax.numpy, pyarrow.csv
from softfuse.hardware.recording import read_recording
peak = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
read_recording(Path(sys.argv[1]), [])
before = peak()
print(len(read_recording(Path(sys.argv[2]), []).time_s), peak() - before)
"""


def test_a_recording_is_read_in_little_more_than_its_numbers_take(tmp_path):
    block = "".join(f"{{}}{k:03d},{'1.2345,' * CHANNELS}ok\n" for k in range(1000))
    header = ",".join(["time_ms", *(f"c{k}" for k in range(CHANNELS)), "state"]) + "\n"
    paths = [tmp_path / "small.csv", tmp_path / "large.csv"]
    for path, rows in zip(paths, (10_000, ROWS), strict=True):
        with path.open("w") as stream:
            stream.write(header)
            for k in range(rows // 1000):
                stream.write(block.replace("{}", str(k) if k else ""))
    root = Path(__file__).parents[2]
    command = [sys.executable, "-c", CODE, *map(str, paths)]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True)
    rows, grown = done.stdout.split()
    numbers = ROWS * (CHANNELS + 1) * np.dtype(float).itemsize / 2**20
    assert int(rows) == ROWS
    # Line numbers, flags, labels; the blocks being read; and one column twice while it grows.
    assert float(grown) < 1.25 * numbers + 50
