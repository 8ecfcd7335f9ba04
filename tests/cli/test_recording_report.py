"""Which shapes of a recording are kept."""

import jax.numpy as jnp
import numpy as np

from softfuse.cli.recording_report import Peaks
from softfuse.estimation.tracker import Tracked
from softfuse.sensing.status import Status


def seen(contacts: int, force_N: float) -> Tracked:
    touching, place, nothing = np.array([contacts > 0]), np.zeros((1, 3)), np.zeros(0)
    force = np.array([force_N])
    return Tracked(
        0.0, touching, place, force, nothing, nothing, nothing, nothing, None, (Status.ok,), latency_s=0.0
    )


def test_each_touch_keeps_the_shape_at_its_largest_force() -> None:
    forces = [(0, 0.0), (1, np.nan), (1, 2.0), (1, np.nan), (1, 5.0), (1, 1.0), (0, 0.0), (1, 3.0), (1, 0.0)]
    peaks = Peaks()
    for frame, (contacts, force_N) in enumerate(forces):
        peaks.see(frame, seen(contacts, force_N), jnp.full(1, float(frame)))
    assert [(peak.frame, peak.force_N, float(peak.z[0])) for peak in peaks.kept] == [
        (4, 5.0, 4.0),
        (7, 3.0, 7.0),
    ]
