"""Which shapes of a recording are kept."""

import jax.numpy as jnp
import numpy as np

from softfuse.cli.study import Peaks
from softfuse.mechanics.solution import State

NONE = jnp.zeros(0)


def test_each_run_keeps_the_shape_at_its_peak() -> None:
    sizes = [(0, 0.0), (1, np.nan), (1, 2.0), (1, np.nan), (1, 5.0), (1, 1.0), (0, 0.0), (1, 3.0), (1, 0.0)]
    peaks = Peaks()
    for frame, (going, size) in enumerate(sizes):
        peaks.see(frame, going > 0, size, State(jnp.full(1, float(frame)), NONE, NONE, NONE))
    assert [(peak.frame, peak.size, float(peak.state.z[0])) for peak in peaks.kept] == [
        (4, 5.0, 4.0),
        (7, 3.0, 7.0),
    ]
