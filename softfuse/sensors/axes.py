"""Axes of a frame, as tables write them: unit vectors at right angles, right-handed."""

from typing import Annotated

import numpy as np
from pydantic import AfterValidator

from softfuse.io.quantity import wrong_value

Row = tuple[float, float, float]

Rows = tuple[Row, Row, Row]

WORLD: Rows = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def _right_handed(axes: Rows) -> Rows:
    turn = np.array(axes)
    if np.abs(turn @ turn.T - np.eye(3)).max() > 1e-6 or np.linalg.det(turn) < 0:
        raise wrong_value("give three unit vectors at right angles, right-handed")
    return axes


Axes = Annotated[Rows, AfterValidator(_right_handed)]
