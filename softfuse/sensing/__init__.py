"""Pure measurement models: what raw sensor readings say about volumes, touch and location."""

from softfuse.sensing.capacitive import (
    ArrayReading,
    ArrayState,
    CapacitiveArray,
    array_init,
    array_signal,
    capacitive_array,
    electrode_image,
    track_baseline,
    weighted_mean_location,
)
from softfuse.sensing.flow import (
    FlowReading,
    FlowSensor,
    FlowState,
    d6f_p0001a1,
    flow_evidence,
    flow_init,
    flow_update,
)
from softfuse.sensing.pad import (
    PadMeasurement,
    PadSensors,
    PadSensorState,
    pad_sensor_init,
    pad_sensor_update,
)
from softfuse.sensing.peak_fit import (
    PeakFit,
    PeakModel,
    fit_peak,
    fit_peak_of_honest,
    peak_model,
    peak_signal,
)
from softfuse.sensing.touch import (
    TouchDetector,
    TouchState,
    touch_detector,
    touch_init,
    touch_strength,
    touch_update,
)
from softfuse.sensing.zero_drift import ZeroDrift, ZeroEstimate

__all__ = [
    "ArrayReading",
    "ArrayState",
    "CapacitiveArray",
    "FlowReading",
    "FlowSensor",
    "FlowState",
    "PadMeasurement",
    "PadSensorState",
    "PadSensors",
    "PeakFit",
    "PeakModel",
    "TouchDetector",
    "TouchState",
    "ZeroDrift",
    "ZeroEstimate",
    "array_init",
    "array_signal",
    "capacitive_array",
    "d6f_p0001a1",
    "electrode_image",
    "fit_peak",
    "fit_peak_of_honest",
    "flow_evidence",
    "flow_init",
    "flow_update",
    "pad_sensor_init",
    "pad_sensor_update",
    "peak_model",
    "peak_signal",
    "touch_detector",
    "touch_init",
    "touch_strength",
    "touch_update",
    "track_baseline",
    "weighted_mean_location",
]
