"""Sensors of the examples: what their settings become, and how mistakes in them are told."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from made_sensors import (
    capacitive_array,
    chambered,
    d6f_p0001a1,
    names,
    nxp,
    peak_model,
    single_electrodes,
    touch_detector,
    touched_at,
)

from softfuse.errors import ConfigError
from softfuse.robot.file import load
from softfuse.sensors.cable_length import CableLengthSettings
from softfuse.sensors.crossed.settings import CrossedSettings
from softfuse.sensors.crossed.touch import TouchDetector
from softfuse.sensors.electrodes import ElectrodeSettings
from softfuse.sensors.flow import FlowSettings
from softfuse.sensors.mutual.settings import MutualSettings
from softfuse.sensors.parameters import parameters
from softfuse.sensors.pressure.settings import PressureSettings

Write = Callable[..., Path]

MUTUAL = Path(__file__).parents[2] / "configs" / "pad_mutual.toml"
LINES = 1e-3 * (-28 + 8 * jnp.arange(8))


def test_sensors_of_the_pad_are_those_of_their_data_sheets(write: Write) -> None:
    settings = load(write())
    (flow,), (lines,) = settings.sensors_of(FlowSettings), settings.sensors_of(CrossedSettings)
    vents = flow.model_copy(update={"channels": tuple(names(4)), "chambers": tuple(names(4))})
    assert eqx.tree_equal(vents.sensor(chambered(names(4))), d6f_p0001a1(4))
    assert eqx.tree_equal(lines.array(), capacitive_array())
    assert eqx.tree_equal(parameters(TouchDetector, lines.touch, lines), touch_detector())
    assert eqx.tree_equal(lines.peak_model(10e-3), peak_model(LINES, LINES, 1.5e-3, 1.0e-3))


def test_sensors_of_the_finger_are_those_of_their_data_sheets(write_finger: Write) -> None:
    settings = load(write_finger())
    (pressure,) = settings.sensors_of(PressureSettings)
    assert (pressure.part, pressure.average, pressure.reference) == ("MPX5100A", 0.2, 5.0)
    named = {"name": "pressure", "channels": tuple(names(6)), "chambers": tuple(names(6))}
    found = pressure.model_copy(update=named).sensor(chambered(names(6), drive=0))
    assert eqx.tree_equal(found, nxp("MPX5100A", 6))
    (electrodes,) = settings.sensors_of(ElectrodeSettings)
    named = {"name": "skin", "contact": "contact", "channels": tuple(names(12))}
    made = single_electrodes(12)
    found = electrodes.model_copy(update=named).sensor(touched_at("contact", 3))
    assert eqx.tree_equal(replace(found, places=made.places, covariance_m2=made.covariance_m2), made)


def test_settings_reach_flow_sensors_and_lines(write: Write) -> None:
    changes = (
        ('zero = "0.5 V"', 'zero = "1 V"'),
        ('sensitivity = "20 V min/L"', 'sensitivity = "2 V min/L"'),
        ('wander_time = "3 s"', 'wander_time = "3 s"\nlag_frames = 7\nhold_off = "1 s"'),
        ("noise_counts = 8.0", "noise_counts = 4.0"),
        ('creep_time = "60 s"', 'creep_time = "1 min"\nnegative_sigma = 3'),
        ("near_on_sigma = 8.0", "near_on_sigma = 9"),
        ("[estimator]", '[sensor.peak]\ngap_sigma = "1 mm"\n\n[estimator]'),
    )
    settings = load(write(*changes))
    (flow,), (lines,) = settings.sensors_of(FlowSettings), settings.sensors_of(CrossedSettings)
    zeros = flow.sensor(chambered(flow.chambers))
    np.testing.assert_allclose(zeros.zero_V, 1.0)
    np.testing.assert_allclose(zeros.sensitivity_Vs_m3, 0.12e6)
    assert (zeros.lag_frames, float(zeros.hold_off_s)) == (7, 1.0)
    array, peak, touch = lines.array(), lines.peak_model(5e-3), parameters(TouchDetector, lines.touch, lines)
    assert [float(s.noise_counts) for s in (array, peak, touch)] == [4.0] * 3
    assert (float(array.creep_time_s), float(array.negative_sigma)) == (60.0, 3.0)
    assert float(touch.near_on_sigma) == 9.0
    assert (float(peak.radius_m), float(peak.gap_sigma_m)) == (5e-3, 1e-3)


def test_settings_reach_pressure_sensors_and_electrodes(write_finger: Write) -> None:
    leak = 'leak = { slowest = "1 min", fastest = "4 s", repeat = "30 Pa" }\n'
    changes = (
        ('reference = "5 V" ', 'reference = "5.1 V"\nhold_off = "2 s"\nlag_frames = 7 '),
        ('low = "2 mV"', 'low = "3 mV"'),
        ("model_error = 0.05", "gain_sigma = 0.02"),
        ('high = "4.998 V"', f'high = "4.998 V"\ntare = {{ settle = "2 s", drift = "6 Pa/min" }}\n{leak}'),
        ("on_counts = 600.0", 'on_counts = 500.0\nlost = "0.2 s"\nquiet = "3 s"\non_frames = 5'),
        ("off_counts = 400.0 ", 'off_counts = 400.0\nbaseline = { creep_time = "30 s" } '),
    )
    settings = load(write_finger(*changes))
    (pressure,) = settings.sensors_of(PressureSettings)
    pressure = pressure.sensor(chambered(pressure.chambers, drive=0, atmosphere=95e3))
    np.testing.assert_allclose(pressure.rest_Pa, 95e3)
    assert (float(pressure.reference), float(pressure.clip_low), pressure.lag_frames) == (5.1, 3e-3, 7)
    assert (float(pressure.gain_sigma), float(pressure.hold_off_s)) == (0.02, 2.0)
    assert (float(pressure.tare.settle_s), float(pressure.tare.drift_Pa_s)) == (2.0, pytest.approx(0.1))
    leaks = pressure.leak
    assert (float(leaks.tolerated_1_s), float(leaks.prior_1_s)) == (pytest.approx(1 / 60), 0.25)
    assert float(leaks.repeat_Pa) == 30.0
    (electrodes,) = settings.sensors_of(ElectrodeSettings)
    electrodes = electrodes.sensor(touched_at(electrodes.contact, 1))
    np.testing.assert_allclose(electrodes.on_counts, 500.0)
    assert (float(electrodes.lost_s), float(electrodes.quiet_s), int(electrodes.on_frames)) == (0.2, 3.0, 5)
    assert float(electrodes.array.creep_time_s) == 30.0


def test_gains_are_one_for_all_chambers_or_one_for_each(write_finger: Write) -> None:
    each = (0.9, 0.95, 1.0, 1.05, 1.1, 1.2)
    (pressure,) = load(write_finger(("gain = 0.96", f"gain = {list(each)}"))).sensors_of(PressureSettings)
    assert pressure.gain == each
    with pytest.raises(ConfigError, match=r"sensor\[0\].gain: 2 values for 6 channels: give one, or one for"):
        load(write_finger(("gain = 0.96", "gain = [1.0, 0.9]")))


def test_a_cable_may_be_read_in_another_unit(write_finger: Write) -> None:
    written = write_finger(('unit = "mm"\nnoise', 'unit = "in"\nzero = "1 mm"\nnoise'))
    (cable,) = load(written).sensors_of(CableLengthSettings)
    assert (cable.unit, cable.zero) == (0.0254, (1e-3,))


def written(path: Path, old: str, new: str) -> Path:
    """The example of mutual capacitances with a piece of its text replaced."""
    text = MUTUAL.read_text(encoding="utf-8")
    assert text.count(old) == 1
    path.write_text(text.replace(old, new), encoding="utf-8")
    return path


def test_the_grid_of_the_example_follows_two_contacts() -> None:
    settings = load(MUTUAL)
    (grid,) = settings.sensors_of(MutualSettings)
    assert settings.contact().at_once == 2 and len(settings.channels) == 4 + 16
    np.testing.assert_allclose(grid.model().column_x_m, [-24e-3, -8e-3, 8e-3, 24e-3])


def test_gains_of_cells_are_given_row_by_row(tmp_path: Path) -> None:
    gain = [1.0 + 0.01 * k for k in range(16)]
    settings = load(written(tmp_path / "pad.toml", "# gain = [...]", f"gain = {gain}"))
    found = settings.sensors_of(MutualSettings)[0].model().gain
    assert float(found[1, 0]) == gain[1] and float(found[0, 1]) == gain[4]


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("# gain = [...]", "gain = [1.0, 1.1]", "gain: 2 numbers for 16 cells"),
        ("touches = 4 ", "touches = 9 ", "touches: at most 5 are followed"),
        ("coupling_off = 0.12", "coupling_off = 0.3", "coupling_off: must not exceed coupling_on = 0.25"),
    ],
)
def test_what_a_grid_cannot_be_is_told(tmp_path: Path, old: str, new: str, told: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load(written(tmp_path / "pad.toml", old, new))
    assert told in str(caught.value)
