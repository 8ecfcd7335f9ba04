"""The second stage of `softfuse evaluate`: estimates of its recordings, each on a core of its own."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from queue import SimpleQueue

import numpy as np

from softfuse.cli.estimate import Part, follow, study_of
from softfuse.cli.evaluation_report import Evaluator
from softfuse.cli.recorded import sensor_columns, sensor_frames
from softfuse.cli.study import Estimated
from softfuse.cli.terminal import tracked_calls
from softfuse.config.build_device import build_device
from softfuse.config.build_tracker import build_tracker
from softfuse.estimation.side_by_side import cores
from softfuse.estimation.tracker import Tracker
from softfuse.experiment.pose_cache import Arrays, kept
from softfuse.hardware.recording import read_recording
from softfuse.robot.settings import RobotSettings
from softfuse.robot.mesh import build_mesh

EVERY = 10
"""Frames from one estimate to the next: ten estimates a second, which a full body manages live."""


def estimates(
    settings: RobotSettings,
    recordings: Sequence[Path],
    folder: Path,
    evaluator: Evaluator,
    *,
    about: str,
    quiet: bool,
) -> list[Arrays]:
    """The evaluator's arrays of each recording, in their order.

    They are kept in the folder, with the estimates as CSV, and not estimated again where they are there.
    `about`: what the progress shows.
    """
    files = [path.name.removesuffix(".csv.gz") for path in recordings]

    with tracked_calls(about, total=len(files), quiet=quiet) as done:

        def start() -> Callable[[int], Mapping[str, np.ndarray]]:
            mesh = build_mesh(settings)
            device = build_device(settings, mesh)
            trackers: SimpleQueue[Tracker] = SimpleQueue()
            for _ in range(min(cores(), len(files))):
                trackers.put(build_tracker(settings, device))
            folder.mkdir(parents=True, exist_ok=True)

            def compute(k: int) -> Mapping[str, np.ndarray]:
                whole = read_recording(recordings[k], sensor_columns(settings))
                part = Part.of(whole, EVERY)
                estimated = Estimated(settings, device, mesh, part.recording)
                study, tracker = study_of(estimated), trackers.get()
                try:
                    tracker.reset()
                    frames = sensor_frames(settings, whole)
                    follow(tracker, frames, part, estimated, study, folder / f"{files[k]}.csv")
                finally:  # the others wait for it
                    trackers.put(tracker)
                done()
                return evaluator.said(study)

            return compute

        return kept(folder, files, evaluator.names, start)
