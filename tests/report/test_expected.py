"""By how much readings are uncertain that are expected of a press."""

import numpy as np
import pytest
from made_robots import BLOCK, settings_of

from softfuse.estimation.doubts import TrackerSettings
from softfuse.estimation.model_error import AS_DRAWN, ModelError, assumed
from softfuse.report.observability import reading_sigma
from softfuse.robot.robot import Robot, build_robot

PRESSURE = """
[[sensor]]
name = "pressure"
type = "pressure"
part = "MPX5010"
chambers = ["left", "right"]
channels = ["left_V", "right_V"]
noise = "2 mV"
model_error = {part}
"""


def sealed(part: float, estimator: str = "") -> Robot:
    text = BLOCK[: BLOCK.index("[[sensor]]")] + PRESSURE.format(part=part) + estimator
    names = ('name = "left"\n', 'name = "right"\n')
    sealing = [(name, name + 'gas = "sealed"\ndead_volume = "1 ml"\n') for name in names]
    return build_robot(settings_of(text, *sealing))


def test_what_the_model_misses_grows_with_what_is_read() -> None:
    changes = np.array([[0.0, 0.0], [200.0, 800.0], [600.0, 0.0]])
    noise, wrong = (reading_sigma(sealed(part), 1.0, changes) for part in (0.0, 0.05))
    assert noise.shape == (3, 2) and (noise > 0).all()
    missed = np.sqrt(wrong**2 - noise**2)
    np.testing.assert_allclose(missed, np.array([[0.0, 0.0], [40.0, 40.0], [30.0, 30.0]]), atol=0.5)


@pytest.mark.parametrize("estimator", ["", "\n[estimator]\nmodel_error = 0.0\n"])
def test_a_model_of_which_nothing_is_known_is_wrong_as_drawn(estimator: str) -> None:
    error = TrackerSettings.of(sealed(0.05, estimator)).model_error
    kind = np.array([0, 0])
    known = bool(estimator)
    assert (error is not None) == known
    alone = assumed(error, kind, alone=True)
    assert np.all(alone.part == (0.0 if known else AS_DRAWN.part))
    assert alone.alike == (0.0 if known else AS_DRAWN.alike)
    assert np.all(assumed(error, kind, alone=False).part == ModelError().part)
