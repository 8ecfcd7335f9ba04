"""Filters of sensors as their settings make them, with options in SI, for tests of the filters alone."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from checks import stand_in

from softfuse.functional.chart import FlatChart
from softfuse.sensors.capacitive import BaselineSettings, CapacitiveArray
from softfuse.sensors.crossed.peak_follow import follow_peak, no_peak
from softfuse.sensors.crossed.peak_model import PeakFit, PeakModel, peak_layers, peak_shape
from softfuse.sensors.crossed.settings import CrossedSettings, TouchSettings
from softfuse.sensors.crossed.touch import TouchDetector
from softfuse.sensors.electrodes import ElectrodeSettings, SingleElectrodes
from softfuse.sensors.flow import Flow, FlowSettings
from softfuse.sensors.mutual.model import MutualModel
from softfuse.sensors.mutual.sensor import MutualElectrodes
from softfuse.sensors.mutual.settings import MutualSettings, MutualShapeSettings
from softfuse.sensors.parameters import parameters
from softfuse.sensors.parts import ChamberPart, ContactPart, Parts
from softfuse.sensors.pressure.leak import LeakTest
from softfuse.sensors.pressure.sensor import GaugePressure
from softfuse.sensors.pressure.settings import LeakSettings, PressureSettings, TareSettings
from softfuse.sensors.tare import Tare


def names(count: int) -> list[str]:
    """So many names."""
    return [f"c{k}" for k in range(count)]


def mm(values: Any) -> list[str]:
    """Lengths in m as they are written."""
    return [f"{1e3 * float(value)!r} mm" for value in values]


def chambered(chambers: Any, *, drive: int | None = None, atmosphere: float = 101325.0) -> Parts:
    """A robot of nothing but chambers, vented or sealed with a number of their drive."""
    nothing = stand_in()
    made = {name: ChamberPart(nothing, drive, sealed=drive is not None) for name in chambers}
    return Parts(nothing, np.zeros((0, 3), int), made, atmosphere=atmosphere)


def touched_at(contact: str, slots: int, chart: FlatChart | None = None) -> Parts:
    """A robot of nothing but a contact with so many slots, on a face, or where sensors say."""
    nothing = stand_in()
    part = ContactPart(chart, 5e-3, slots, np.full(2, -32e-3), np.full(2, 32e-3))
    return Parts(nothing, np.zeros((0, 3), int), contacts={contact: part})


def d6f_p0001a1(channels: int) -> Flow:
    """OMRON D6F-P0001A1."""
    keys = {"name": "flow", "part": "D6F-P0001A1", "channels": names(channels), "chambers": names(channels)}
    return FlowSettings.model_validate(keys).sensor(chambered(names(channels)))


def nxp(part: str, channels: int, **options: Any) -> GaugePressure:
    """NXP pressure sensors under 101325 Pa."""
    keys = {"name": "pressure", "part": part, "channels": names(channels), "chambers": names(channels)}
    sealed = chambered(names(channels), drive=0)
    return PressureSettings.model_validate(keys).model_copy(update=options).sensor(sealed)


def tare(**options: Any) -> Tare:
    """How zeros of MPX5100 are taken."""
    return TareSettings().model_copy(update=options).tare(2.5e3)


def leak_test(**options: Any) -> LeakTest:
    """The leak test."""
    return LeakSettings().model_copy(update=options).test()


def crossed(rows: Any, columns: Any, row_depth: float = 1.5e-3, column_depth: float = 1e-3, **options: Any):
    """Settings of crossed lines at rows, columns (n,) m."""
    keys = {
        "name": "lines",
        "contact": "contact",
        "channels": names(len(rows) + len(columns)),
        "row_y": mm(rows),
        "column_x": mm(columns),
        "row_depth": f"{row_depth} m",
        "column_depth": f"{column_depth} m",
    }
    return CrossedSettings.model_validate(keys | options)


def peak_model(rows: Any, columns: Any, row_depth: float, column_depth: float, **options: Any) -> PeakModel:
    """The peak of a contact of 10 mm."""
    return crossed(rows, columns, row_depth, column_depth, peak=options).peak_model(10e-3)


def peak_signal(model: PeakModel, location: Any, amplitude: Any, offset: Any, radius: Any, gap: Any):
    """Counts (e,) of a cylinder at (2,) m, with amplitudes and offsets (2,) of rows, columns."""
    response, layer = peak_shape(model)(jnp.append(location, jnp.stack([radius, gap]))), peak_layers(model)
    return layer @ amplitude * response + layer @ offset


def fit_anew(model: PeakModel, signal: Any, valid: Any) -> PeakFit:
    """What is found of a peak in the first frame in which it is seen."""
    return follow_peak(model, no_peak(model), signal, valid)[1]


def raw_of(sensor: GaugePressure, pressure: Any, reference: Any):
    """Output Vs (gain P + offset) of a perfect part: pressure P (k,) Pa, reference Vs."""
    return reference * (sensor.gain_1_Pa * pressure + sensor.offset)


def capacitive_array(**options: Any) -> CapacitiveArray:
    """Electronics of eight rows and columns; options of their baseline, or settings of the lines."""
    own = {key: options.pop(key) for key in tuple(options) if key in BaselineSettings.model_fields}
    lines = 8e-3 * np.arange(8)
    baseline = BaselineSettings().model_copy(update=own)
    return crossed(lines, lines, **options).model_copy(update={"baseline": baseline}).array()


def touch_detector() -> TouchDetector:
    """When something touches crossed lines."""
    return parameters(TouchDetector, TouchSettings(), noise_counts=8.0)


def single_electrodes(count: int, *, creep_time: float = 60.0, **options: Any) -> SingleElectrodes:
    """Of which three are followed at once."""
    place = {"name": "one", "centre": mm([0, 0, 0]), "direction": [0, 0, 1]}
    keys = {"name": "skin", "contact": "contact", "channels": names(count), "electrodes": [place] * count}
    baseline = BaselineSettings().model_copy(update={"creep_time": creep_time})
    update = options | {"baseline": baseline}
    return ElectrodeSettings.model_validate(keys).model_copy(update=update).sensor(touched_at("contact", 3))


def mutual_grid(column_x: Any, row_y: Any, **shape: Any) -> MutualElectrodes:
    """A grid of 4 × 4 cells; options of what a finger leaves on it."""
    keys = {
        "name": "grid",
        "contact": "contact",
        "channels": names(16),
        "row_y": mm(row_y),
        "column_x": mm(column_x),
    }
    update = {"shape": MutualShapeSettings().model_copy(update=shape)}
    pressed = touched_at("contact", 1, FlatChart.along(np.array([0.0, 0.0, -1.0])))
    return MutualSettings.model_validate(keys).model_copy(update=update).sensor(pressed)


def mutual_model(column_x: Any, row_y: Any, **shape: Any) -> MutualModel:
    """What a finger leaves on such a grid."""
    return mutual_grid(column_x, row_y, **shape).model
