"""In which tolerances a robot is made, before presses have told."""

from typing import Annotated

from annotated_types import Ge

from softfuse.io.quantity import Angle, Length, Number, PositiveNumber
from softfuse.io.settings import Settings


class CalibrationSettings(Settings):
    """Prior standard deviations of what `softfuse calibrate` fits; 0: it is taken as configured.

    stiffness: ln of a factor on all moduli; stiffness_field: of each coefficient of [body.stiffness_field];
    stiffening: Yeoh's c2 over c1; contact_layer: ln of the
    compliance of what lies between a disc and the body; cavity_shift, cavity_growth: of each cavity in place
    and length along x, y and z, in m; gain: ln of what each flow or pressure sensor measures over what there
    is; cable_zero: of each measured length in m; cable_compliance, dead_volume: ln of those of each cable and
    of each cavity's tube;
    array_shift, array_turn, array_stretch: of the electrodes on the body, in m, rad and as a part;
    array_sigma: ln of how much wider locations spread than their fits promise; array_dent: by which part of
    a dent's depth they spread besides; electrode_gain: ln of the gain of each line, at most.

    A stiffness field is left out by default: five presses of the reference block narrow 0.05 to 0.04 at best,
    and with 0.1 or more it follows what else the model misses there, so that other presses are told worse.
    So are gains of electrodes: what the model of a peak misses looks like gains under a few presses, of up to
    12 % on the virtual block of `softfuse evaluate`, whose lines are alike; places were then off by 0.55 mm
    instead of 0.2. Fit them where lines are known to differ, to presses all over the array.
    """

    stiffness: Annotated[Number, Ge(0)] = 0.5
    stiffness_field: Annotated[Number, Ge(0)] = 0.0
    stiffening: Annotated[Number, Ge(0)] = 1.0
    contact_layer: Annotated[Number, Ge(0)] = 1.0
    cavity_shift: Annotated[Length, Ge(0)] = 0.3e-3
    cavity_growth: Annotated[Length, Ge(0)] = 0.3e-3
    gain: Annotated[Number, Ge(0)] = 0.02
    cable_zero: Annotated[Length, Ge(0)] = 0.5e-3
    cable_compliance: Annotated[Number, Ge(0)] = 2.0
    dead_volume: Annotated[Number, Ge(0)] = 0.1
    array_shift: Annotated[Length, Ge(0)] = 0.5e-3
    array_turn: Annotated[Angle, Ge(0)] = 0.02
    array_stretch: Annotated[Number, Ge(0)] = 0.01
    array_sigma: PositiveNumber = 0.5
    array_dent: Annotated[Number, Ge(0)] = 0.1
    electrode_gain: Annotated[Number, Ge(0)] = 0.0
