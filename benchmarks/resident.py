"""Resident memory of the running process, for the benchmarks of what runs for long."""

import resource
from pathlib import Path


def resident_mb() -> float:
    """Memory of this process [MB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6
