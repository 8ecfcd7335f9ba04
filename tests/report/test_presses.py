"""What recordings hold of presses, against the truth."""

from pathlib import Path

import numpy as np

from softfuse.report.presses import of_noise_alone, without_lag
from softfuse.robot.file import load
from softfuse.sensors.pressure.settings import PressureSettings

TIME = np.arange(400) * 0.01
RISING = 0.5
"""Seconds in which what is read rises to 1, to stay there."""


def mean_of(values, averaged):
    """The exponential mean of values (n,) with a time constant [s], as sensors take it."""
    share, mean = 1 - np.exp(-0.01 / averaged), np.zeros_like(values)
    for k in range(1, len(values)):
        mean[k] = mean[k - 1] + share * (values[k] - mean[k - 1])
    return mean


def test_what_is_read_half_a_second_after_a_rise_is_all_of_it():
    rise = np.clip((TIME - 1.0) / RISING, 0, 1)
    truth = rise**2 * (3 - 2 * rise)
    readings = np.stack([mean_of(truth, 0.2), mean_of(2 * truth, 0.1), truth], axis=1)
    at = np.array([200, 260])
    found = without_lag(TIME, readings, np.ones(readings.shape, bool), np.array([0.2, 0.1, 0.0]), at)
    assert readings[200, 0] < 0.98
    # The trapezoidal rule's error over steps of a twentieth of the time constant.
    assert np.allclose(found, [[1, 2, 1]] * 2, rtol=1e-3)


def test_it_has_the_noise_of_the_mean():
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(400, 500))
    readings = np.apply_along_axis(mean_of, 0, noise, 0.2)
    found = without_lag(TIME, readings, np.ones(readings.shape, bool), np.full(500, 0.2), np.array([300]))
    told = np.sqrt(0.01 / (2 * 0.2))
    assert 0.9 * told < found.std() < 1.1 * told


def test_where_a_reading_is_missing_it_is_the_mean():
    readings = np.stack([mean_of(np.clip(TIME - 1, 0, 1), 0.2)], axis=1)
    valid = np.ones(readings.shape, bool)
    valid[190] = False
    found = without_lag(TIME, readings, valid, np.array([0.2]), np.array([200, 250]))
    assert found[0] == readings[200]
    assert found[1] > readings[250]


def test_gains_and_models_that_are_off_are_no_noise():
    dome = load(Path(__file__).parents[2] / "configs" / "dome.toml")
    (pressure,), (drawn,) = of_noise_alone(dome).sensors, dome.sensors
    assert isinstance(pressure, PressureSettings) and isinstance(drawn, PressureSettings)
    assert pressure.gain_sigma == pressure.model_error == 0.0 and pressure.noise == drawn.noise > 0.0
