"""What the frames of a recording say about a robot: columns, errors against truth, shapes worth keeping.

A study sees every frame and can then be asked. Whatever part a robot has, and whatever the recording knows
about it, is compared: places and forces of contacts (Tables I and II of Navarro et al. 2020), forces at
places with names, contacts that are missed and forces that are none, positions of points (Table III).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from softfuse.estimation.stream import Estimate
from softfuse.estimation.tracked import Tracked
from softfuse.estimation.uncertainty import displacement_sigma
from softfuse.experiment.accuracy import (
    NOWHERE,
    PULLED_M,
    ContactSamples,
    Samples,
    ShapeSamples,
    Spread,
    contact_force_table,
    force_table,
    largest_force,
    location_table,
    position_table,
    scaled,
)
from softfuse.hardware.recording import Recording
from softfuse.report.columns import Columns, Value
from softfuse.report.truth import Truth, matched_contacts
from softfuse.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class Peak:
    """A frame in which something was largest, how large, and the estimate then."""

    frame: int
    size: float
    estimate: Estimate


class Peaks:
    """Keeps the peak of each run of frames, such as a touch, while the frames go by."""

    def __init__(self):
        """Nothing has been seen."""
        self.kept: list[Peak] = []
        self._within_run = False

    def see(self, frame: int, going: bool, size: float, now: Estimate) -> None:
        """Look at the next frame, in a run or not (`going`); without a positive size it is no peak."""
        if not going:
            self._within_run = False
        elif size > 0:
            if not self._within_run:
                self.kept.append(Peak(frame, size, now))
            elif size > self.kept[-1].size:
                self.kept[-1] = Peak(frame, size, now)
            self._within_run = True


@dataclass(frozen=True)
class ErrorTable:
    """Errors against truth by group, in a unit for people.

    `key`: in summary.json; `title`: in the report; `name`: on the terminal.
    """

    key: str
    title: str
    name: str
    unit: str
    groups: dict[str, Spread]


class Study:
    """A robot, a recording of it, and what has been found in its frames so far."""

    def __init__(self, robot: Robot, recording: Recording):
        """A study of frames that are yet to be found.

        Raises ConfigError for points outside the body, RecordingError as `Truth.of`.
        """
        self.robot, self.recording = robot, recording
        self.columns = Columns(robot)
        self.truth = Truth.of(recording, self.columns)
        self.found: list[Tracked] = []
        self.touches, self.free = Peaks(), Peaks()
        """The largest force of each touch, the largest displacement while nothing touches."""
        self._values: list[list[Value]] = []
        self._at = {column.name: k for k, column in enumerate(self.columns.columns)}

    def see(self, now: Estimate) -> None:
        """Look at the next frame."""
        moment = self.columns.moment(now)
        self.found.append(now.tracked)
        self._values.append(self.columns.values(moment))
        frame, touching = len(self.found) - 1, now.tracked.contacts > 0
        self.touches.see(frame, touching, now.tracked.force_N, now)
        # An actuator goes on while something touches, but its shape is that without.
        moved = float(moment.posture.moved_m)
        self.free.see(frame, moved > PULLED_M, 0.0 if touching else moved, now)

    def values(self, frame: int) -> list[Value]:
        """The values of the columns for a frame that it has seen."""
        return self._values[frame]

    @property
    def time_s(self) -> Float[np.ndarray, " n"]:
        """Time [s]."""
        return np.array([row.time_s for row in self.found])

    def series(self, names: Sequence[str]) -> Float[np.ndarray, "n m"]:
        """The values (n, m) of columns with numbers."""
        rows = [[values[self._at[name]] for name in names] for values in self._values]
        return np.array(rows, float).reshape(len(rows), len(names))

    def texts(self, name: str) -> list[str]:
        """The values of a column with texts."""
        return [str(values[self._at[name]]) for values in self._values]

    @property
    def peaks(self) -> list[Peak]:
        """The shapes to be kept, in the order of their frames."""
        return sorted([*self.touches.kept, *self.free.kept], key=lambda peak: peak.frame)

    def shape_sigma_m(self, peak: Peak) -> Float[np.ndarray, "k 3"]:
        """Standard deviations (k, 3) m of the nodes' displacements then."""
        now = peak.estimate
        return displacement_sigma(self.robot.model, now.state, now.tracked.places, now.tracked.covariance)

    @cached_property
    def sampled(self) -> Int[np.ndarray, " s"]:
        """Frames (s,) in which something presses of known place and force; none where places have names."""
        if any(self.columns.named):
            return np.zeros(0, int)
        at = self.truth.samples([*self._axes, "force_N"])
        return at[self.truth.get("force_N")[at] > 0] if at.size else at

    @property
    def _axes(self) -> list[str]:
        """Columns of the middle that the truth knows: two where contacts are seen along one axis."""
        known = [f"{axis}_mm" for axis in self._seen_along if f"{axis}_mm" in self.truth.columns]
        return known if len(known) > 1 else ["x_mm", "y_mm"]

    @property
    def _seen_along(self) -> list[str]:
        """The axes along which contacts differ: two where all have coordinates in one plane of them."""
        charts = [contact.chart for contact in self.robot.parts.contacts.values()]
        used = np.zeros(3, bool)
        for chart in charts:
            directions = np.eye(3) if chart is None else np.asarray(chart.place(jnp.zeros(2)))[1:]
            used |= np.any(np.abs(directions) > 1e-9, axis=0)
        return [axis for axis, there in zip("xyz", used, strict=True) if there]

    @property
    def samples(self) -> Samples | None:
        """Estimates and truth of contacts where both place and force are known; None where they never are."""
        if self.sampled.size:
            at, axes = self.sampled, self._axes
            sigma = [name.replace("_mm", "_sigma_mm") for name in axes]
            true = self.truth.matrix(axes)
            assert true is not None  # there are samples
            return Samples(
                level=self.truth.level[at],
                location_m=1e-3 * self.series(axes)[at],
                force_N=self.series(["force_N"])[at, 0],
                true_location_m=1e-3 * true[at],
                true_force_N=self.truth.get("force_N")[at],
                location_sigma_m=1e-3 * self.series(sigma)[at],
                force_sigma_N=self.series(["force_sigma_N"])[at, 0],
            )
        matched = self.matched
        return None if matched is None else matched.samples

    @property
    def matched(self):
        """Contacts of which each has a true place of its own, beside those that were found."""
        return (
            None if any(self.columns.named) else matched_contacts(self.found, self.truth, self.columns.slots)
        )

    @property
    def contact_samples(self) -> ContactSamples | None:
        """What presses on which named place and truly does at the samples; None where that is not known."""
        truth = self.truth
        at = np.flatnonzero(truth.level > 0)
        if not truth.place.shape[1] or not at.size:
            return None
        found = np.stack([self.place(slot) for slot in range(len(self.columns.slots))], axis=1)
        force = np.array([row.contact_force_N for row in self.found])
        return ContactSamples(truth.level[at], found[at], force[at], truth.place[at], truth.contact_N[at])

    def place(self, slot: int) -> Int[np.ndarray, " n"]:
        """The numbers (n,) of the named places of a contact, `NOWHERE` where it does not touch."""
        if not self.columns.named[slot]:
            return np.full(len(self.found), NOWHERE)
        number = {name: k for k, name in enumerate(self.columns.places)} | {"": NOWHERE}
        return np.array([number[each] for each in self.texts(f"{self.columns.slots[slot]}_place")], int)

    @property
    def shape_samples(self) -> ShapeSamples | None:
        """Where the points are and truly are at the samples; None where the recording does not know."""
        names, truth = self.point_columns, self.truth
        at = truth.samples(names)
        true = truth.matrix(names)
        if true is None or not at.size:
            return None
        cables = [f"{name}_mm" for name in self.columns.cables.values()]
        shorter = 1e-3 * np.max(self.series(cables), axis=1, initial=0.0)
        known = truth.matrix(cables)
        if known is not None:
            shorter = np.where(np.isfinite(known).all(axis=1), 1e-3 * known.max(axis=1), shorter)
        found = 1e-3 * self.series(names)[at].reshape(len(at), -1, 3)
        return ShapeSamples(
            truth.press[at], truth.level[at], shorter[at], found, 1e-3 * true[at].reshape(found.shape)
        )

    @property
    def point_columns(self) -> list[str]:
        """The columns of all points."""
        return [f"{name}_{axis}_mm" for name in self.columns.points.values() for axis in "xyz"]

    @property
    def errors(self) -> list[ErrorTable]:
        """Errors against truth; none where the recording does not hold it."""
        tables: list[ErrorTable] = []
        shape, samples, contacts = self.shape_samples, self.samples, self.contact_samples
        if shape is not None:
            groups = scaled(position_table(shape, [*self.columns.points]), 1e3)
            tables.append(
                ErrorTable("position_error_mm", "Table III: position error", "position error", "mm", groups)
            )
        if samples is not None:
            tables += contact_errors(samples)
        elif contacts is not None and contacts.true.any():
            groups = scaled(contact_force_table(contacts), 100.0)
            tables.append(ErrorTable("force_error_percent", "Force error", "force error", "%", groups))
        return tables

    def numbers(self) -> dict[str, Any]:
        """How many samples and contacts there are, and forces where truly nothing presses."""
        numbers: dict[str, Any] = {}
        shape, samples, contacts, matched = (
            self.shape_samples,
            self.samples,
            self.contact_samples,
            None if self.sampled.size else self.matched,
        )
        if shape is not None:
            numbers["samples"] = len(shape.level)
            known = np.isfinite(shape.position_m).all(axis=(1, 2))
            numbers["samples_without_estimate"] = int(np.sum(~known))
        elif samples is not None:
            numbers["samples"] = len(samples.level)
            numbers["samples_without_estimate"] = int(np.sum(~np.isfinite(samples.force_N)))
        for each in (contacts, matched):
            if each is not None:
                numbers["contacts_true"] = int(np.sum(each.true))
                numbers["contacts_missed"] = each.missed
                numbers["contacts_misplaced"] = each.misplaced
        truth = self.truth
        if self.columns.slots and truth.without_force.any():
            force = self.series(["force_N"])[:, 0]
            numbers["phantom_force_N"] = {
                "without_contact": known_number(largest_force(force, truth.without_contact)),
                "without_force": known_number(largest_force(force, truth.without_force)),
            }
        return numbers


def contact_errors(samples: Samples, key: str = "", of: str = "") -> list[ErrorTable]:
    """Tables I and II; `of`: what frames they are of, `key`: how their keys begin."""
    location = scaled(location_table(samples), 1e3)
    force = scaled(force_table(samples), 100.0)
    return [
        ErrorTable(
            f"{key}location_error_mm", f"Table I{of}: location error", f"location error{of}", "mm", location
        ),
        ErrorTable(f"{key}force_error_percent", f"Table II{of}: force error", f"force error{of}", "%", force),
    ]


def known_number(value: float) -> float | None:
    """A number for JSON, which has no NaN."""
    return float(value) if math.isfinite(value) else None
