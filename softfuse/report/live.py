"""A robot and what estimates it, everything behind the frames: live, and of a session that was recorded."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Self

import numpy as np

from softfuse.estimation.smoothing.smoother import Smoother
from softfuse.estimation.stream import Estimate, follow, smoother_of
from softfuse.estimation.tracked import Frame
from softfuse.estimation.tracker import Tracker
from softfuse.hardware.live.rerun_view import Picture, RerunView, Scene
from softfuse.hardware.live.session import Fields, Published
from softfuse.hardware.record.entries import Kind
from softfuse.mesh.surface import outer_surface
from softfuse.report.columns import Columns, Value, smoothed_columns, smoothed_values, smoothed_words
from softfuse.report.figures import flat_triangles
from softfuse.report.shape_figures import sharp_edges
from softfuse.robot.reduced import with_charts
from softfuse.robot.robot import Robot, build_robot, require_sensors
from softfuse.robot.settings import RobotSettings

PICTURES_A_SECOND = 20.0


@dataclass(frozen=True, eq=False)
class LiveEstimates:
    """Estimates of a robot by a tracker, with the columns of its frames."""

    robot: Robot
    tracker: Tracker
    columns: Columns
    smoother: Smoother | None

    @classmethod
    def of(cls, robot: Robot, tracker: Tracker) -> Self:
        """By a tracker that has seen nothing; raises ConfigError for points outside the body."""
        columns = Columns(robot)
        columns.watched.posture(tracker.state)  # compiled here, not while the first frame waits for it
        return cls(robot, tracker, columns, smoother_of(tracker))

    @classmethod
    def built(cls, settings: RobotSettings, charts: Path | None = None) -> Self:
        """Mesh, build and compile, with the reduced models of a folder if there is one.

        Raises ConfigError for a robot that cannot be estimated, SoftfuseError as `with_charts`.
        """
        require_sensors(settings)
        robot = build_robot(settings)
        return cls.of(robot, Tracker(robot, with_charts(robot, charts)))

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels of a frame."""
        return self.robot.settings.channels

    @cached_property
    def _all(self):
        """The columns of single frames, then those of what frames up to each say."""
        return (
            *self.columns.columns,
            *(smoothed_columns(self.columns.slots, "filtered_") if self.smoother else ()),
        )

    @property
    def kinds(self) -> Mapping[str, Kind]:
        """The columns of an estimate in a session, and their kinds."""
        return {column.name: "string" if column.digits is None else "number" for column in self._all}

    def follow(self, frames: Iterable[tuple[Frame, bool]]) -> Iterator[Estimate]:
        """The estimates of frames that are wanted."""
        return follow(self.tracker, frames, self.smoother)

    def fields(self, now: Estimate) -> Fields:
        """The values of all columns, None for text that is empty."""
        values = self.columns.read(now)
        if self.smoother is not None:
            values += smoothed_values(now.smoothed, len(self.columns.slots))
        return {column.name: _plain(value) for column, value in zip(self._all, values, strict=True)}

    @property
    def scene(self) -> Scene:
        """The body and its chambers."""
        mesh = self.robot.mesh
        faces = outer_surface(mesh.mesh).faces
        return Scene(
            self.robot.name,
            mesh.mesh.nodes,
            flat_triangles(faces),
            sharp_edges(mesh.mesh.nodes, faces),
            tuple(flat_triangles(cavity.faces) for cavity in mesh.cavities),
            tuple(self.columns.chambers.values()),
        )


def _plain(value: Value) -> float | str | None:
    return (value or None) if isinstance(value, str) else float(value)


class Pictures:
    """Shows estimates in a view, at a rate that eyes can follow."""

    def __init__(self, view: RerunView, live: LiveEstimates):
        """In a view of the scene of these estimates."""
        self._view, self._live = view, live
        nowhere = np.full((len(live.columns.slots), 3, 3), np.nan)
        live.columns.watched.pressed(nowhere, live.tracker.state)  # compiled before it is shown
        self._shown_s = -np.inf

    def publish(self, now: Published) -> None:
        """Show an estimate, unless one was shown just before."""
        if now.host_s - self._shown_s < 1.0 / PICTURES_A_SECOND:
            return
        self._shown_s = now.host_s
        live, estimate = self._live, now.estimate
        at, force = live.columns.contacts(estimate)
        numbers = {name: value for name, value in now.fields.items() if isinstance(value, float)}
        forces = {f"force/{name}": value for name, value in numbers.items() if name.endswith("_N")}
        others = {f"model/{name}": value for name, value in numbers.items() if not name.endswith("_N")}
        channels = {f"channels/{name}": float(value) for name, value in now.channels.items()}
        took = {
            "latency/estimate_ms": 1e3 * estimate.tracked.latency_s,
            "latency/from_last_byte_ms": 1e3 * now.end_to_end_s,
        }
        self._view.show(
            Picture(
                now.host_s,
                np.asarray(live.robot.model.body.displacement(estimate.state.z)),
                live.columns.watched.posture(estimate.state).volume_m3,
                at,
                force,
                {**forces, **others, **channels, **took},
                self._image(estimate),
                in_words(now, live.columns.slots),
            )
        )

    def _image(self, estimate: Estimate):
        """What the first sensor sees that makes an image, rows upwards."""
        details = estimate.tracked.details
        for sensor in self._live.robot.suite.contact_sensors:
            image = sensor.image(details[sensor.name])
            if image is not None:
                return image.values[::-1]
        return None


def in_words(now: Published, slots: tuple[str, ...]) -> str:
    """An estimate's statuses, and what frames up to it say."""
    tracked, smoothed = now.estimate.tracked, now.estimate.smoothed
    lines = ["; ".join(str(status) for status in tracked.statuses)]
    if smoothed is not None:
        touching = np.flatnonzero(tracked.touching).tolist()
        lines += [f"{slots[c]}, filtered: {smoothed_words(smoothed, c)}" for c in touching]
    return "\n".join(lines)
