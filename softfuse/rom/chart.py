"""What makes a reduced body around some places of its loads: small enough to be kept in a file.

A chart holds where its loads act: other states than those that it was taught are combinations of its modes
only as far as they look alike, and nodes that it does not watch give NaN.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from softfuse.rom.basis import Basis
from softfuse.rom.sampling import Sampling


class Chart(NamedTuple):
    """The `basis` of r modes; the `sampling` of the body's points, at which its energy is measured; the nodes
    `watched` (w,) that loads and functionals look at; how far each mode goes, the root mean square `reach`
    (r,) of the amplitudes it was taught; some `typical` (t, r) of these, far from each other; and the largest
    `compliance` [m/N] under one force of its loads.
    """

    basis: Basis
    sampling: Sampling
    watched: Int[np.ndarray, " w"]
    reach: Float[np.ndarray, " r"]
    typical: Float[np.ndarray, "t r"]
    compliance: float
