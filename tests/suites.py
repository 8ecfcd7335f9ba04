"""The sensors of robots of configs/, without bodies, and what they say of recordings of tests/data."""

from pathlib import Path

import equinox as eqx
import jax
import numpy as np
from checks import stand_in

from softfuse.functional.chart import FlatChart
from softfuse.hardware.recording import Recording, read_recording
from softfuse.robot.file import load
from softfuse.robot.settings import RobotSettings
from softfuse.sensors.parts import CablePart, ChamberPart, ContactPart, Parts
from softfuse.sensors.suite import Observation, SensorSuite

TESTS = Path(__file__).parent
PAD = load(TESTS.parent / "configs" / "pad.toml")

NOTHING = stand_in()
DOWN = FlatChart.along(np.array([0.0, 0.0, -1.0]))


def suite_of(settings: RobotSettings) -> SensorSuite:
    """The sensors, on a face that is pressed from above."""
    chambers = {
        chamber.name: ChamberPart(
            NOTHING, k if chamber.gas == "sealed" else None, sealed=chamber.gas == "sealed", rest_volume=5e-7
        )
        for k, chamber in enumerate(settings.chambers)
    }
    cables = {cable.name: CablePart(k, k) for k, cable in enumerate(settings.cables)}
    contacts = {
        contact.name: ContactPart(DOWN, contact.radius, contact.at_once, *contact.ranges)
        for contact in settings.contacts
    }
    parts = Parts(NOTHING, np.zeros((0, 3), int), chambers, cables, contacts)
    return SensorSuite.of(settings.sensors, parts)


@eqx.filter_jit
def scan(suite: SensorSuite, time, raw) -> Observation:
    """What the suite says of all frames."""
    return jax.lax.scan(lambda s, f: suite.update(s, *f), suite.init(), (time, raw))[1]


def run(suite: SensorSuite, time, raw) -> Observation:
    """The same in numpy's arrays."""
    return jax.tree.map(np.asarray, scan(suite, time, raw))


def two_presses() -> Recording:
    """Of the pad, at two places, with truth."""
    return read_recording(TESTS / "data" / "pad_nominal_two_presses.csv.gz", [])
