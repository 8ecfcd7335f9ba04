"""Memory that was freed is kept, so that large arrays do not come from the system page by page."""

import os
import subprocess
import sys

import pytest

ASKED = """
import resource
import numpy as np
from softfuse.computing.prepare import prepare_jax

def faults():
    np.ones(8_000_000)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    np.ones(8_000_000)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

given_back = faults()
prepare_jax()
print(given_back, faults())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="glibc's settings")
def test_freed_memory_is_used_again() -> None:
    plain = {name: value for name, value in os.environ.items() if not name.startswith("MALLOC_")}
    said = subprocess.run(
        [sys.executable, "-c", ASKED], env=plain, capture_output=True, text=True, check=True
    ).stdout
    given_back, kept = map(int, said.split())
    assert given_back > 10 * max(kept, 1)
