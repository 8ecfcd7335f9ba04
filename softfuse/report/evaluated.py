"""The stages of `softfuse evaluate`: what a virtual test bed does, recorded as a real one would, and
estimates of its recordings, each on a core of its own.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from queue import SimpleQueue

import numpy as np

from softfuse.estimation.side_by_side import cores
from softfuse.estimation.stream import follow
from softfuse.estimation.tracker import Tracker
from softfuse.experiment.paper.bed import Bed
from softfuse.experiment.pose_cache import Arrays, kept
from softfuse.experiment.recording_file import write_recording
from softfuse.io.result_folder import put_in_place, writing
from softfuse.report.calibrated import Seen, calibrated_robot
from softfuse.report.evaluation import Evaluator
from softfuse.report.page import table
from softfuse.report.recorded import Part, read_sensors, sensor_frames
from softfuse.report.recording_report import EstimateRows
from softfuse.report.study import Study
from softfuse.robot.robot import build_robot
from softfuse.robot.settings import RobotSettings

EVERY = 10
"""Frames from one estimate to the next: ten estimates a second, which a full body manages live."""


def record(bed: Bed, folder: Path, *, solved: Callable[[], None]) -> list[Path]:
    """A recording of each thing that is done, in folder/recordings; those that are there are kept, as are
    equilibria in folder/equilibria.

    `solved` is called after each equilibrium. Raises SolveError when the body cannot be pressed,
    SoftfuseError when a file cannot be written.
    """
    paths = [folder / "recordings" / f"{name}.csv.gz" for name in bed.names]
    if all(path.exists() for path in paths):
        return paths
    played = bed.played(folder / "equilibria", solved)
    with writing(folder):
        paths[0].parent.mkdir(exist_ok=True)
        for k, (path, performance) in enumerate(zip(paths, played, strict=True)):
            if not path.exists():
                columns = performance.recording(bed.seed, k + 1)
                numbered = {"press": (columns["press"][0], np.full(len(performance.frames.time_s), float(k)))}
                with put_in_place(path) as part:
                    write_recording(part, columns | numbered)
    return paths


def estimates(
    settings: RobotSettings,
    recordings: Sequence[Path],
    folder: Path,
    evaluator: Evaluator,
    *,
    done: Callable[[], None],
) -> list[Arrays]:
    """The evaluator's arrays of each recording, in their order.

    They are kept in the folder, with the estimates as CSV, and not estimated again where they are there.
    `done` is called after each.
    """
    files = [path.name.removesuffix(".csv.gz") for path in recordings]

    def start() -> Callable[[int], Mapping[str, np.ndarray]]:
        robot = build_robot(settings)
        trackers: SimpleQueue[Tracker] = SimpleQueue()
        for _ in range(min(cores(), len(files))):
            trackers.put(Tracker(robot))
        folder.mkdir(parents=True, exist_ok=True)

        def compute(k: int) -> Mapping[str, np.ndarray]:
            whole = read_sensors(settings, recordings[k])
            part = Part.of(whole, EVERY)
            study, tracker = Study(robot, part.recording), trackers.get()
            try:
                tracker.reset()
                frames = zip(sensor_frames(settings, whole), part.estimated, strict=True)
                with (folder / f"{files[k]}.csv").open("w", newline="") as stream:
                    rows = EstimateRows(stream, study)
                    for now in follow(tracker, frames):
                        study.see(now)
                        rows.write()
            finally:  # the others wait for it
                trackers.put(tracker)
            done()
            return evaluator.said(study)

        return compute

    return kept(folder, files, evaluator.names, start)


def fitted(settings: RobotSettings, recordings: Sequence[Path], folder: Path, *, seen: Seen) -> Path:
    """The configuration fitted to all samples of some recordings, fitted.toml, with the files beside it; not
    fitted again where these are there.
    """
    path = folder / "fitted.toml"
    if not all(path.with_suffix(suffix).exists() for suffix in (".toml", ".npz", ".html")):
        read = [read_sensors(settings, recording) for recording in recordings]
        calibrated_robot(build_robot(settings), read, path, seen=seen)
    return path


def sections(bed: Bed) -> list[tuple[str, str]]:
    """Headings and HTML of what the test bed is."""
    rows = [*bed.robot.told.items(), ("estimates", f"of each {EVERY}th frame, and of each sample")]
    found = [("The test bed", table(("", ""), rows))]
    if bed.fitted_to:
        told = f"<p>Fitted to {bed.fitted_to} presses that are not among these: "
        found.append(("Calibration", f'{told}<a href="fitted.html">report</a>.</p>'))
    return found
