"""What makes a reduced body around some places of its loads: small enough to be kept in a file.

A chart holds where its loads act: other states than those that it was taught are combinations of its modes
only as far as they look alike, and nodes that it does not watch give NaN.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from softfuse.reduction.basis import Basis
from softfuse.reduction.cubature import Cubature


class Chart(NamedTuple):
    """The `basis` of r modes; the `cubature` of the body's points that its energy is measured at; the nodes
    `watched` (w,) that loads and functionals look at; how far each mode goes, the root mean square `reach`
    (r,) of the amplitudes it was taught; and the largest `compliance` [m/N] under one force of its loads.
    """

    basis: Basis
    cubature: Cubature
    watched: Int[np.ndarray, " w"]
    reach: Float[np.ndarray, " r"]
    compliance: float
