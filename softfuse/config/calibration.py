"""In which tolerances a device is made, before presses have told."""

from typing import Annotated

from annotated_types import Ge

from softfuse.config.quantity import Length, Number
from softfuse.config.settings import Settings


class CalibrationSettings(Settings):
    """Prior standard deviations of what `softfuse calibrate` fits; 0: it is taken as configured.

    stiffness: ln of a factor on all moduli; stiffening: Yeoh's c2 over c1; contact_layer: ln of the
    compliance of what lies between a disc and the body; cavity_shift, cavity_growth: of each cavity in place
    and length along x, y and z, in m; gain: ln of what each flow sensor measures over what flows.
    """

    stiffness: Annotated[Number, Ge(0)] = 0.5
    stiffening: Annotated[Number, Ge(0)] = 1.0
    contact_layer: Annotated[Number, Ge(0)] = 1.0
    cavity_shift: Annotated[Length, Ge(0)] = 0.3e-3
    cavity_growth: Annotated[Length, Ge(0)] = 0.3e-3
    gain: Annotated[Number, Ge(0)] = 0.02
